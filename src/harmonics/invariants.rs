//! What a spectrum says of the whole surface: area, boundary length, Euler characteristic.
//!
//! All three stand in the heat trace `Z(τ) = Σ exp(−λ_i τ) = A/(4πτ) + ℓ/(8√(πτ)) + χ/6 + …` [PCD §4; Kac 1966], for
//! natural (Neumann) rims that are smooth: every right-angled corner of a rim adds 1/8 to what is read as χ.
//!
//! A relative error e of the eigenvalues enters χ as `6 e A/(4πτ)`, so that 1 % drowns it at small times; at large times
//! the terms left out do. Both are part of the uncertainty, the spread between fits that should agree. To that of the area
//! comes what the operator's own error makes of it: linear elements and finite volumes have eigenvalues that are too small
//! by about `λ h²/12` of themselves. Over the closed forms of the tests the truth lies within the uncertainty in 95 % of
//! cases.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Modes;
pub use super::heat_trace::Estimate;
use super::heat_trace::{self, WINDOW_START};
use crate::geometry::Sampling;

impl Estimate {
    fn widened(self, times: f64) -> Self {
        Self { uncertainty: times * self.uncertainty, ..self }
    }
}

/// Invariants of a surface, in units of the cloud.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
pub struct Invariants {
    /// Sum of the Voronoi cells, in length².
    pub cell_area: f64,
    /// Area from the heat trace, in length²; null for fewer than 10 eigenvalues.
    pub heat_trace_area: Option<Estimate>,
    /// Whether enough cells lie on a rim to take the surface for an open one.
    pub is_open: bool,
    /// Length of the rims; null for a closed surface, and where the spectrum does not carry it.
    pub boundary_length: Option<Estimate>,
    /// Euler characteristic, summed over the components; null where the spectrum does not carry it.
    pub euler_characteristic: Option<Estimate>,
    /// The even number that the uncertainty leaves, if it is one; null for open surfaces.
    pub euler_characteristic_rounded: Option<i64>,
    /// Why a number is null, by its name.
    pub reasons: BTreeMap<&'static str, String>,
}

/// Fewer modes are all taken up by the leading term.
const MODES_MIN: usize = 50;

/// Times in a window.
const SAMPLES: usize = 24;

/// Last time of a window over its first.
const SHORT: f64 = 4.0;
const LONG: f64 = 8.0;

/// A fitted area farther than this from the cells' is not an error of the eigenvalues: the window lies at times for which
/// the surface's features are too small, and what is left for χ means nothing.
const AREA_MISFIT_MAX: f64 = 0.03;

/// Relative error of the area over `λ h²` of the largest eigenvalue: of the `1/12` by which the eigenvalues of a grid of
/// spacing h err, the share that the fits of closed and of open surfaces let through.
const ERROR_CLOSED: f64 = 0.5 / 12.0;
const ERROR_OPEN: f64 = 0.8 / 12.0;

/// What the spreads of the characteristic and of the boundary length are multiplied with: the fits leave out the same terms and
/// err to the same side, and what eigenvalues are off in common is read as length (a grid of 4,000 points of the unit square:
/// 3.977 by `pb-mhb` from fits that differ by 0.012).
const COMMON_ERROR: f64 = 1.5;
const COMMON_ERROR_OF_LENGTH: f64 = 2.0;

/// Why a characteristic is not told.
const NOT_EVEN: &str = "what is read off is not near an even number, as closed surfaces have";

/// A characteristic is an even number that is as near, whatever its uncertainty: no other comes into question.
const NEAR: f64 = 0.25;

/// The whole numbers that a characteristic may be.
enum Whole {
    None,
    One(i64),
    Several,
    /// An open surface: what its corners add is not known.
    OfCorners,
}

/// Without rims an orientable surface of any number of parts has an even characteristic.
fn characteristic(euler: Estimate, is_open: bool) -> Whole {
    let reach = euler.uncertainty.max(NEAR);
    let halves = |sign: f64| 0.5 * (euler.value + sign * reach);
    let (first, last) = (halves(-1.0).ceil(), halves(1.0).floor());
    match last - first {
        _ if is_open => Whole::OfCorners,
        more if more < 0.0 => Whole::None,
        more if more > 0.0 => Whole::Several,
        _ => Whole::One(2 * first as i64),
    }
}

