//! Delaunay triangulations of the few points of one tangent space.

mod tetrahedra;

use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};

use self::tetrahedra::Tetrahedra;
use super::polytope::{determinant, dot};

/// Shear that decides which diagonal a square gets, and a cube. On exact grids four points lie on every circle; rounding
/// would choose at random, and the volumes around sites would scatter by a third. In space it shears y and z as well, by
/// other shares, so that no two diagonals are alike.
const SHEAR: f64 = 1e-9;

/// Tetrahedra with less than this share of the volume that their sides could span are too flat for a center.
const FLAT: f64 = 1e-6;

/// Rounding of the centers and radii of others, more than ever occurs.
const SLACK: f64 = 1e-6;

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

/// Coordinates in units of the extent: spade refuses those below 2^-142, and predicates underflow; so small ones are
/// rounding here.
struct Unit {
    extent: f64,
}

impl Unit {
    fn of<const K: usize>(sites: &[[f64; K]]) -> Self {
        Self { extent: sites.iter().flatten().fold(0.0_f64, |extent, x| extent.max(x.abs())) }
    }

    fn scaled(&self, x: f64) -> f64 {
        if x.abs() > f64::EPSILON * self.extent { x / self.extent } else { 0.0 }
    }
}

fn triangles<const K: usize>(sites: &[[f64; K]], counts: impl Fn(usize) -> bool, volume: &mut [f64]) {
    let unit = Unit::of(sites);
    let vertex = |(index, at): (usize, &[f64; K])| {
        let (x, y) = (unit.scaled(at[0]), unit.scaled(at[1]));
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
                volume[i] += face.area() * unit.extent * unit.extent;
            }
        }
    }
}

/// A simplex of sites that all count is one of the triangulation of these alone, with none of the others inside of its
/// ball. Within half of the radius there are an eighth of the sites.
fn tetrahedra<const K: usize>(sites: &[[f64; K]], counts: impl Fn(usize) -> bool, volume: &mut [f64]) {
    let unit = Unit::of(sites);
    let at = |i: usize| -> [f64; 3] {
        let [x, y, z] = std::array::from_fn(|axis| unit.scaled(sites[i][axis]));
        [x + SHEAR * y + 0.6 * SHEAR * z, y + 0.8 * SHEAR * z, z]
    };
    let (inner, outer): (Vec<usize>, Vec<usize>) = (0..sites.len()).partition(|&i| counts(i));
    let delaunay = Tetrahedra::of(inner.iter().map(|&i| at(i)));
    // by their distance from the origin, of which a ball reaches a part only
    let mut others: Vec<(f64, [f64; 3])> =
        outer.into_iter().map(|i| (dot(&at(i), &at(i)).sqrt(), at(i))).collect();
    others.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    for corners in delaunay.corners() {
        let indices = corners.map(|corner| inner[corner as usize]);
        let holds = |site: &[f64; 3]| delaunay.ball_holds(corners, *site);
        let is_crossed = match ball_around(indices.map(at)) {
            Some((center, radius)) => {
                let reach = dot(&center, &center).sqrt() + radius;
                let is_near = |site: &[f64; 3]| {
                    let offset = difference(site, &center);
                    dot(&offset, &offset) <= radius * radius
                };
                let reached = others.iter().take_while(|other| other.0 <= reach);
                reached.into_iter().any(|(_, site)| is_near(site) && holds(site))
            }
            None => others.iter().any(|(_, site)| holds(site)),
        };
        if !is_crossed {
            let [origin, ends @ ..] = indices.map(|i| std::array::from_fn(|axis| sites[i][axis]));
            let share = determinant(&ends.map(|end| difference(&end, &origin))).abs() / 6.0;
            for i in indices {
                volume[i] += share;
            }
        }
    }
}

