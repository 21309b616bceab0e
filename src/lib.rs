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
//! Everything below is re-exported at the root, and that is the interface: the modules behind it serve the project's own
//! program, tests and Python package, are left out of this documentation, and may change with any version. Structs of
//! options gain fields: complete them with `..Default::default()`.
//!
//! # Clouds
//!
//! [`read`] takes the bytes of a file in any [`Format`]; [`write()`] writes one. Files of strangers are read within
//! [`Limits`]; a [`ReadError`] names the [`Location`] at fault.
//!
//! ```
//! use chladni::{Format, Limits, Location, NonFinite, ReadError, ReadOptions, read, write};
//!
//! let cloud = read(b"0 0 0 1.5\n1 0 0 2.5\n0 1 0 3.5\n", Format::Xyz, &ReadOptions::default())?;
//! assert_eq!((cloud.len(), cloud.fields()[0].values[2]), (3, 3.5));
//! let mut file = Vec::new();
//! write(&cloud, Format::Ply, &mut file)?;
//! assert_eq!(Format::sniff(&file), Some(Format::Ply));
//!
//! let broken = read(b"0 0 0\n1 zero 0\n", Format::Xyz, &ReadOptions::default());
//! assert!(matches!(broken, Err(ReadError::Malformed { location: Location::Line(2), .. })));
//! let limits = Limits { points_max: 2, ..Limits::default() };
//! let options = ReadOptions { policy: NonFinite::Drop, limits, ..ReadOptions::default() };
//! let large = read(b"0 0 0\nnan 0 0\n0 1 0\n", Format::Xyz, &options);
//! assert!(matches!(large, Err(ReadError::TooManyPoints { points_max: 2, .. })));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A [`PointCloud`] can be put together too; it keeps fields, faces, the types of the file and the grid of its coordinates.
//!
//! ```
//! use chladni::{CloudError, Grid, Numbers, PointCloud, ScalarField, ScalarType};
//!
//! let cloud = PointCloud::from_points(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])?;
//! let heat = ScalarField { name: "heat".into(), kind: ScalarType::Float32, values: Numbers::from(vec![1.0, 2.0]) };
//! let short = cloud.clone().with_fields(vec![heat]);
//! assert!(matches!(short, Err(CloudError::FieldLength { values: 2, points: 3, .. })));
//!
//! let millimeters = Grid { scale: 0.001, offset: 0.0 };
//! let cloud = cloud.with_faces(vec![[0, 1, 2]])?.with_grids(Some([millimeters; 3]));
//! assert_eq!(cloud.grids().map(|[x, _, _]| x.coordinate(1_500.0)), Some(1.5));
//! # Ok::<(), CloudError>(())
//! ```
//!
//! [`sample`] draws points from a [`Shape`] whose spectrum is known.
//!
//! ```
//! use chladni::{SampleError, SampleRequest, Sampling, Shape, sample};
//!
//! let request = SampleRequest { sampling: Sampling::Iid, seed: 1, ..SampleRequest::new(Shape::Torus, 1_000) };
//! assert_eq!(sample(&request)?, sample(&request)?); // the same request, the same cloud
//! let none = sample(&SampleRequest { points: 0, ..request });
//! assert!(matches!(none, Err(SampleError::Points { points: 0, .. })));
//! # Ok::<(), SampleError>(())
//! ```
//!
//! # Operators
//!
//! An [`OperatorKind`] names one, [`Parameters`] say how it is built; [`Laplacian::matrices`] gives it as a
//! [`SparseMatrix`] with its masses.
//!
//! ```
//! use chladni::{Laplacian, OperatorKind, SampleRequest, Shape, SparseMatrix, sample};
//!
//! let sphere = sample(&SampleRequest::new(Shape::Sphere, 1_000))?;
//! let (q, mass): (SparseMatrix, Vec<f64>) = Laplacian::of(&sphere).operator(OperatorKind::Voronoi).matrices()?;
//! assert!(q.is_symmetric());
//! assert!((mass.iter().sum::<f64>() / (4.0 * std::f64::consts::PI) - 1.0).abs() < 0.01); // the area
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Spectra, and how far to trust them
//!
//! An [`Analysis`] has a [`Report`]: how the cloud is sampled, the [`Spectrum`], and its [`Certificates`].
//!
//! ```
//! use chladni::{Analysis, Certificates, Laplacian, Method, MissedCheck, Report, SampleRequest, Shape, Spectrum, sample};
//!
//! let sphere = sample(&SampleRequest::new(Shape::Sphere, 1_000))?;
//! let found: Analysis = Laplacian::of(&sphere).eigenpairs(16)?;
//! let Report { sampling, warnings, spectrum: Some(spectrum), .. } = &found.report else { unreachable!() };
//! assert!(warnings.is_empty() && sampling.epsilon < 0.15); // no place is farther from a point than ε
//! let Spectrum { certificates, method, residuals, .. } = spectrum;
//! assert_eq!(residuals.len(), 16);
//! let Certificates { residual, missed, missed_check, .. } = certificates;
//! assert!(*residual < 1e-4 && *missed == Some(0)); // all sixteen, and none between them is missing
//! assert_eq!((*method, *missed_check), (Method::ShiftInvert, MissedCheck::Inertia));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Progress, cancellation, errors
//!
//! [`analyze`] takes a [`Progress`], which another thread may read and cancel; [`admit`] refuses what cannot be analyzed.
//!
//! ```
//! use std::sync::mpsc;
//!
//! use chladni::{
//!     AnalysisError, Canceled, JobKind, Parameters, Phase, Progress, SampleRequest, Shape, admit, analyze, sample,
//! };
//!
//! let sphere = sample(&SampleRequest::new(Shape::Sphere, 1_000))?;
//! let refused = admit(&sphere, &Parameters { bases: 2_000, ..Parameters::default() });
//! assert!(matches!(refused, Err(AnalysisError::Parameter { name: "bases", .. })));
//!
//! let (sender, phases) = mpsc::channel();
//! let progress = Progress::observed(move |phase| sender.send(phase).expect("somebody listens"));
//! analyze(&sphere, JobKind::Operator, &Parameters::default(), &progress)?;
//! assert_eq!(phases.try_iter().next(), Some(Phase::Preparation));
//!
//! progress.cancel();
//! let canceled = analyze(&sphere, JobKind::Eigen, &Parameters::default(), &progress);
//! assert_eq!(canceled.err(), Some(AnalysisError::Canceled(Canceled)));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Harmonics
//!
//! Bases come in [`Block`]s of rows, so that they need not fit into memory. A function is [`Transformed`], its [`Energy`]
//! is read, and a [`Filter`] becomes a [`Transfer`] on the [`Modes`].
//!
//! ```
//! use chladni::{
//!     Block, Energy, Filter, FilterError, FilterKind, Laplacian, Modes, SampleRequest, Scale, Shape, Transfer, Transformed,
//!     sample, synthesize,
//! };
//!
//! let sphere = sample(&SampleRequest::new(Shape::Sphere, 1_000))?;
//! let found = Laplacian::of(&sphere).eigenpairs(16)?;
//! let modes = Modes::of(found.report.spectrum.as_ref().expect("eigenpairs come with a spectrum"));
//! let block = Block { first: 0, columns: (0..16).map(|j| found.basis(j)).collect::<Vec<_>>() };
//!
//! let height: Vec<f64> = (0..sphere.len()).map(|row| sphere.point(row)[2]).collect();
//! let transformed = Transformed::of(&height, &block, &found.mass());
//! let energy = Energy::of(&transformed, 16);
//! let first: f64 = energy.bands[1..4].iter().map(|band| band.share).sum();
//! assert!(first > 0.99); // z is a spherical harmonic of degree 1
//!
//! // between √2 and √6, the frequencies of degrees 1 and 2
//! let low = Filter { kind: FilterKind::LowPass, by: Scale::Frequency, cutoff: Some(2.0), ..Filter::default() };
//! let transfer: Transfer = low.transfer(&modes)?;
//! assert_eq!((transfer.gains[3], transfer.gains[4]), (1.0, 0.0));
//! let smooth = synthesize(&block, &[&transfer.apply(&transformed.coefficients)]);
//! assert!(smooth[0].iter().zip(&height).all(|(smooth, z)| (smooth - z).abs() < 0.05));
//!
//! let refused = Filter { time: Some(1.0), ..low }.transfer(&modes);
//! assert!(matches!(refused, Err(FilterError { parameter: "time", .. })));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A [`Signature`] describes each point by what it sees of the surface, a [`Distance`] compares it with another, and
//! [`features`] finds the places at which consecutive bases have [`extrema`].
//!
//! ```
//! use chladni::{
//!     Block, Distance, DistanceKind, Extremum, Feature, Laplacian, Modes, Neighborhoods, SampleRequest, Shape, Signature,
//!     SignatureKind, extrema, features, sample,
//! };
//!
//! let ellipsoid = sample(&SampleRequest::new(Shape::Ellipsoid, 1_000))?;
//! let found = Laplacian::of(&ellipsoid).eigenpairs(60)?;
//! let modes = Modes::of(found.report.spectrum.as_ref().expect("eigenpairs come with a spectrum"));
//! let block = Block { first: 0, columns: (0..60).map(|j| found.basis(j)).collect::<Vec<_>>() };
//!
//! let signature = Signature::new(SignatureKind::Hks, 3, &modes).expect("there are modes");
//! assert_eq!(signature.values(&block).len(), 3);
//! let here = block.columns.iter().map(|basis| basis[7]).collect();
//! let distance = Distance::from(DistanceKind::Biharmonic, here, None, &modes).expect("row 7 has a result");
//! assert_eq!(distance.values(&block)[7], 0.0);
//!
//! let sampling = &found.report.sampling;
//! let around = Neighborhoods::find(&ellipsoid, &found.mass(), 2.0 * sampling.epsilon)?;
//! let extrema: Vec<Vec<Extremum>> =
//!     block.columns[1..].iter().map(|basis| extrema(basis, &around, sampling.area)).collect();
//! let places = features(&extrema, 1, &around, 0.1);
//! let found: Feature = places[0].in_cloud(&around, &ellipsoid);
//! assert!(found.position[2].abs() > 0.55); // an end of the shortest axis, which is 0.6 long
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Pictures
//!
//! ```
//! use chladni::{Background, Paint, Picture, SampleRequest, Shape, Up, View, sample};
//!
//! let sphere = sample(&SampleRequest::new(Shape::Sphere, 1_000))?;
//! let height: Vec<f64> = (0..sphere.len()).map(|row| sphere.point(row)[2]).collect();
//! let view = View { up: Up::Z, background: Background::White, width: 200, height: 150, ..View::default() };
//! let picture = Picture::draw(&sphere, &Paint::Diverging(&height), &[], &view);
//! assert_eq!(picture.pixels.len(), 4 * 200 * 150);
//! assert!(picture.to_png("the height of a sphere")?.starts_with(b"\x89PNG"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # The service
//!
//! The feature `server`, on by default, brings the program `chladni` and what it is made of. Without it the crate is the
//! numbers alone: `chladni = { default-features = false }`. `ARCHITECTURE.md` has the map.

