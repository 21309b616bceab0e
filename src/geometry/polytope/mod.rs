//! Convex cells around the origin of a tangent space, clipped by perpendicular bisectors: Voronoi cells in k = 1, 2
//! or 3 dimensions.
//!
//! A corner of the cell between the facets of k neighbors is the circumcenter of the Delaunay simplex that they form
//! with the origin, so that cells carry the Delaunay triangulation with them.

mod interval;
mod polygon;
mod polyhedron;

pub use interval::Interval;
pub use polygon::Polygon;
pub use polyhedron::Polyhedron;

/// Marks a side of the box that a cell starts from.
pub const BOX: u32 = u32::MAX;

/// A neighbor as it is seen in the tangent space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site<const K: usize> {
    /// Position in the tangent space.
    pub at: [f64; K],
    /// Index of the neighbor, or [`BOX`].
    pub neighbor: u32,
}

/// A corner of a cell with the neighbors whose bisectors meet there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner<const K: usize> {
    /// Position in the tangent space.
    pub at: [f64; K],
    /// The neighbors, in no particular order.
    pub sites: [Site<K>; K],
}

/// A cell as clipped so far; reused from point to point.
pub trait Polytope<const K: usize>: Default + Clone + Send {
    /// Starts over with a box of half-width `half`.
    fn reset(&mut self, half: f64);

    /// Keeps the side of the bisector between the origin and `site` on which the origin lies.
    fn clip(&mut self, site: Site<K>);

    /// Squared distance of the farthest corner.
    fn squared_radius(&self) -> f64;

    /// All corners.
    fn corners(&self) -> impl Iterator<Item = Corner<K>>;
}

impl<const K: usize> Corner<K> {
    /// Whether a side of the starting box meets here.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.sites.iter().any(|site| site.neighbor == BOX)
    }

    /// Volume of the Delaunay simplex of the origin and the neighbors.
    #[must_use]
    pub fn simplex_volume(&self) -> f64 {
        let factorial: f64 = (1..=K).map(|i| i as f64).product();
        determinant(&self.sites.map(|site| site.at)).abs() / factorial
    }

    /// The part of the cell between the origin and this corner, by orthoschemes.
    ///
    /// For every order `q₁ … q_k` of the neighbors, the origin, the foot on the facet of `q₁`, the foot on the ridge
    /// of `q₁` and `q₂`, and so on to the corner, span an orthoscheme with mutually orthogonal legs `x₁ … x_k`
    /// (signed): its volume is `x₁⋯x_k/k!`, its share of the facet of `q₁` is `x₂⋯x_k/(k−1)!`. Around a closed cell
    /// they add up to the cell; on a rim, where the simplex between two corners is missing, to the cell's part inside
    /// the triangulation, which is how the cotangent scheme ends a mesh.
    ///
    /// Calls `carry(q₁, facet/|q₁|)` for the shares of facets; returns the volume. None when the neighbors are
    /// linearly dependent.
    pub fn measure(&self, mut carry: impl FnMut(u32, f64)) -> Option<f64> {
        let mut volume = 0.0;
        for order in orders::<K>() {
            let mut legs = [0.0; K];
            let mut axes = [[0.0; K]; K];
            for step in 0..K {
                let mut axis = self.sites[order[step]].at;
                let length = norm(&axis);
                for earlier in &axes[..step] {
                    let along = dot(&axis, earlier);
                    for (x, e) in axis.iter_mut().zip(earlier) {
                        *x -= along * e;
                    }
                }
                let rest = norm(&axis);
                if rest <= 1e-12 * length {
                    return None;
                }
                axes[step] = axis.map(|x| x / rest);
                legs[step] = dot(&self.at, &axes[step]);
            }
            let facet: f64 = legs[1..].iter().enumerate().map(|(i, x)| x / (i + 1) as f64).product();
            let first = self.sites[order[0]];
            carry(first.neighbor, facet / norm(&first.at));
            volume += facet * legs[0] / K as f64;
        }
        Some(volume)
    }
}

/// All orders of `K` things.
fn orders<const K: usize>() -> impl Iterator<Item = [usize; K]> {
    let factorial: usize = (1..=K).product();
    (0..factorial).map(|mut code| {
        let mut left: [usize; K] = std::array::from_fn(|i| i);
        for i in 0..K {
            left.swap(i, i + code % (K - i));
            code /= K - i;
        }
        left
    })
}

