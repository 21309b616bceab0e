//! Delaunay triangulations of the few points of one tangent space.

use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};

use super::polytope::{Polyhedron, Polytope, Site, dot};

/// Cells of the dual start from a box this many times the extent of the points: corners beyond belong to simplices so
/// flat that they carry no volume.
const BOX_FACTOR: f64 = 1e4;

/// Sites that the first shell around a site holds, about.
const FIRST_SHELL: usize = 48;

/// Shear that decides which diagonal a square gets. On exact grids four points lie on every circle; rounding would choose
/// at random, and the volumes around sites would scatter by a third.
const SHEAR: f64 = 1e-9;

/// Volume of all Delaunay simplices around every site, counting those simplices of which all corners satisfy `counts`.
///
/// K = 1, 2 or 3; coinciding sites share the simplices of one of them.
pub fn simplices_around<const K: usize>(
    sites: &[[f64; K]],
    counts: impl Fn(usize) -> bool,
    volume: &mut Vec<f64>,
) {
    volume.clear();
    volume.resize(sites.len(), 0.0);
    match K {
        1 => intervals(sites, counts, volume),
        2 => triangles(sites, counts, volume),
        _ => tetrahedra(sites, counts, volume),
    }
}

fn intervals<const K: usize>(sites: &[[f64; K]], counts: impl Fn(usize) -> bool, volume: &mut [f64]) {
    let mut order: Vec<usize> = (0..sites.len()).collect();
    order.sort_by(|&a, &b| sites[a][0].total_cmp(&sites[b][0]).then(a.cmp(&b)));
    for pair in order.windows(2).filter(|pair| pair.iter().all(|&i| counts(i))) {
        let length = sites[pair[1]][0] - sites[pair[0]][0];
        for &i in pair {
            volume[i] += length;
        }
    }
}

/// A site that knows its place in the list.
struct Vertex {
    at: Point2<f64>,
    index: usize,
}

impl HasPosition for Vertex {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        self.at
    }
}

fn triangles<const K: usize>(sites: &[[f64; K]], counts: impl Fn(usize) -> bool, volume: &mut [f64]) {
    // in units of the extent: spade refuses coordinates below 2^-142, and so small ones are rounding here
    let extent = sites.iter().flatten().fold(0.0_f64, |extent, x| extent.max(x.abs()));
    let scaled = |x: f64| if x.abs() > f64::EPSILON * extent { x / extent } else { 0.0 };
    let vertex = |(index, at): (usize, &[f64; K])| {
        let (x, y) = (scaled(at[0]), scaled(at[1]));
        // areas do not change
        Vertex { at: Point2::new(x + SHEAR * y, y), index }
    };
    let vertices = sites.iter().enumerate().map(vertex).collect();
    // coordinates between -1 and 1 are all accepted
    let Ok(delaunay) = DelaunayTriangulation::<Vertex>::bulk_load(vertices) else { return };
    for face in delaunay.inner_faces() {
        let corners = face.vertices().map(|vertex| vertex.data().index);
        if corners.iter().all(|&i| counts(i)) {
            for i in corners {
                volume[i] += face.area() * extent * extent;
            }
        }
    }
}

