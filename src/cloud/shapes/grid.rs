//! Parameter grids with faces.

use super::Sample;
use super::chart::{Chart, Gluing, u_of_colatitude};

/// Fewer points do not close around every shape.
pub(super) const POINTS_MIN: usize = 27;

/// Nodes and faces of the grid whose number of nodes is near `points`, with roughly square cells.
pub(super) fn nodes(chart: Chart, points: usize, dimension: usize) -> Sample {
    match chart.gluing() {
        Gluing::Torus3 => (cube(chart, points, dimension), Vec::new()),
        Gluing::Globe => globe(chart, points),
        gluing => quilt(chart, gluing, points, dimension),
    }
}

fn cube(chart: Chart, points: usize, dimension: usize) -> Vec<f64> {
    let side = (points as f64).cbrt().round().max(3.0) as usize;
    let at = |i: usize| i as f64 / side as f64;
    let mut coordinates = Vec::with_capacity(side.pow(3) * dimension);
    for node in 0..side.pow(3) {
        let parameter = [at(node / (side * side)), at(node / side % side), at(node % side)];
        coordinates.extend_from_slice(&chart.place(parameter).point[..dimension]);
    }
    coordinates
}

/// Rows and columns of about `points` nodes.
fn shape(chart: Chart, points: usize) -> (usize, usize) {
    let rows = (points as f64 * chart.aspect()).sqrt().round().max(3.0);
    let columns = (points as f64 / rows).round().max(3.0);
    (rows as usize, columns as usize)
}

/// Parallels and meridians of a sphere, with one node at each pole.
fn globe(chart: Chart, points: usize) -> Sample {
    let (rows, columns) = shape(chart, points.saturating_sub(2));
    let mut coordinates = Vec::with_capacity(3 * (rows * columns + 2));
    for row in 1..=rows {
        let u = u_of_colatitude(row as f64 / (rows + 1) as f64);
        for column in 0..columns {
            coordinates.extend_from_slice(&chart.place([u, column as f64 / columns as f64, 0.0]).point[..3]);
        }
    }
    for pole in [0.0, 1.0] {
        coordinates.extend_from_slice(&chart.place([pole, 0.0, 0.0]).point[..3]);
    }
    let mut faces = cells(rows, columns, false, true);
    let (north, south) = ((rows * columns) as u32, (rows * columns + 1) as u32);
    let last = ((rows - 1) * columns) as u32;
    for column in 0..columns as u32 {
        let next = (column + 1) % columns as u32;
        faces.push([north, column, next]);
        faces.push([south, last + next, last + column]);
    }
    (coordinates, faces)
}

/// Rows and columns, glued along their sides or not.
fn quilt(chart: Chart, gluing: Gluing, points: usize, dimension: usize) -> Sample {
    let (rows, columns) = shape(chart, points);
    let (wraps_rows, wraps_columns) = (gluing == Gluing::Torus, gluing != Gluing::Sheet);
    let share = |i: usize, count: usize, wraps: bool| i as f64 / if wraps { count } else { count - 1 } as f64;
    let mut coordinates = Vec::with_capacity(rows * columns * dimension);
    for row in 0..rows {
        for column in 0..columns {
            let parameter = [share(row, rows, wraps_rows), share(column, columns, wraps_columns), 0.0];
            coordinates.extend_from_slice(&chart.place(parameter).point[..dimension]);
        }
    }
    (coordinates, cells(rows, columns, wraps_rows, wraps_columns))
}

/// Two triangles per cell of a grid whose nodes are numbered row by row.
fn cells(rows: usize, columns: usize, wraps_rows: bool, wraps_columns: bool) -> Vec<[u32; 3]> {
    let mut faces = Vec::with_capacity(2 * rows * columns);
    for row in 0..rows - usize::from(!wraps_rows) {
        for column in 0..columns - usize::from(!wraps_columns) {
            let node = |i: usize, j: usize| ((row + i) % rows * columns + (column + j) % columns) as u32;
            faces.push([node(0, 0), node(1, 0), node(1, 1)]);
            faces.push([node(0, 0), node(1, 1), node(0, 1)]);
        }
    }
    faces
}