/// Measures what the spectrum and the cells say.
#[must_use]
pub fn measure(modes: &Modes, sampling: &Sampling) -> Invariants {
    let known = &modes.eigenvalues()[..modes.informative().end];
    let is_open = sampling.is_open();
    let mut reasons = BTreeMap::new();
    let area = traced_area(known, sampling, is_open)
        .map_err(|reason| reasons.insert("heat_trace_area", reason))
        .ok();
    let (length, euler) = match topology(known, sampling.area, is_open) {
        Some((length, euler)) => (length, Some(euler)),
        None => (None, None),
    };
    let fewer = (known.len() < MODES_MIN)
        .then(|| format!("{} eigenvalues carry information, {MODES_MIN} are needed", known.len()));
    let too_few = fewer.unwrap_or_else(|| {
        "the eigenvalues are too few for the features of the surface; ask for more bases".to_owned()
    });
    // a length is positive, and one that its own error swallows is not known
    let found = length;
    let length = length.filter(|length| length.value > length.uncertainty);
    if length.is_none() {
        let reason = match found {
            Some(length) => format!("{:.3} ± {:.3} cannot be told from 0", length.value, length.uncertainty),
            None if is_open => too_few.clone(),
            None => "the surface is closed".to_owned(),
        };
        reasons.insert("boundary_length", reason);
    }
    let whole = euler.map(|euler| characteristic(euler, is_open));
    let euler = euler.filter(|_| !matches!(whole, Some(Whole::None)));
    if euler.is_none() {
        reasons.insert("euler_characteristic", if whole.is_some() { NOT_EVEN.to_owned() } else { too_few });
    }
    let rounded = match whole {
        Some(Whole::One(whole)) => Ok(whole),
        Some(Whole::Several) => Err("the uncertainty leaves more than one"),
        Some(Whole::OfCorners) => Err("every corner of a rim counts 1/8"),
        Some(Whole::None) | None => Err("the characteristic is not known"),
    };
    let rounded =
        rounded.map_err(|reason| reasons.insert("euler_characteristic_rounded", reason.to_owned())).ok();
    Invariants {
        cell_area: sampling.area,
        heat_trace_area: area,
        is_open,
        boundary_length: length,
        euler_characteristic: euler,
        euler_characteristic_rounded: rounded,
        reasons,
    }
}

/// The area from the heat trace, or why it is not known.
fn traced_area(known: &[f64], sampling: &Sampling, is_open: bool) -> Result<Estimate, String> {
    let area = heat_trace::area(known, is_open)
        .ok_or_else(|| format!("{} eigenvalues carry information, 10 are needed", known.len()))?;
    let error = if is_open { ERROR_OPEN } else { ERROR_CLOSED };
    let resolution = known.last().unwrap_or(&0.0) * sampling.spacing.powi(2);
    let uncertainty = area.uncertainty + area.value.abs() * error * resolution;
    // two numbers of the same surface that exclude each other are both unknown
    if (area.value - sampling.area).abs() > AREA_MISFIT_MAX * sampling.area + uncertainty {
        return Err(format!(
            "{:.4} ± {uncertainty:.4} is read off, which the {:.4} of the cells excludes; ask for more bases",
            area.value, sampling.area
        ));
    }
    Ok(Estimate { uncertainty, ..area })
}

/// Boundary length, for an open surface, and Euler characteristic, from the smallest eigenvalues in 1/length² and the area
/// in length². `None` for fewer than 50 eigenvalues, and when
/// these are too few for the surface's features.
///
/// With `s = 4πτ/A` the trace is `1/s + ℓ/(4√A) s^-½ + χ/6 + O(s^½)`, the last O(s) on closed surfaces. There the first
/// coefficient is fitted too: it takes up a common relative error of the eigenvalues. On open ones it cannot be told
/// from the second and is held at 1.
#[must_use]
pub fn topology(eigenvalues: &[f64], area: f64, is_open: bool) -> Option<(Option<Estimate>, Estimate)> {
    if eigenvalues.len() < MODES_MIN || area <= 0.0 || !area.is_finite() {
        return None;
    }
    let fit = |ratio, powers: &[f64]| Trace { eigenvalues, area, ratio }.fit(powers);
    let spread = |value: f64, others: [f64; 2]| Estimate {
        value,
        uncertainty: others.iter().map(|other| (value - other).abs()).sum(),
    };
    if is_open {
        // coefficients of s^-½ and of 1
        let main = fit(LONG, &[-0.5, 0.0])?;
        let short = fit(SHORT, &[-0.5, 0.0])?;
        let free = fit(LONG, &[-1.0, -0.5, 0.0])?;
        let to_length = 4.0 * area.sqrt();
        let length = spread(main[0] * to_length, [short[0] * to_length, free[1] * to_length])
            .widened(COMMON_ERROR_OF_LENGTH);
        let euler = spread(6.0 * main[1], [6.0 * short[1], 6.0 * free[2]]);
        Some((Some(length), euler.widened(COMMON_ERROR)))
    } else {
        let main = fit(SHORT, &[-1.0, 0.0, 1.0])?;
        if (main[0] - 1.0).abs() > AREA_MISFIT_MAX {
            return None;
        }
        let long = fit(LONG, &[-1.0, 0.0, 1.0])?;
        let bent = fit(SHORT, &[-1.0, 0.0, 1.0, 2.0])?;
        Some((None, spread(6.0 * main[1], [6.0 * long[1], 6.0 * bent[1]]).widened(COMMON_ERROR)))
    }
}