// the command line uses the library as any other program does
#[cfg(feature = "server")]
extern crate self as chladni;

// Rooms that other programs of this project look into: tests, benchmarks, the Python package. Nobody else should: see
// docs/decisions/0005-hidden-rooms.md.
#[doc(hidden)]
pub mod analysis;
#[cfg(feature = "server")]
#[doc(hidden)]
pub mod app;
#[doc(hidden)]
pub mod arguments;
#[cfg(feature = "server")]
#[doc(hidden)]
pub mod cli;
#[doc(hidden)]
pub mod cloud;
#[doc(hidden)]
pub mod geometry;
#[doc(hidden)]
pub mod harmonics;
#[cfg(feature = "server")]
#[doc(hidden)]
pub mod http;
#[cfg(feature = "server")]
#[doc(hidden)]
pub mod jobs;
#[cfg(feature = "server")]
#[doc(hidden)]
pub mod metrics;
#[doc(hidden)]
pub mod operator;
#[doc(hidden)]
pub mod picture;
#[doc(hidden)]
pub mod progress;
#[doc(hidden)]
pub mod spectrum;
#[cfg(feature = "server")]
#[doc(hidden)]
pub mod store;
#[cfg(feature = "server")]
#[doc(hidden)]
pub mod viewer;

#[doc(inline)]
pub use analysis::{
    Analysis, AnalysisError, JobKind, Laplacian, Parameters, Report, SparseMatrix, admit, analyze,
};
#[doc(inline)]
pub use cloud::reader::{Format, Limits, Location, ReadError, ReadOptions, read};
#[doc(inline)]
pub use cloud::shapes::{SampleError, SampleRequest, Sampling, Shape, sample};
#[doc(inline)]
pub use cloud::writer::write;
#[doc(inline)]
pub use cloud::{CloudError, Grid, NonFinite, Numbers, PointCloud, ScalarField, ScalarType};
#[doc(inline)]
pub use harmonics::features::{Extremum, extrema, features};
#[doc(inline)]
pub use harmonics::transform::synthesize;
#[doc(inline)]
pub use harmonics::{
    Block, Distance, DistanceKind, Energy, Feature, Filter, FilterError, FilterKind, Modes, Neighborhoods,
    Scale, Signature, SignatureKind, Transfer, Transformed,
};
#[doc(inline)]
pub use operator::OperatorKind;
#[doc(inline)]
pub use picture::{Background, Paint, Picture, Up, View};
#[doc(inline)]
pub use progress::{Canceled, Phase, Progress};
#[doc(inline)]
pub use spectrum::{Certificates, Method, MissedCheck, Spectrum};

/// Compiles and runs the examples of the README.
#[cfg(all(doctest, feature = "server"))]
#[doc = include_str!("../README.md")]
pub struct Readme;
