//! k = 2: a convex polygon.

use super::{BOX, Corner, Polytope, Site, dot};

/// A corner and the neighbour whose bisector carries the edge that leaves it, counter-clockwise.
#[derive(Debug, Clone, Copy)]
struct Vertex {
    at: [f64; 2],
    edge: Site<2>,
}

/// Corners, counter-clockwise.
#[derive(Debug, Clone, Default)]
pub struct Polygon {
    vertices: Vec<Vertex>,
    next: Vec<Vertex>,
}

impl Polytope<2> for Polygon {
    fn reset(&mut self, half: f64) {
        let sides = [
            ([1.0, 1.0], [0.0, 1.0]),
            ([-1.0, 1.0], [-1.0, 0.0]),
            ([-1.0, -1.0], [0.0, -1.0]),
            ([1.0, -1.0], [1.0, 0.0]),
        ];
        self.vertices.clear();
        self.vertices.extend(sides.map(|(at, normal)| Vertex {
            at: at.map(|x: f64| half * x),
            edge: Site { at: normal.map(|x: f64| 2.0 * half * x), neighbor: BOX },
        }));
    }

    fn clip(&mut self, site: Site<2>) {
        let half_square = 0.5 * dot(&site.at, &site.at);
        let beyond = |vertex: &Vertex| dot(&vertex.at, &site.at) - half_square;
        if half_square == 0.0 || self.vertices.iter().all(|vertex| beyond(vertex) <= 0.0) {
            return;
        }
        self.next.clear();
        for (k, vertex) in self.vertices.iter().enumerate() {
            let following = &self.vertices[(k + 1) % self.vertices.len()];
            let (here, there) = (beyond(vertex), beyond(following));
            if here <= 0.0 {
                self.next.push(*vertex);
            }
            if (here <= 0.0) != (there <= 0.0) {
                let share = here / (here - there);
                let at = std::array::from_fn(|a| vertex.at[a] + share * (following.at[a] - vertex.at[a]));
                // leaving the half-plane the new edge begins, entering it the old one goes on
                let edge = if here <= 0.0 { site } else { vertex.edge };
                self.next.push(Vertex { at, edge });
            }
        }
        std::mem::swap(&mut self.vertices, &mut self.next);
    }

    fn squared_radius(&self) -> f64 {
        self.vertices.iter().map(|vertex| dot(&vertex.at, &vertex.at)).fold(0.0, f64::max)
    }

    fn corners(&self) -> impl Iterator<Item = Corner<2>> {
        let count = self.vertices.len();
        (0..count).map(move |k| Corner {
            at: self.vertices[k].at,
            sites: [self.vertices[(k + count - 1) % count].edge, self.vertices[k].edge],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_neighbour_beyond_twice_the_radius_changes_nothing() {
        let mut polygon = Polygon::default();
        polygon.reset(1.0);
        let before: Vec<_> = polygon.corners().collect();
        polygon.clip(Site { at: [2.0 * 2.0_f64.sqrt() + 1e-9, 0.0], neighbor: 0 });
        assert_eq!(polygon.corners().collect::<Vec<_>>(), before);
    }
}
