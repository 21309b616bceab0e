//! A convex polygon clipped by perpendicular bisectors: one planar Voronoi cell around the origin.

/// A corner and the neighbour whose bisector carries the edge that leaves it, counter-clockwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Position in the tangent plane.
    pub at: [f64; 2],
    /// Neighbour behind the edge from this corner to the next; [`BOX`] for a side of the starting box.
    pub edge: u32,
}

/// Marks an edge that no neighbour made.
pub const BOX: u32 = u32::MAX;

/// The cell as clipped so far; reused from point to point.
#[derive(Debug, Clone, Default)]
pub struct Polygon {
    corners: Vec<Corner>,
    next: Vec<Corner>,
}

impl Polygon {
    /// Starts over with a square of half-width `half`.
    pub fn reset(&mut self, half: f64) {
        self.corners.clear();
        self.corners.extend(
            [[half, half], [-half, half], [-half, -half], [half, -half]].map(|at| Corner { at, edge: BOX }),
        );
    }

    /// Keeps the side of the bisector between the origin and `site` on which the origin lies.
    pub fn clip(&mut self, site: [f64; 2], neighbor: u32) {
        let half_square = 0.5 * dot(site, site);
        let beyond = |corner: &Corner| dot(corner.at, site) - half_square;
        if half_square == 0.0 || self.corners.iter().all(|corner| beyond(corner) <= 0.0) {
            return;
        }
        self.next.clear();
        for (k, corner) in self.corners.iter().enumerate() {
            let following = &self.corners[(k + 1) % self.corners.len()];
            let (here, there) = (beyond(corner), beyond(following));
            if here <= 0.0 {
                self.next.push(*corner);
            }
            if (here <= 0.0) != (there <= 0.0) {
                let share = here / (here - there);
                let at = std::array::from_fn(|a| corner.at[a] + share * (following.at[a] - corner.at[a]));
                // leaving the half-plane the new edge begins, entering it the old one goes on
                let edge = if here <= 0.0 { neighbor } else { corner.edge };
                self.next.push(Corner { at, edge });
            }
        }
        std::mem::swap(&mut self.corners, &mut self.next);
    }

    /// Corners, counter-clockwise.
    #[must_use]
    pub fn corners(&self) -> &[Corner] {
        &self.corners
    }

    /// Squared distance of the farthest corner.
    #[must_use]
    pub fn squared_radius(&self) -> f64 {
        self.corners.iter().map(|corner| dot(corner.at, corner.at)).fold(0.0, f64::max)
    }
}

/// Scalar product in the plane.
#[must_use]
pub fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Signed area of the parallelogram.
#[must_use]
pub fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(polygon: &Polygon) -> f64 {
        let corners = polygon.corners();
        let twice: f64 =
            (0..corners.len()).map(|k| cross(corners[k].at, corners[(k + 1) % corners.len()].at)).sum();
        0.5 * twice
    }

    #[test]
    fn four_neighbours_on_a_grid_leave_the_unit_square() {
        let mut polygon = Polygon::default();
        polygon.reset(10.0);
        for (neighbor, site) in [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]].into_iter().enumerate() {
            polygon.clip(site, neighbor as u32);
        }
        assert!((area(&polygon) - 1.0).abs() < 1e-15);
        assert!(polygon.corners().iter().all(|corner| corner.edge != BOX));
    }

    #[test]
    fn a_neighbour_beyond_twice_the_radius_changes_nothing() {
        let mut polygon = Polygon::default();
        polygon.reset(1.0);
        let before = polygon.corners().to_vec();
        polygon.clip([2.0 * 2.0_f64.sqrt() + 1e-9, 0.0], 0);
        assert_eq!(polygon.corners(), before);
    }
}
