//! k = 2: a convex polygon.

use super::{BOX, Corner, Polytope, Site, dot};

/// A corner and the neighbor whose bisector carries the edge that leaves it, counter-clockwise.
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
    /// How far each corner is beyond the bisector, times the distance of its site.
    beyond: Vec<f64>,
}

/// First corner and number of corners beyond a line, around the farthest: of a convex polygon one arc, which signs alone
/// do not make where rounding scatters corners about the line. `None` when no corner or every one is beyond.
fn arc(beyond: &[f64]) -> Option<(usize, usize)> {
    let count = beyond.len();
    let farthest = (0..count).max_by(|&a, &b| beyond[a].total_cmp(&beyond[b]))?;
    if beyond[farthest] <= 0.0 {
        return None;
    }
    let before = (1..count).take_while(|k| beyond[(farthest + count - k) % count] > 0.0).count();
    let after = (1..count - before).take_while(|k| beyond[(farthest + k) % count] > 0.0).count();
    let length = 1 + before + after;
    (length < count).then_some(((farthest + count - before) % count, length))
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
        self.beyond.clear();
        self.beyond.extend(self.vertices.iter().map(|vertex| dot(&vertex.at, &site.at) - half_square));
        let Some((first, length)) = arc(&self.beyond).filter(|_| half_square > 0.0) else { return };
        let count = self.vertices.len();
        let is_beyond = |k: usize| (k + count - first) % count < length;
        self.next.clear();
        for (k, vertex) in self.vertices.iter().enumerate() {
            let after = (k + 1) % count;
            if !is_beyond(k) {
                self.next.push(*vertex);
            }
            if is_beyond(k) != is_beyond(after) {
                let share = self.beyond[k] / (self.beyond[k] - self.beyond[after]);
                let following = &self.vertices[after];
                let at = std::array::from_fn(|a| vertex.at[a] + share * (following.at[a] - vertex.at[a]));
                // leaving the half-plane the new edge begins, entering it the old one goes on
                let edge = if is_beyond(after) { site } else { vertex.edge };
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
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn a_neighbor_beyond_twice_the_radius_changes_nothing() {
        let mut polygon = Polygon::default();
        polygon.reset(1.0);
        let before: Vec<_> = polygon.corners().collect();
        polygon.clip(Site { at: [2.0 * 2.0_f64.sqrt() + 1e-9, 0.0], neighbor: 0 });
        assert_eq!(polygon.corners().collect::<Vec<_>>(), before);
    }

    #[test]
    fn the_corners_beyond_a_line_are_one_arc_around_the_farthest() {
        assert_eq!(arc(&[-1.0, 2.0, 1.0, -1.0]), Some((1, 2)));
        assert_eq!(arc(&[3.0, -1.0, -1.0, 2.0]), Some((3, 2)));
        // 1e-17 on the other side is rounding
        assert_eq!(arc(&[-1.0, 1e-17, -1.0, 2.0, -1.0]), Some((3, 1)));
        assert_eq!(arc(&[-1.0, 0.0]), None);
        assert_eq!(arc(&[1.0, 2.0, 1.0]), None);
    }

    #[test]
    fn every_neighbor_has_one_edge_where_many_bisectors_meet_in_a_point() {
        // sites on a circle through the origin: all bisectors pass through its center
        for count in [5_u32, 12, 40] {
            for turn in 0..50 {
                let mut polygon = Polygon::default();
                polygon.reset(4.0);
                for neighbor in 0..count {
                    let angle = f64::from(neighbor * 50 + turn + 1) / f64::from(count * 50 + 51) * TAU;
                    let at = [angle.cos() - 1.0, angle.sin()];
                    polygon.clip(Site { at, neighbor });
                }
                let mut edges: Vec<u32> = polygon.corners().map(|corner| corner.sites[1].neighbor).collect();
                edges.retain(|&edge| edge != BOX);
                let all = edges.len();
                edges.sort_unstable();
                edges.dedup();
                assert_eq!(edges.len(), all, "{count} {turn}");
            }
        }
    }
}
