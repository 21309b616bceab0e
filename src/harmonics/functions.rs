//! Functions on the rows of an upload, made fit for the transform.

use rayon::prelude::*;

use crate::cloud::PointCloud;
use crate::geometry::{Points, SearchTree};

/// Neighbors among which the row that carries a merged row's mass is looked for first.
const NEAR: usize = 8;

/// A number per row of the upload, under a name.
#[derive(Debug, Clone, PartialEq)]
pub struct Function {
    /// Its name: `x`, or a field's.
    pub name: String,
    /// One value per row.
    pub values: Vec<f64>,
    /// Rows that have mass but no value of their own, ascending: there `values` holds the mean of the others.
    pub missing: Vec<u32>,
}

impl Function {
    /// A function that has a value everywhere.
    #[must_use]
    pub fn new(name: impl Into<String>, values: Vec<f64>) -> Self {
        Self { name: name.into(), values, missing: Vec::new() }
    }

    /// Gives the rows that have mass but no finite value the mean of the others, weighted by mass, and remembers them: a
    /// scan has no intensity where its laser saw none, and the rest is still known. False when no
    /// row has a value.
    pub fn fill_missing(&mut self, mass: &[f64]) -> bool {
        let (mut sum, mut weight) = (0.0, 0.0);
        for (&value, &mass) in
            self.values.iter().zip(mass).filter(|(value, mass)| value.is_finite() && **mass > 0.0)
        {
            sum += mass * value;
            weight += mass;
        }
        for (row, value) in self.values.iter_mut().enumerate() {
            if mass[row] > 0.0 && !value.is_finite() {
                self.missing.push(row as u32);
                *value = sum / weight;
            }
        }
        weight > 0.0
    }
}

/// One coordinate of a cloud.
#[must_use]
pub fn coordinate(cloud: &PointCloud, axis: usize) -> Function {
    let values = cloud.coordinates().iter().skip(axis).step_by(cloud.dimension()).copied().collect();
    Function::new(crate::cloud::writer::axis_name(axis), values)
}

/// All coordinates of a cloud.
#[must_use]
pub fn coordinates(cloud: &PointCloud) -> Vec<Function> {
    (0..cloud.dimension()).map(|axis| coordinate(cloud, axis)).collect()
}

/// The first row that carries mass and has a value that is not finite.
#[must_use]
pub fn first_nonfinite(values: &[f64], mass: &[f64]) -> Option<usize> {
    values.iter().zip(mass).position(|(value, &mass)| mass > 0.0 && !value.is_finite())
}

/// Rows that carry no result: their mass is NaN.
#[must_use]
pub fn rows_without_result(mass: &[f64]) -> usize {
    mass.iter().filter(|mass| mass.is_nan()).count()
}

/// For every row the row whose values it repeats: the first at its position. `None` when no row repeats another, which is
/// when none has mass 0.
#[must_use]
pub fn first_occurrences(cloud: &PointCloud, mass: &[f64]) -> Option<Vec<u32>> {
    mass.contains(&0.0).then(|| Points::first_rows(cloud))
}

/// For every row the row that carries its mass: as [`first_occurrences`], and for rows that the analysis merged with others
/// near them the nearest that has mass. `None` when each carries its own.
#[must_use]
pub fn carriers(cloud: &PointCloud, mass: &[f64]) -> Option<Vec<u32>> {
    let mut carriers = first_occurrences(cloud, mass)?;
    if carriers.iter().all(|&first| mass[first as usize] != 0.0) {
        return Some(carriers);
    }
    let points = Points::distinct(cloud);
    let tree = SearchTree::new(&points);
    let nearest = |i: usize| {
        let mut near = Vec::new();
        for count in std::iter::successors(Some(NEAR), |count| Some(2 * count)) {
            tree.nearest(&points, i, count, &mut near);
            let rows = near.iter().map(|q| points.row(q.index as usize));
            if let Some(row) = rows.into_iter().find(|&row| mass[row] > 0.0) {
                return row;
            }
            if near.len() < count {
                break;
            }
        }
        points.row(i)
    };
    carriers.par_iter_mut().filter(|first| mass[**first as usize] == 0.0).for_each(|first| {
        if let Some(point) = points.of_row(*first as usize) {
            *first = nearest(point) as u32;
        }
    });
    Some(carriers)
}

/// Gives every row the value of its first occurrence.
pub fn copy_from_first(values: &mut [f64], first_occurrences: &[u32]) {
    for (row, &first) in first_occurrences.iter().enumerate() {
        values[row] = values[first as usize];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::NonFinite;

    #[test]
    fn rows_of_mass_zero_repeat_the_row_that_carries_their_mass() {
        let rows = PointCloud::new(1, vec![0.0, 2.0, 1e-20, -0.0], NonFinite::Drop).unwrap();
        assert_eq!(first_occurrences(&rows, &[1.0, 1.0, 1.0, 1.0]), None);
        let first = first_occurrences(&rows, &[1.0, 1.0, 0.0, 0.0]).unwrap();
        let mut values = [1.0, 2.0, f64::NAN, f64::NAN];
        copy_from_first(&mut values, &first);
        assert_eq!(values.map(f64::to_bits), [1.0, 2.0, 1.0, 1.0].map(f64::to_bits));
    }

    #[test]
    fn rows_that_were_merged_with_others_near_them_are_carried_by_the_nearest_with_mass() {
        let copies = (0..20).map(|i| 2.0 + 1e-9 * f64::from(i));
        let coordinates: Vec<f64> = [0.0, 1.0].into_iter().chain(copies).chain([2.0, f64::NAN]).collect();
        let rows = PointCloud::new(1, coordinates, NonFinite::Drop).unwrap();
        let mut mass = vec![0.0; 24];
        (mass[0], mass[1], mass[2], mass[23]) = (1.0, 1.0, 1.0, f64::NAN);
        let carriers = carriers(&rows, &mass).unwrap();
        assert_eq!(carriers[..2], [0, 1]);
        assert_eq!(carriers[2..23], [2; 21]);
        assert_eq!(carriers[23], 23);
        assert_eq!(first_occurrences(&rows, &mass).unwrap()[3], 3);
    }
}