/// A heat trace over a window of times.
struct Trace<'a> {
    eigenvalues: &'a [f64],
    area: f64,
    /// Last time over the first.
    ratio: f64,
}

impl Trace<'_> {
    /// Coefficients of these powers of `s = 4πτ/A` in the trace, least squares with weights s: errors of eigenvalues count
    /// as 1/s. The power −1 is held at 1 unless it is among them.
    fn fit(&self, powers: &[f64]) -> Option<Vec<f64>> {
        let largest = *self.eigenvalues.last()?;
        if !(largest > 0.0 && largest.is_finite()) {
            return None;
        }
        let place = |i: usize| self.ratio.powf(i as f64 / (SAMPLES - 1) as f64);
        let times: Vec<f64> = (0..SAMPLES).map(|i| WINDOW_START / largest * place(i)).collect();
        let values: Vec<f64> = times.iter().map(|&tau| heat_trace::trace(self.eigenvalues, tau)).collect();
        let held = if powers.contains(&-1.0) { 0.0 } else { 1.0 };
        let s = |i: usize| 4.0 * std::f64::consts::PI * times[i] / self.area;
        let rows = nalgebra::DMatrix::from_fn(SAMPLES, powers.len(), |i, j| s(i) * s(i).powf(powers[j]));
        let wanted = nalgebra::DVector::from_fn(SAMPLES, |i, _| s(i) * (values[i] - held / s(i)));
        let fitted = rows.svd(true, true).solve(&wanted, f64::EPSILON).ok()?;
        Some(fitted.iter().copied().collect())
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn within(estimate: Estimate, exact: f64, uncertainty_max: f64) {
        assert!((estimate.value - exact).abs() <= estimate.uncertainty, "{estimate:?} {exact}");
        assert!(estimate.uncertainty <= uncertainty_max, "{estimate:?}");
    }

    /// The `count` smallest of these.
    fn smallest(all: impl Iterator<Item = f64>, count: usize) -> Vec<f64> {
        let mut all: Vec<f64> = all.collect();
        all.sort_by(f64::total_cmp);
        all.truncate(count);
        all
    }

    #[test]
    fn the_exact_spectrum_of_the_sphere_has_characteristic_2() {
        let levels = (0..20).flat_map(|l| std::iter::repeat_n(f64::from(l * (l + 1)), 2 * l as usize + 1));
        for count in [100, 200, 400] {
            let (length, euler) = topology(&smallest(levels.clone(), count), 4.0 * PI, false).unwrap();
            assert_eq!(length, None);
            within(euler, 2.0, 0.25);
        }
    }

    #[test]
    fn the_exact_spectrum_of_the_flat_torus_has_characteristic_0() {
        let lattice = (-15..16).flat_map(|a| (-15..16).map(move |b| f64::from(a * a + b * b)));
        within(topology(&smallest(lattice, 200), 4.0 * PI * PI, false).unwrap().1, 0.0, 0.2);
    }

    #[test]
    fn the_exact_spectrum_of_the_square_has_its_rim_and_half_a_characteristic_too_much_for_its_corners() {
        let lattice = (0..30).flat_map(|a| (0..30).map(move |b| PI * PI * f64::from(a * a + b * b)));
        let (length, euler) = topology(&smallest(lattice, 200), 1.0, true).unwrap();
        within(length.unwrap(), 4.0, 0.05);
        within(euler, 1.5, 0.1);
    }

    #[test]
    fn the_exact_spectrum_of_the_cylinder_has_two_rims_and_characteristic_0() {
        let waves =
            (-30..31).flat_map(|a| (0..40).map(move |b| f64::from(a * a) + PI * PI / 4.0 * f64::from(b * b)));
        let (length, euler) = topology(&smallest(waves, 200), 4.0 * PI, true).unwrap();
        within(length.unwrap(), 4.0 * PI, 0.1);
        within(euler, 0.0, 0.1);
    }

    /// Eigenvalues, area, length of the rims, and characteristic with 1/8 for every corner.
    fn closed_forms() -> Vec<(Vec<f64>, f64, Option<f64>, f64)> {
        let levels = |each: fn(i32) -> usize| {
            (0..40).flat_map(move |l| std::iter::repeat_n(f64::from(l * (l + 1)), each(l))).collect()
        };
        let waves = |a: std::ops::Range<i32>, b: std::ops::Range<i32>, [p, q]: [f64; 2]| -> Vec<f64> {
            let value = move |a: i32, b: i32| p * f64::from(a * a) + q * f64::from(b * b);
            a.flat_map(|a| b.clone().map(move |b| value(a, b))).collect()
        };
        let mut all = vec![
            (levels(|l| 2 * l as usize + 1), 4.0 * PI, None, 2.0),
            (levels(|l| l as usize + 1), 2.0 * PI, Some(2.0 * PI), 1.0),
        ];
        for k in [1.0, 2.0, 3.0, 4.0] {
            all.push((waves(-60..61, -60..61, [1.0, k * k]), 4.0 * PI * PI / k, None, 0.0));
            all.push((waves(0..60, 0..240, [PI * PI, PI * PI / (k * k)]), k, Some(2.0 + 2.0 * k), 1.5));
            all.push((waves(-60..61, 0..60, [1.0, PI * PI / (k * k)]), 2.0 * PI * k, Some(4.0 * PI), 0.0));
        }
        all
    }

    #[test]
    fn uncertainties_cover_the_truth_in_95_percent_of_closed_forms() {
        let mut covered: BTreeMap<&str, Vec<bool>> = BTreeMap::new();
        for (all, exact, rims, characteristic) in closed_forms() {
            let all = smallest(all.into_iter(), 400);
            for count in [12, 20, 30, 50, 75, 100, 150, 200, 300, 400] {
                for points in [f64::INFINITY, 4000.0, 2000.0] {
                    // the error of finite elements
                    let h2 = exact / points;
                    let known: Vec<f64> = all[..count].iter().map(|x| x * (1.0 - x * h2 / 12.0)).collect();
                    let sampling = Sampling {
                        epsilon: h2.sqrt(),
                        zeta: h2.sqrt(),
                        spacing: h2.sqrt(),
                        density_ratio: 1.0,
                        area: exact,
                        rim_cells: 0,
                        invalid_cells: 0,
                    };
                    let mut check = |name, estimate: Option<Estimate>, truth: f64| {
                        let is_covered = |e: Estimate| (e.value - truth).abs() <= e.uncertainty;
                        covered.entry(name).or_default().extend(estimate.map(is_covered));
                    };
                    check("area", traced_area(&known, &sampling, rims.is_some()).ok(), exact);
                    let Some((length, euler)) = topology(&known, exact, rims.is_some()) else { continue };
                    check("length", length.filter(|l| l.value > l.uncertainty), rims.unwrap_or(0.0));
                    check("characteristic", Some(euler), characteristic);
                }
            }
        }
        for (name, covered) in covered {
            let share = covered.iter().filter(|is| **is).count() as f64 / covered.len() as f64;
            println!("{name}: {:.1} % of {}", 100.0 * share, covered.len());
            assert!(share >= 0.95 && covered.len() > 100, "{name}: {share} of {}", covered.len());
        }
    }

    #[test]
    fn a_closed_surface_has_an_even_characteristic_or_none_that_is_known() {
        let told =
            |value, uncertainty, is_open| match characteristic(Estimate { value, uncertainty }, is_open) {
                Whole::One(whole) => whole.to_string(),
                Whole::None => "none".to_owned(),
                Whole::Several => "several".to_owned(),
                Whole::OfCorners => "corners".to_owned(),
            };
        assert_eq!(told(1.95, 0.04, false), "2");
        assert_eq!(told(-0.13, 1.04, false), "0");
        assert_eq!(told(3.0, 0.1, false), "none");
        assert_eq!(told(-4.3, 3.5, false), "several");
        assert_eq!(told(1.66, 0.36, true), "corners", "of a square: 1 and 1/8 for each");
    }

    #[test]
    fn too_few_eigenvalues_carry_no_topology() {
        assert_eq!(topology(&[1.0; 49], 1.0, false), None);
        assert_eq!(topology(&[0.0; 60], 1.0, false), None);
    }
}
