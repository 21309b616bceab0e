//! Spectral geometry for scanned surfaces: discrete Laplace–Beltrami operators of point clouds, their
//! eigenbases (manifold harmonics), and a service that computes and serves them.
//!
//! ```
//! # let points: Vec<[f64; 3]> = chladni::sample(&chladni::SampleRequest::new(chladni::Shape::Sphere, 500))?
//! #     .coordinates().as_chunks().0.to_vec();
//! let cloud = chladni::PointCloud::from_points(&points)?;
//! let laplacian = chladni::Laplacian::of(&cloud);
//! let modes = laplacian.eigenpairs(9)?;
//!
//! let spectrum = modes.report.spectrum.as_ref().expect("eigenpairs come with a spectrum");
//! assert!((spectrum.eigenvalues[1].expect("λ is known") - 2.0).abs() < 0.01); // l(l + 1) on the unit sphere
//! assert_eq!(modes.basis(1).len(), points.len());                            // one value per point
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Clouds
//!
//! [`read`] takes the bytes of a file in any [`Format`]; [`write()`] writes one. A [`PointCloud`] keeps fields, faces and the
//! types of the file.
//!
//! ```
//! use chladni::{Format, ReadOptions, read, write};
//!
//! let cloud = read(b"0 0 0 1.5\n1 0 0 2.5\n0 1 0 3.5\n", Format::Xyz, &ReadOptions::default())?;
//! assert_eq!((cloud.len(), cloud.fields()[0].values[2]), (3, 3.5));
//! let mut file = Vec::new();
//! write(&cloud, Format::Ply, &mut file)?;
//! assert_eq!(Format::sniff(&file), Some(Format::Ply));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Operators
//!
//! An [`OperatorKind`] names one; [`Laplacian::matrices`] gives it as a [`SparseMatrix`] with its masses.
//!
//! ```
//! use chladni::{Laplacian, OperatorKind, SampleRequest, Shape, sample};
//!
//! let sphere = sample(&SampleRequest::new(Shape::Sphere, 1_000))?;
//! let (q, mass) = Laplacian::of(&sphere).operator(OperatorKind::Voronoi).matrices()?;
//! assert!(q.is_symmetric());
//! assert!((mass.iter().sum::<f64>() / (4.0 * std::f64::consts::PI) - 1.0).abs() < 0.01); // the area
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Progress, cancellation, errors
//!
//! [`analyze`] takes a [`Progress`], which another thread may read and cancel; [`admit`] refuses what cannot be analyzed.
//!
//! ```
//! use chladni::{AnalysisError, JobKind, Parameters, Progress, SampleRequest, Shape, admit, analyze, sample};
//!
//! let sphere = sample(&SampleRequest::new(Shape::Sphere, 1_000))?;
//! let refused = admit(&sphere, &Parameters { bases: 2_000, ..Parameters::default() });
//! assert!(matches!(refused, Err(AnalysisError::Parameter { name: "bases", .. })));
//!
//! let progress = Progress::new();
//! progress.cancel();
//! let canceled = analyze(&sphere, JobKind::Eigen, &Parameters::default(), &progress);
//! assert!(matches!(canceled, Err(AnalysisError::Canceled(_))));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Harmonics and pictures
//!
//! What bases are for: [`Filter`] and [`Transfer`], [`Signature`], [`Distance`], [`Energy`]; bases come to them in [`Block`]s.
//!
//! ```
//! use chladni::harmonics::transform;
//! use chladni::{Block, Filter, Laplacian, Modes, Paint, Picture, SampleRequest, Shape, View, sample};
//!
//! let sphere = sample(&SampleRequest::new(Shape::Sphere, 1_000))?;
//! let found = Laplacian::of(&sphere).eigenpairs(16)?;
//! let modes = Modes::of(found.report.spectrum.as_ref().expect("eigenpairs come with a spectrum"));
//! let block = Block { first: 0, columns: (0..16).map(|j| found.basis(j)).collect::<Vec<_>>() };
//!
//! let height: Vec<f64> = (0..sphere.len()).map(|row| sphere.point(row)[2]).collect();
//! let transformed = transform::total(&[transform::partial(&block, &found.mass(), &[&height])]);
//! let gains = Filter { cutoff: Some(4.0), ..Filter::default() }.transfer(&modes)?.gains;
//! assert_eq!((gains[3], gains[4]), (1.0, 0.0));
//! let inside: f64 = transformed[0].coefficients[1..4].iter().map(|c| c * c).sum();
//! assert!(inside > 0.99 * transformed[0].energy); // z is a spherical harmonic of degree 1
//!
//! let picture = Picture::draw(&sphere, &Paint::Diverging(&found.basis(4)), &[], &View::default());
//! assert!(picture.to_png("a mode")?.starts_with(b"\x89PNG"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # The service
//!
//! With the feature `server`, on by default, come the modules `http`, `jobs`, `store` and `app`. Without it the crate is the
//! numbers alone: `chladni = { default-features = false }`. `ARCHITECTURE.md` has the map.

// the command line uses the library as any other program does
#[cfg(feature = "server")]
extern crate self as chladni;

pub mod analysis;
#[cfg(feature = "server")]
pub mod app;
pub mod arguments;
#[cfg(feature = "server")]
#[doc(hidden)] // a program: its modules are of no use to other programs
pub mod cli;
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
#[cfg(feature = "server")]
pub mod viewer;

pub use analysis::{
    Analysis, AnalysisError, JobKind, Laplacian, Parameters, Report, SparseMatrix, admit, analyze,
};
pub use cloud::reader::{Format, Limits, ReadError, ReadOptions, read};
pub use cloud::shapes::{SampleRequest, Shape, sample};
pub use cloud::writer::write;
pub use cloud::{CloudError, Grid, NonFinite, PointCloud, ScalarField, ScalarType};
pub use harmonics::{
    Block, Distance, DistanceKind, Energy, Feature, Filter, FilterError, FilterKind, Modes, Scale, Signature,
    SignatureKind, Transfer, Transformed,
};
pub use operator::OperatorKind;
pub use picture::{Paint, Picture, View};
pub use progress::{Canceled, Phase, Progress};
pub use spectrum::{Certificates, Method, Spectrum, SpectrumError};

/// Compiles and runs the examples of the README.
#[cfg(all(doctest, feature = "server"))]
#[doc = include_str!("../README.md")]
pub struct Readme;