/// The corners of a site's Voronoi cell are dual to the tetrahedra around it.
fn tetrahedra<const K: usize>(sites: &[[f64; K]], counts: impl Fn(usize) -> bool, volume: &mut [f64]) {
    let at = |i: usize| -> [f64; 3] { std::array::from_fn(|axis| sites[i][axis]) };
    let extent = (0..sites.len()).map(|i| dot(&at(i), &at(i))).fold(0.0, f64::max).sqrt();
    let mut along: Vec<u32> = (0..sites.len() as u32).collect();
    along.sort_unstable_by(|&a, &b| at(a as usize)[0].total_cmp(&at(b as usize)[0]).then(a.cmp(&b)));
    let first_reach = extent * (FIRST_SHELL as f64 / sites.len() as f64).cbrt();
    let mut cell = Polyhedron::default();
    let mut others: Vec<(f64, u32)> = Vec::with_capacity(sites.len());
    for i in (0..sites.len()).filter(|&i| counts(i)) {
        let offset = |j: u32| -> [f64; 3] { std::array::from_fn(|axis| at(j as usize)[axis] - at(i)[axis]) };
        cell.reset(BOX_FACTOR * extent);
        // shell by shell, nearest first: a few are enough as a rule, and the others need not be sorted
        let (mut inner, mut reach) = (-1.0, first_reach);
        while inner < 2.0 * extent && 0.25 * inner * inner.abs() <= cell.squared_radius() {
            let x = |&j: &u32| at(j as usize)[0] - at(i)[0];
            let window = along.partition_point(|j| x(j) < -reach)..along.partition_point(|j| x(j) <= reach);
            let squared = |&j: &u32| (dot(&offset(j), &offset(j)), j);
            let shell = |&(squared, j): &(f64, u32)| {
                j as usize != i && squared > inner * inner.abs() && squared <= reach * reach
            };
            others.clear();
            others.extend(along[window].iter().map(squared).filter(shell));
            others.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            for &(squared, neighbor) in &others {
                if squared > 4.0 * cell.squared_radius() {
                    break;
                }
                cell.clip(Site { at: offset(neighbor), neighbor });
            }
            (inner, reach) = (reach, 1.5 * reach);
        }
        volume[i] = cell
            .corners()
            .filter(|corner| {
                !corner.is_open() && corner.sites.iter().all(|site| counts(site.neighbor as usize))
            })
            .map(|corner| corner.simplex_volume())
            .sum();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn around<const K: usize>(sites: &[[f64; K]], counts: impl Fn(usize) -> bool) -> Vec<f64> {
        let mut volume = Vec::new();
        simplices_around(sites, counts, &mut volume);
        volume
    }

    /// Numbers in [-1, 1) from a hash.
    fn scattered<const K: usize>(count: u64) -> Vec<[f64; K]> {
        let hash = |i: u64| {
            let mut z = i.wrapping_mul(0x9E37_79B9_7F4A_7C15);
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            ((z ^ (z >> 27)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        (0..count).map(|i| std::array::from_fn(|axis| hash(8 * i + axis as u64 + 1))).collect()
    }

    #[test]
    fn on_a_line_a_point_has_the_stretches_to_both_neighbours() {
        assert_eq!(around(&[[0.0], [3.0], [1.0], [-2.0]], |_| true), [3.0, 2.0, 3.0, 2.0]);
        assert_eq!(around(&[[0.0], [3.0], [1.0], [-2.0]], |i| i != 3), [1.0, 2.0, 3.0, 0.0]);
    }

    #[test]
    fn around_the_middle_of_a_square_lie_four_triangles() {
        let sites = [[0.0, 0.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];
        let near = |found: Vec<f64>, expected: [f64; 5]| {
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-8), "{found:?} {expected:?}");
        };
        near(around(&sites, |_| true), [4.0, 2.0, 2.0, 2.0, 2.0]);
        near(around(&sites, |i| i != 1), [2.0, 0.0, 1.0, 2.0, 1.0]);
    }

    #[test]
    fn on_a_grid_turned_by_any_angle_every_inner_point_has_six_triangles() {
        for turn in [0.0_f64, 0.3, 1.0] {
            let (sine, cosine) = turn.sin_cos();
            let node = |k: usize| {
                let (x, y) = ((k % 7) as f64 - 3.0, (k / 7) as f64 - 3.0);
                [cosine * x - sine * y, sine * x + cosine * y]
            };
            let sites: Vec<[f64; 2]> = (0..49).map(node).collect();
            let volume = around(&sites, |_| true);
            let inner = (0..49).filter(|k| (1..6).contains(&(k % 7)) && (1..6).contains(&(k / 7)));
            for k in inner {
                assert!((volume[k] - 3.0).abs() < 1e-7, "turned by {turn}: {}", volume[k]);
            }
        }
    }

    #[test]
    fn simplices_fill_the_convex_hull_of_scattered_points() {
        // a box's corners hold the hull; every simplex counts for each of its K + 1 corners
        let mut plane = scattered::<2>(60);
        plane.extend([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]);
        let area: f64 = around(&plane, |_| true).iter().sum::<f64>() / 3.0;
        assert!((area - 4.0).abs() < 1e-12, "{area}");
        let mut space = scattered::<3>(60);
        for corner in 0..8 {
            space.push(std::array::from_fn(|axis| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 }));
        }
        let volume: f64 = around(&space, |_| true).iter().sum::<f64>() / 4.0;
        // but for slivers on the hull, whose circumcentres are beyond the box or lost in rounding
        assert!(volume < 8.0 + 1e-9 && volume > 7.9, "{volume}");
    }
}
