//! Delaunay tetrahedra of points in space, one point after the other (Bowyer 1981, Watson 1981): the tetrahedra whose
//! circumscribed balls hold the new point make room for those that join their hull to it.
//!
//! Signs are exact (Shewchuk 1997, by the crate `robust`), so that the hull is always star-shaped around the new point
//! and the walk towards it always ends. Coordinates between 2^-53 and 1 keep the predicates from underflow.

use robust::{Coord, Coord3D, insphere, orient2d, orient3d};

/// The corner that every tetrahedron outside of the convex hull shares; such a one stands for all space beyond a
/// triangle of the hull.
const BEYOND: u32 = u32::MAX;

/// Every 64th point first, then every eighth, then the rest: points in the order of a space-filling curve would
/// otherwise grow long tetrahedra along its front (Amenta, Choi, Rote 2003).
const STRIDES: [usize; 3] = [64, 8, 1];

/// Corners, so that the last is on the positive side of the others, and the tetrahedron across from each.
#[derive(Debug, Clone, Copy)]
struct Tetrahedron {
    corners: [u32; 4],
    across: [u32; 4],
    /// Twice the number of the last point that it was held against, and one more if its ball holds the point.
    seen: u32,
}

impl Tetrahedron {
    /// Where `corner` stands.
    fn place(&self, corner: u32) -> Option<usize> {
        self.corners.iter().position(|&other| other == corner)
    }
}

/// The Delaunay tetrahedra of a list of points.
#[derive(Debug, Default)]
pub(super) struct Tetrahedra {
    sites: Vec<Coord3D<f64>>,
    all: Vec<Tetrahedron>,
    unused: Vec<u32>,
    /// Where the next walk starts.
    recent: u32,
    round: u32,
    cavity: Vec<u32>,
    /// New tetrahedra with the one each was made from and the place of the new point.
    made: Vec<(u32, u32, usize)>,
}

impl Tetrahedra {
    /// None when all points lie in a plane. Of coinciding points one is taken.
    pub(super) fn of(sites: impl IntoIterator<Item = [f64; 3]>) -> Self {
        let sites = sites.into_iter().map(|[x, y, z]| Coord3D { x, y, z }).collect();
        let mut made = Self { sites, ..Self::default() };
        let Some(first) = made.first_four() else { return made };
        made.begin(first);
        let mut last = usize::MAX;
        for stride in STRIDES {
            for site in (0..made.sites.len()).step_by(stride).filter(|site| !site.is_multiple_of(last)) {
                if !first.contains(&(site as u32)) {
                    made.insert(site as u32);
                }
            }
            last = stride;
        }
        made
    }

    /// Corners of all tetrahedra inside of the convex hull.
    pub(super) fn corners(&self) -> impl Iterator<Item = [u32; 4]> {
        self.all.iter().map(|tetrahedron| tetrahedron.corners).filter(|corners| !corners.contains(&BEYOND))
    }

    /// Whether a further point lies inside the ball around a tetrahedron.
    pub(super) fn ball_holds(&self, corners: [u32; 4], [x, y, z]: [f64; 3]) -> bool {
        let [a, b, c, d] = corners.map(|corner| self.sites[corner as usize]);
        insphere(a, b, c, d, Coord3D { x, y, z }) > 0.0
    }

    /// Positive when the corners turn as those of a tetrahedron do.
    fn turn(&self, corners: [u32; 4]) -> f64 {
        let [a, b, c, d] = corners.map(|corner| self.sites[corner as usize]);
        orient3d(a, b, c, d)
    }

    /// Four points with a volume, in their order.
    fn first_four(&self) -> Option<[u32; 4]> {
        let site = |i: u32| self.sites[i as usize];
        let count = self.sites.len() as u32;
        let b = (1..count).find(|&b| site(b) != site(0))?;
        let shadow = |i: u32, axis: usize| {
            let Coord3D { x, y, z } = site(i);
            let (x, y) = [(y, z), (z, x), (x, y)][axis];
            Coord { x, y }
        };
        let is_off_line =
            |c: u32| (0..3).any(|axis| orient2d(shadow(0, axis), shadow(b, axis), shadow(c, axis)) != 0.0);
        let c = (1..count).find(|&c| is_off_line(c))?;
        let d = (1..count).find(|&d| self.turn([0, b, c, d]) != 0.0)?;
        Some(if self.turn([0, b, c, d]) > 0.0 { [0, b, c, d] } else { [b, 0, c, d] })
    }

    /// One tetrahedron and the space beyond its four sides.
    fn begin(&mut self, corners: [u32; 4]) {
        self.all.push(Tetrahedron { corners, across: [1, 2, 3, 4], seen: 0 });
        for side in 0..4 {
            let mut turned = Tetrahedron { corners, across: [1, 2, 3, 4], seen: 0 };
            (turned.corners[side], turned.across[side]) = (BEYOND, 0);
            let (i, j) = ((side + 1) % 4, (side + 2) % 4);
            turned.corners.swap(i, j);
            turned.across.swap(i, j);
            self.all.push(turned);
        }
    }

