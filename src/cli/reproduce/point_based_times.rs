//! [PBMHB Table 1]: seconds for the operator and for 100 bases.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use chladni::analysis::{JobKind, Parameters, analyze};
use chladni::cloud::PointCloud;
use chladni::cloud::shapes::{Sampling, Shape};
use chladni::progress::{Phase, Progress};

use super::table::{Bound, Table};
use super::{Extent, samples};
use crate::cli::Failure;

/// Name, seconds for the operator, seconds for 100 bases.
const TABLE_1: [(&str, f64, f64); 5] = [
    ("sphere, 4,002 points", 156.0, 2.8),
    ("eight, 7,678 points", 401.0, 17.0),
    ("cylinder, 90,300 points", 6_426.0, 348.0),
    ("rabbit, 248,304 points", 12_198.0, 2_051.0),
    ("Chinese lion, 611,222 points", 25_214.0, 7_269.0),
];

fn model(place: usize) -> Result<PointCloud, Failure> {
    match place {
        0 => samples::shape(Shape::Sphere, 4_002, Sampling::Uniform),
        1 => samples::shape(Shape::TwoHoleTorus, 7_678, Sampling::Uniform),
        2 => samples::cylinder(300, 301),
        3 => samples::shape(Shape::BumpySphere, 248_304, Sampling::Uniform),
        _ => samples::shape(Shape::BumpySphere, 611_222, Sampling::Uniform),
    }
}

/// Seconds at the default parameters.
pub(super) fn table_1(extent: Extent) -> Result<Table, Failure> {
    let mut table = Table::new(
        "PBMHB Table 1: seconds",
        "`pb-mhb` at its defaults, 100 bases, tolerance 1e-4. The paper: MATLAB and C++ on a Core 2 Duo at 2.66 GHz in 2012; ours: \
         the machine that wrote this report. Rabbit and lion are not published: a bumpy sphere of the same number of points \
         takes their place.",
    );
    for (place, &(name, operator, eigen)) in extent.of(&TABLE_1, 2).iter().enumerate() {
        let (ours_operator, ours_eigen) = seconds(&model(place)?)?;
        table.row(format!("{name}: operator"), operator, ours_operator, Bound::TimesPaper(0.1));
        table.row(
            format!("{name}: 100 bases"),
            eigen,
            ours_eigen,
            Bound::TimesPaper(if place < 2 { 2.0 } else { 1.0 }),
        );
    }
    Ok(table)
}

/// Seconds up to the assembled operator, and from there to the bases.
fn seconds(cloud: &PointCloud) -> Result<(f64, f64), Failure> {
    let began = Instant::now();
    let assembled: Arc<Mutex<Option<Instant>>> = Arc::default();
    let seen = Arc::clone(&assembled);
    let progress = Progress::observed(move |phase| {
        if matches!(phase, Phase::Factorization | Phase::Eigenpairs) {
            seen.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(Instant::now);
        }
    });
    analyze(cloud, JobKind::Eigen, &Parameters::default(), &progress).map_err(Failure::other)?;
    let total = began.elapsed().as_secs_f64();
    let operator = assembled
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .map_or(total, |instant| (instant - began).as_secs_f64());
    Ok((operator, total - operator))
}