/// Scalar product.
#[must_use]
pub fn dot<const K: usize>(a: &[f64; K], b: &[f64; K]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn norm<const K: usize>(a: &[f64; K]) -> f64 {
    dot(a, a).sqrt()
}

/// Determinant of a matrix of at most three rows.
#[must_use]
pub fn determinant<const K: usize>(rows: &[[f64; K]; K]) -> f64 {
    let r = |i: usize, j: usize| rows[i][j];
    match K {
        1 => r(0, 0),
        2 => r(0, 0) * r(1, 1) - r(0, 1) * r(1, 0),
        _ => {
            r(0, 0) * (r(1, 1) * r(2, 2) - r(1, 2) * r(2, 1))
                - r(0, 1) * (r(1, 0) * r(2, 2) - r(1, 2) * r(2, 0))
                + r(0, 2) * (r(1, 0) * r(2, 1) - r(1, 1) * r(2, 0))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Volume and facets over distances of the cell among `sites`.
    fn measured<const K: usize, P: Polytope<K>>(sites: &[[f64; K]]) -> (f64, Vec<f64>, f64) {
        let mut cell = P::default();
        cell.reset(100.0);
        for (neighbor, &at) in sites.iter().enumerate() {
            cell.clip(Site { at, neighbor: neighbor as u32 });
        }
        let (mut volume, mut simplices, mut conductance) = (0.0, 0.0, vec![0.0; sites.len()]);
        for corner in cell.corners() {
            assert!(!corner.is_open());
            volume += corner.measure(|q, share| conductance[q as usize] += share).unwrap();
            simplices += corner.simplex_volume();
        }
        (volume, conductance, simplices)
    }

    fn assert_near(found: &[f64], expected: &[f64]) {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?} {expected:?}");
    }

    #[test]
    fn on_a_line_the_cell_reaches_half_way_to_both_neighbors() {
        let (volume, conductance, simplices) = measured::<1, Interval>(&[[2.0], [-1.0], [5.0]]);
        assert_near(&[volume, simplices], &[1.5, 3.0]);
        assert_near(&conductance, &[0.5, 1.0, 0.0]);
    }

    #[test]
    fn on_a_rectangular_grid_the_cell_is_a_rectangle() {
        let (volume, conductance, _) =
            measured::<2, Polygon>(&[[1.0, 0.0], [0.0, 2.0], [-1.0, 0.0], [0.0, -2.0], [1.0, 2.0]]);
        assert_near(&[volume], &[2.0]);
        assert_near(&conductance, &[2.0, 0.5, 2.0, 0.5, 0.0]);
    }

    #[test]
    fn in_a_cubic_grid_the_cell_is_a_cube_and_diagonal_neighbors_change_nothing() {
        let mut sites = vec![
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
        ];
        sites.extend([[1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [-1.0, 0.0, 1.0], [0.0, -1.0, -1.0]]);
        let (volume, conductance, _) = measured::<3, Polyhedron>(&sites);
        assert_near(&[volume], &[1.0]);
        assert_near(&conductance, &[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn in_a_face_centered_lattice_the_cell_is_the_rhombic_dodecahedron() {
        // twelve neighbors at distance √2: volume 2, facets of area √2/2; found by geometry, not by this code
        let mut sites = Vec::new();
        for (a, b) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            sites.extend([[a, b, 0.0], [a, 0.0, b], [0.0, a, b]]);
        }
        let (volume, conductance, _) = measured::<3, Polyhedron>(&sites);
        assert_near(&[volume], &[2.0]);
        assert_near(&conductance, &[0.5; 12]);
    }

    #[test]
    fn among_scattered_neighbors_the_cell_is_made_of_the_pyramids_on_its_facets() {
        // height |q|/2 over every facet: Σ facet·|q|/2 = 3·volume
        let hash = |i: u64| ((i.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 33) as f64) / f64::from(1 << 30) - 1.0;
        let sites: Vec<[f64; 3]> =
            (0..60).map(|i| std::array::from_fn(|a| 3.0 * hash(3 * i + a as u64 + 7))).collect();
        let (volume, conductance, _) = measured::<3, Polyhedron>(&sites);
        let sum: f64 = sites.iter().zip(&conductance).map(|(q, c)| c * dot(q, q) / 2.0).sum();
        assert!(volume > 0.0 && (sum - 3.0 * volume).abs() < 1e-9 * volume, "{sum} {volume}");
    }
}