    /// Takes a point in.
    fn insert(&mut self, site: u32) {
        self.round += 1;
        let Some(start) = self.find(site) else { return };
        // a point in a tetrahedron is in its ball too, unless it is one of its corners
        if !self.is_in_conflict(start, site) {
            return;
        }
        self.empty_cavity(start, site);
        self.fill_cavity();
        for &old in &self.cavity {
            self.all[old as usize].corners = [BEYOND; 4];
        }
        self.unused.append(&mut self.cavity);
    }

    /// The tetrahedron that holds a point: across any side that has the point on its other side, until there is none.
    /// Among Delaunay tetrahedra this never turns in circles (Edelsbrunner 1990).
    fn find(&self, site: u32) -> Option<u32> {
        let mut at = self.recent;
        if let Some(beyond) = self.all[at as usize].place(BEYOND) {
            at = self.all[at as usize].across[beyond];
        }
        let mut from = at;
        for _ in 0..self.all.len() {
            let Tetrahedron { corners, across, .. } = self.all[at as usize];
            if corners.contains(&BEYOND) {
                return Some(at);
            }
            let is_behind = |&side: &usize| {
                let mut seen = corners;
                seen[side] = site;
                across[side] != from && self.turn(seen) < 0.0
            };
            match (0..4).find(is_behind) {
                Some(side) => (from, at) = (at, across[side]),
                None => return Some(at),
            }
        }
        None
    }

    /// Whether a tetrahedron's ball holds the point. Beyond a triangle of the hull the ball is a half-space, and on its
    /// plane what the ball on the other side says holds.
    fn is_in_conflict(&mut self, at: u32, site: u32) -> bool {
        let Tetrahedron { mut corners, across, seen } = self.all[at as usize];
        if seen >> 1 == self.round {
            return seen & 1 == 1;
        }
        let holds = |corners: [u32; 4]| {
            let [a, b, c, d] = corners.map(|corner| self.sites[corner as usize]);
            insphere(a, b, c, d, self.sites[site as usize]) > 0.0
        };
        let is = match corners.iter().position(|&corner| corner == BEYOND) {
            None => holds(corners),
            Some(side) => {
                corners[side] = site;
                let turn = self.turn(corners);
                turn > 0.0 || (turn == 0.0 && holds(self.all[across[side] as usize].corners))
            }
        };
        self.all[at as usize].seen = self.round << 1 | u32::from(is);
        is
    }

    /// Collects the tetrahedra in conflict with the point, and makes one on every side of their hull: the old one with
    /// the point in place of the corner that is cut off.
    fn empty_cavity(&mut self, start: u32, site: u32) {
        self.cavity.clear();
        self.made.clear();
        self.cavity.push(start);
        let mut done = 0;
        while let Some(&old) = self.cavity.get(done) {
            done += 1;
            let Tetrahedron { corners, across, .. } = self.all[old as usize];
            for (side, other) in across.into_iter().enumerate() {
                let seen = self.all[other as usize].seen;
                if seen == (self.round << 1 | 1) {
                    continue;
                }
                if self.is_in_conflict(other, site) {
                    self.cavity.push(other);
                    continue;
                }
                let mut new = Tetrahedron { corners, across: [BEYOND; 4], seen: 0 };
                (new.corners[side], new.across[side]) = (site, other);
                let place = self.put(new);
                let back = self.all[other as usize].across.iter_mut().find(|back| **back == old);
                if let Some(back) = back {
                    *back = place;
                }
                // from inside, the new one is what lies across from here on
                self.all[old as usize].across[side] = place;
                self.made.push((place, old, side));
            }
        }
    }

    /// Joins the new tetrahedra: two that share an edge of the hull find each other by turning around it, through the
    /// cavity.
    fn fill_cavity(&mut self) {
        for k in 0..self.made.len() {
            let (new, old, cut) = self.made[k];
            let corners = self.all[old as usize].corners;
            for side in (0..4).filter(|&side| side != cut) {
                // around the edge of the two other corners: crosses the side across from `ahead`, and leaves `behind`
                let (mut behind, mut ahead) = (corners[cut], corners[side]);
                let edge = sum(corners).wrapping_sub(behind).wrapping_sub(ahead);
                let mut at = old;
                while let Some(place) = self.all[at as usize].place(ahead) {
                    let next = self.all[at as usize].across[place];
                    if self.all[next as usize].seen != (self.round << 1 | 1) {
                        self.all[new as usize].across[side] = next;
                        break;
                    }
                    let fourth = sum(self.all[next as usize].corners).wrapping_sub(edge).wrapping_sub(behind);
                    (at, ahead, behind) = (next, behind, fourth);
                }
            }
            self.recent = new;
        }
    }

    /// Puts a tetrahedron where there is room.
    fn put(&mut self, tetrahedron: Tetrahedron) -> u32 {
        if let Some(place) = self.unused.pop() {
            self.all[place as usize] = tetrahedron;
            return place;
        }
        self.all.push(tetrahedron);
        self.all.len() as u32 - 1
    }
}

/// Names the corner that is left when the others are taken away.
fn sum(corners: [u32; 4]) -> u32 {
    corners.into_iter().fold(0, u32::wrapping_add)
}
