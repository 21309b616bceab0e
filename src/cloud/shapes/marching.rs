//! Mesh of the two-hole torus: marching tetrahedra, nodes moved onto the surface.

use std::collections::HashMap;

use super::Sample;
use super::double_torus::{gradient, half_extent, value};

/// Coarser grids do not resolve the tube.
pub(super) const POINTS_MIN: usize = 2000;

/// Tries to meet the wanted number of nodes.
const ROUNDS: usize = 6;

/// Nodes and faces of the mesh whose number of nodes is nearest to `points` among a few cell sizes.
pub(super) fn double_torus(points: usize) -> Sample {
    let mut cells = 40.0;
    let mut best: Option<(usize, Grid)> = None;
    for _ in 0..ROUNDS {
        let grid = Grid::new(cells);
        let nodes = grid.crossed_edges();
        let off = nodes.abs_diff(points);
        if best.as_ref().is_none_or(|(best, _)| off < *best) {
            best = Some((off, grid));
        }
        // The number of nodes grows with the square of the number of cells.
        cells *= (points as f64 / nodes as f64).sqrt();
    }
    best.map(|(_, grid)| grid.mesh()).unwrap_or_default()
}

/// The six tetrahedra around the long diagonal of a cube, by paths of axes from corner 0 to corner 7
/// (Kuhn, 1960): neighboring cubes cut their common face along the same diagonal.
const PATHS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// Values of the function on the corners of cubes around the surface.
struct Grid {
    side: f64,
    origin: [f64; 3],
    /// Corners along each axis.
    corners: [usize; 3],
    values: Vec<f64>,
}

impl Grid {
    /// A grid with `cells` cells along x.
    fn new(cells: f64) -> Self {
        let half = half_extent();
        let side = 2.0 * half[0] / cells;
        // Off the symmetry planes, so that no corner lies on the surface exactly.
        let corners = half.map(|extent| (2.0 * extent / side).ceil() as usize + 3);
        let origin = half.map(|extent| -extent - 1.37 * side);
        let mut grid = Self { side, origin, corners, values: Vec::new() };
        let count = corners.iter().product();
        grid.values = (0..count).map(|corner| value(grid.position(corner))).collect();
        grid
    }

    fn position(&self, corner: usize) -> [f64; 3] {
        let [nx, ny, _] = self.corners;
        let index = [corner % nx, corner / nx % ny, corner / (nx * ny)];
        [0, 1, 2].map(|axis| self.origin[axis] + self.side * index[axis] as f64)
    }

    /// Distance of numbers between neighbors along each axis.
    fn strides(&self) -> [usize; 3] {
        [1, self.corners[0], self.corners[0] * self.corners[1]]
    }

    /// First corners of all cubes.
    fn cubes(&self) -> impl Iterator<Item = usize> {
        let [nx, ny, nz] = self.corners;
        (0..nz - 1)
            .flat_map(move |k| (0..ny - 1).flat_map(move |j| (0..nx - 1).map(move |i| (k * ny + j) * nx + i)))
    }

    /// Number of edges that cross the surface: each carries a node.
    fn crossed_edges(&self) -> usize {
        let [x, y, z] = self.strides();
        let directions = [x, y, z, x + y, y + z, x + z, x + y + z];
        let is_crossed = |a: usize, b: usize| {
            self.values.get(b).is_some_and(|value| (self.values[a] < 0.0) != (*value < 0.0))
        };
        (0..self.values.len()).map(|a| directions.iter().filter(|&&d| is_crossed(a, a + d)).count()).sum()
    }

    fn mesh(&self) -> Sample {
        let strides = self.strides();
        let mut mesh = Mesh { grid: self, nodes: HashMap::new(), coordinates: Vec::new(), faces: Vec::new() };
        for cube in self.cubes() {
            for path in PATHS {
                let mut corners = [cube; 4];
                for (step, &axis) in path.iter().enumerate() {
                    corners[step + 1] = corners[step] + strides[axis];
                }
                mesh.tetrahedron(corners);
            }
        }
        (mesh.coordinates, mesh.faces)
    }
}

struct Mesh<'a> {
    grid: &'a Grid,
    /// Node on every crossed edge.
    nodes: HashMap<[usize; 2], u32>,
    coordinates: Vec<f64>,
    faces: Vec<[u32; 3]>,
}

impl Mesh<'_> {
    /// One triangle cuts a corner off; two cut two corners from the other two.
    fn tetrahedron(&mut self, corners: [usize; 4]) {
        let (inside, outside): (Vec<usize>, Vec<usize>) =
            corners.iter().partition(|&&c| self.grid.values[c] < 0.0);
        match (&inside[..], &outside[..]) {
            (&[a], &[b, c, d]) | (&[b, c, d], &[a]) => {
                let triangle = [self.node(a, b), self.node(a, c), self.node(a, d)];
                self.triangle(triangle);
            }
            (&[a, b], &[c, d]) => {
                let [ac, ad, bd, bc] = [self.node(a, c), self.node(a, d), self.node(b, d), self.node(b, c)];
                self.triangle([ac, ad, bd]);
                self.triangle([ac, bd, bc]);
            }
            _ => {}
        }
    }

    /// Adds a triangle with its normal outward.
    fn triangle(&mut self, [a, b, c]: [u32; 3]) {
        let point = |node: u32| {
            let start = 3 * node as usize;
            [self.coordinates[start], self.coordinates[start + 1], self.coordinates[start + 2]]
        };
        let (p, q, r) = (point(a), point(b), point(c));
        let (u, v) = ([0, 1, 2].map(|i| q[i] - p[i]), [0, 1, 2].map(|i| r[i] - p[i]));
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let outward: f64 = normal.iter().zip(gradient(p)).map(|(n, g)| n * g).sum();
        self.faces.push(if outward < 0.0 { [a, c, b] } else { [a, b, c] });
    }

    /// The node on an edge: on the chord first, then by Newton's steps along the gradient onto the surface.
    fn node(&mut self, a: usize, b: usize) -> u32 {
        let key = [a.min(b), a.max(b)];
        if let Some(&node) = self.nodes.get(&key) {
            return node;
        }
        let [from, to] = key.map(|corner| (self.grid.position(corner), self.grid.values[corner]));
        let share = from.1 / (from.1 - to.1);
        let mut point = [0, 1, 2].map(|i| from.0[i] + share * (to.0[i] - from.0[i]));
        for _ in 0..8 {
            let slope = gradient(point);
            let step = value(point) / slope.iter().map(|g| g * g).sum::<f64>();
            for axis in 0..3 {
                point[axis] -= step * slope[axis];
            }
        }
        let node = self.nodes.len() as u32;
        self.nodes.insert(key, node);
        self.coordinates.extend(point);
        node
    }
}
