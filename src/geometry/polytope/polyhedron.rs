//! k = 3: a convex polyhedron, kept as the planes of its facets and, dually, a triangle of planes for every corner
//! (Ray, Sokolov, Lefebvre, Lévy: Meshless Voronoi on the GPU, 2018).

use super::{BOX, Corner, Polytope, Site, determinant, dot};

/// Corners this much (relative to the squared distance of the neighbor) beyond a bisector are on it: exact grids
/// have many planes through one corner.
const ON_PLANE: f64 = 1e-12;

#[derive(Debug, Clone, Copy)]
struct Vertex {
    at: [f64; 3],
    planes: [u32; 3],
}

/// Planes and corners.
#[derive(Debug, Clone, Default)]
pub struct Polyhedron {
    sites: Vec<Site<3>>,
    vertices: Vec<Vertex>,
    removed: Vec<Vertex>,
    /// Edges of the hole that the removed corners leave, each as (plane, next plane), counter-clockwise.
    rim: Vec<(u32, u32)>,
}

impl Polyhedron {
    /// The corner where three bisectors meet; planes in the order that turns counter-clockwise seen from outside.
    fn vertex(&self, planes: [u32; 3]) -> Option<Vertex> {
        let rows = planes.map(|plane| self.sites[plane as usize].at);
        let whole = determinant(&rows);
        let size: f64 = rows.iter().map(|row| dot(row, row).sqrt()).product();
        if whole.abs() <= 1e-14 * size {
            return None;
        }
        let halves = rows.map(|row| 0.5 * dot(&row, &row));
        // Cramer's rule, column by column
        let at = std::array::from_fn(|column| {
            let mut replaced = rows;
            for (row, half) in replaced.iter_mut().zip(halves) {
                row[column] = half;
            }
            determinant(&replaced) / whole
        });
        Some(Vertex { at, planes })
    }

    /// The edges of removed corners whose other side is kept. An edge between two corners is shared by two planes,
    /// which the two corners name in opposite order.
    fn find_rim(&mut self) {
        self.rim.clear();
        for vertex in &self.removed {
            let [a, b, c] = vertex.planes;
            for edge in [(a, b), (b, c), (c, a)] {
                match self.rim.iter().position(|&other| other == (edge.1, edge.0)) {
                    Some(inner) => {
                        self.rim.swap_remove(inner);
                    }
                    None => self.rim.push(edge),
                }
            }
        }
    }

    /// Whether the rim is one closed loop: every plane entered and left once, and all reached from the first.
    fn rim_is_a_loop(&self) -> bool {
        let Some(&(start, mut at)) = self.rim.first() else { return false };
        for _ in 1..self.rim.len() {
            if at == start {
                return false;
            }
            match self.rim.iter().find(|&&(from, _)| from == at) {
                Some(&(_, to)) => at = to,
                None => return false,
            }
        }
        at == start
    }
}

impl Polytope<3> for Polyhedron {
    fn reset(&mut self, half: f64) {
        self.sites.clear();
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let mut at = [0.0; 3];
                at[axis] = 2.0 * sign * half;
                self.sites.push(Site { at, neighbor: BOX });
            }
        }
        self.vertices.clear();
        for corner in 0..8_u32 {
            let sign = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
            let at = sign.map(|negative| if negative == 1 { -half } else { half });
            let [x, y, z] = [sign[0], 2 + sign[1], 4 + sign[2]];
            let planes = if sign.iter().sum::<u32>() % 2 == 0 { [x, y, z] } else { [x, z, y] };
            self.vertices.push(Vertex { at, planes });
        }
    }

    fn clip(&mut self, site: Site<3>) {
        let square = dot(&site.at, &site.at);
        let beyond = |vertex: &Vertex| dot(&vertex.at, &site.at) - 0.5 * square > ON_PLANE * square;
        if square == 0.0 || !self.vertices.iter().any(beyond) {
            return;
        }
        self.removed.clear();
        self.removed.extend(self.vertices.iter().copied().filter(beyond));
        self.find_rim();
        let plane = self.sites.len() as u32;
        self.sites.push(site);
        let added: Option<Vec<Vertex>> = self
            .rim_is_a_loop()
            .then(|| self.rim.iter().map(|&(a, b)| self.vertex([a, b, plane])).collect())
            .flatten();
        // planes that nearly meet in a line can confuse which corners go: such a plane cuts off nothing that counts
        let Some(added) = added else {
            self.sites.pop();
            return;
        };
        self.vertices.retain(|vertex| !beyond(vertex));
        self.vertices.extend(added);
    }

    fn squared_radius(&self) -> f64 {
        self.vertices.iter().map(|vertex| dot(&vertex.at, &vertex.at)).fold(0.0, f64::max)
    }

    fn corners(&self) -> impl Iterator<Item = Corner<3>> {
        self.vertices.iter().map(|vertex| Corner {
            at: vertex.at,
            sites: vertex.planes.map(|plane| self.sites[plane as usize]),
        })
    }
}
