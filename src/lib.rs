//! Spectral geometry for scanned surfaces: discrete Laplace–Beltrami operators of point clouds, their
//! eigenbases (manifold harmonics), and a service that computes and serves them.
//!
//! The modules from [`harmonics`] down are a pure library; [`http`], [`jobs`], [`store`] and [`app`] are
//! the service built on it. `ARCHITECTURE.md` has the map.

pub mod analysis;
#[cfg(feature = "server")]
pub mod app;
pub mod cloud;
pub mod geometry;
pub mod harmonics;
#[cfg(feature = "server")]
pub mod http;
#[cfg(feature = "server")]
pub mod jobs;
#[cfg(feature = "server")]
pub mod metrics;
pub mod operator;
pub mod picture;
pub mod progress;
pub mod spectrum;
#[cfg(feature = "server")]
pub mod store;

/// Compiles and runs the examples of the README.
#[cfg(all(doctest, feature = "server"))]
#[doc = include_str!("../README.md")]
pub struct Readme;
