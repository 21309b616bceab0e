//! Functions on the rows of an upload, made fit for the transform.

use std::collections::HashMap;

use crate::cloud::PointCloud;

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

/// For every row the first row at its position; `None` when no row repeats another.
///
/// Duplicates are those with mass 0; their representative is the first row of the same position.
#[must_use]
pub fn representatives(cloud: &PointCloud, mass: &[f64]) -> Option<Vec<u32>> {
    if !mass.contains(&0.0) {
        return None;
    }
    let mut first: HashMap<Vec<u64>, u32> = HashMap::new();
    // + 0.0 makes −0 and 0 one position
    let key = |row: usize| cloud.point(row).iter().map(|x| (x + 0.0).to_bits()).collect();
    Some((0..cloud.len()).map(|row| *first.entry(key(row)).or_insert(row as u32)).collect())
}

/// Gives every row the value of its representative.
pub fn represent(values: &mut [f64], representatives: &[u32]) {
    for (row, &representative) in representatives.iter().enumerate() {
        values[row] = values[representative as usize];
    }
}
