//! Whether a filter leaves the shape of a cloud: one that drops the lowest modes, or all but a few, does not.

use nalgebra::DMatrix;

/// Of the cloud's largest standard deviation; directions with less are none.
const DIRECTION_MIN: f64 = 1e-3;
/// Of it, too: clouds with less have shrunk to what is left at their middle.
const EXTENT_MIN: f64 = 0.1;

/// What a filter leaves of a cloud, if that is not its shape: a sentence for the caller. Columns are coordinates, before and
/// after; rows that are not finite do not count.
#[must_use]
pub fn collapse<C: AsRef<[f64]>>(before: &[C], after: &[Vec<f64>]) -> Option<String> {
    let (before, after) = (deviations(before), deviations(after));
    let scale = before.iter().copied().fold(0.0, f64::max);
    let directions = |all: &[f64]| all.iter().filter(|&&x| x > DIRECTION_MIN * scale).count();
    let left = after.iter().copied().fold(0.0, f64::max) / scale;
    let place = match directions(&after) {
        left if left >= directions(&before) => None,
        0 => Some("at one place".to_owned()),
        1 => Some("on a line".to_owned()),
        2 => Some("in a plane".to_owned()),
        more => Some(format!("in {more} dimensions")),
    };
    match place {
        Some(place) => Some(format!(
            "the filter leaves the points {place}: the lowest modes carry the shape of a cloud; keep more of them, or what lies \
             `outside`"
        )),
        None if left < EXTENT_MIN => Some(format!(
            "the filter leaves {:.2} % of the extent of the cloud: the lowest modes carry its shape; keep them, or filter a `field`",
            100.0 * left
        )),
        None => None,
    }
}

/// Standard deviations along the principal directions.
fn deviations<C: AsRef<[f64]>>(columns: &[C]) -> Vec<f64> {
    let columns: Vec<&[f64]> = columns.iter().map(AsRef::as_ref).collect();
    let rows = columns.first().map_or(0, |column| column.len());
    let finite: Vec<usize> =
        (0..rows).filter(|&row| columns.iter().all(|column| column[row].is_finite())).collect();
    let count = finite.len().max(1) as f64;
    let mean: Vec<f64> =
        columns.iter().map(|column| finite.iter().map(|&row| column[row]).sum::<f64>() / count).collect();
    let moment = |i: usize, j: usize| {
        let product = |&row: &usize| (columns[i][row] - mean[i]) * (columns[j][row] - mean[j]);
        finite.iter().map(product).sum::<f64>() / count
    };
    let moments = DMatrix::from_fn(columns.len(), columns.len(), moment);
    moments.symmetric_eigenvalues().iter().map(|variance| variance.max(0.0).sqrt()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on the edges of a box of 4 × 2 × 1 far from the origin.
    fn corners(by: f64, flat: [f64; 3]) -> Vec<Vec<f64>> {
        let size = [4.0, 2.0, 1.0];
        let value = |corner: usize, axis: usize| {
            1e6 + by * flat[axis] * size[axis] * f64::from((corner >> axis) as u8 & 1)
        };
        (0..3).map(|axis| (0..8).map(|corner| value(corner, axis)).collect()).collect()
    }

    #[test]
    fn a_cloud_that_is_less_than_it_was_is_told() {
        let before = corners(1.0, [1.0; 3]);
        assert_eq!(collapse(&before, &corners(0.5, [1.0, 1.0, 0.5])), None);
        for (after, told) in [
            (corners(0.0, [0.0; 3]), "at one place"),
            (corners(1.0, [0.0, 1.0, 0.0]), "on a line"),
            (corners(1.0, [1.0, 1.0, 0.0]), "in a plane"),
            (corners(0.02, [1.0; 3]), "2.00 % of the extent"),
        ] {
            let found = collapse(&before, &after).unwrap();
            assert!(found.contains(told), "{found}");
        }
    }

    #[test]
    fn a_plane_may_stay_one_and_rows_without_a_position_do_not_count() {
        let mut before = corners(1.0, [1.0, 1.0, 0.0]);
        before[1][3] = f64::NAN;
        assert_eq!(collapse(&before, &before), None);
    }
}