/// Center and radius, a little too large, of the ball around a tetrahedron; none when it is all but flat.
fn ball_around([origin, ends @ ..]: [[f64; 3]; 4]) -> Option<([f64; 3], f64)> {
    let rows = ends.map(|end| difference(&end, &origin));
    let whole = determinant(&rows);
    let squares = rows.map(|row| dot(&row, &row));
    if whole * whole <= FLAT * FLAT * squares.iter().product::<f64>() {
        return None;
    }
    // where the bisectors of the three sides meet: ∑ |u|² (v × w) / 2 det(u, v, w)
    let offset: [f64; 3] = std::array::from_fn(|axis| {
        let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
        let part = |i: usize| {
            let (v, w) = (rows[(i + 1) % 3], rows[(i + 2) % 3]);
            squares[i] * (v[next] * w[last] - v[last] * w[next])
        };
        (part(0) + part(1) + part(2)) / (2.0 * whole)
    });
    let center = std::array::from_fn(|axis| origin[axis] + offset[axis]);
    Some((center, dot(&offset, &offset).sqrt() * (1.0 + SLACK)))
}

fn difference(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

#[cfg(test)]
mod tests {
    use super::super::polytope::{Corner, Polyhedron, Polytope, Site};
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
    fn on_a_line_a_point_has_the_stretches_to_both_neighbors() {
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
        assert!((volume - 8.0).abs() < 1e-12, "{volume}");
    }

    /// What the corners of Voronoi cells, which are dual to tetrahedra, say.
    fn by_cells(sites: &[[f64; 3]], counts: impl Fn(usize) -> bool) -> Vec<f64> {
        let around = |i: usize| {
            let mut cell = Polyhedron::default();
            cell.reset(1e4);
            for (neighbor, site) in sites.iter().enumerate() {
                cell.clip(Site { at: difference(site, &sites[i]), neighbor: neighbor as u32 });
            }
            let all_count = |corner: &Corner<3>| {
                !corner.is_open() && corner.sites.iter().all(|site| counts(site.neighbor as usize))
            };
            cell.corners().filter(all_count).map(|corner| corner.simplex_volume()).sum()
        };
        (0..sites.len()).map(|i| if counts(i) { around(i) } else { 0.0 }).collect()
    }

    #[test]
    fn tetrahedra_are_those_of_the_voronoi_cells() {
        let sites = scattered::<3>(500);
        let inside = |i: usize| dot(&sites[i], &sites[i]) < 0.36;
        let (found, expected) = (around(&sites, inside), by_cells(&sites, inside));
        assert!(expected.iter().filter(|&&volume| volume > 0.0).count() > 40);
        for (i, (a, b)) in found.iter().zip(&expected).enumerate() {
            assert!((a - b).abs() < 1e-12, "{i}: {a} {b}");
        }
    }

    #[test]
    fn on_a_cubic_grid_turned_by_any_angle_every_inner_point_has_the_same_tetrahedra() {
        // of whichever way a cube is cut, four cubes' worth of corners belong to each point: 4 × volume 1
        for turn in [0.0_f64, 0.3, 1.0] {
            let (sine, cosine) = turn.sin_cos();
            let node = |k: usize| {
                let [x, y, z] = [k % 6, k / 6 % 6, k / 36].map(|i| i as f64 - 2.5);
                let (x, y) = (cosine * x - sine * y, sine * x + cosine * y);
                [x, cosine * y - sine * z, sine * y + cosine * z]
            };
            let sites: Vec<[f64; 3]> = (0..216).map(node).collect();
            let volume = around(&sites, |_| true);
            let is_inner = |k: &usize| [k % 6, k / 6 % 6, k / 36].iter().all(|i| (1..5).contains(i));
            for k in (0..216).filter(is_inner) {
                assert!((volume[k] - 4.0).abs() < 1e-6, "turned by {turn}: {}", volume[k]);
            }
        }
    }

    #[test]
    fn points_of_a_plane_or_at_one_place_have_no_tetrahedra() {
        let plane: Vec<[f64; 3]> = scattered::<2>(50).into_iter().map(|[x, y]| [x, y, x + y]).collect();
        for sites in [plane, vec![[0.5; 3]; 20], vec![[0.0; 3]], Vec::new()] {
            assert!(around(&sites, |_| true).iter().all(|volume| volume.abs() < 1e-15));
        }
        // coinciding points share
        let mut sites = scattered::<3>(30);
        let once: f64 = around(&sites, |_| true).iter().sum();
        sites.extend(sites.clone());
        let twice: f64 = around(&sites, |_| true).iter().sum();
        assert!((once - twice).abs() < 1e-12);
    }
}
