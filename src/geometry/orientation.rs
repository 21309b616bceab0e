//! Which side of each tangent frame is which: handedness along the surface, by votes.
//!
//! Hoppe et al. (1992) carry handedness along a spanning tree of the best agreeing links. A link to the opposite sheet of
//! a thin part joins planes that agree best of all, and wrongly. Here patches grow as in Borůvka's tree, but two patches are
//! joined by the sum of the votes of all links between them: a few wrong ones are outvoted.

use super::frames::Frames;

/// Neighbors whose planes are within 45° of each other can be compared reliably.
const COMPARABLE: f64 = 0.7;

/// Passes in which single points follow the majority around them.
const PASSES: usize = 3;

/// Two adjacent points and how much their link counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// The points, the smaller index first.
    pub ends: [u32; 2],
    /// Weight, positive.
    pub weight: f64,
}

/// Handedness of frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Orientation {
    /// Whose handedness must be turned around.
    pub flipped: Vec<bool>,
    /// Share of the weight of clearly comparable links whose handedness disagrees in spite of all: 0 on orientable,
    /// well sampled surfaces.
    pub conflicts: f64,
}

impl Orientation {
    /// Orients `frames` along `links`, which must be sorted and distinct.
    #[must_use]
    pub fn find(frames: &Frames, n: usize, links: &[Link]) -> Self {
        let agreements: Vec<f64> =
            links.iter().map(|link| frames.agreement(link.ends[0] as usize, link.ends[1] as usize)).collect();
        let votes: Vec<([u32; 2], f64)> = links
            .iter()
            .zip(&agreements)
            .map(|(link, agreement)| (link.ends, link.weight * agreement * agreement.abs()))
            .collect();
        let mut flipped = by_patches(n, votes.clone());
        follow_majority(&mut flipped, &votes);
        let (mut comparable, mut conflicting) = (0.0, 0.0);
        for (link, agreement) in links.iter().zip(&agreements).filter(|(_, a)| a.abs() > COMPARABLE) {
            let [i, j] = link.ends;
            comparable += link.weight;
            if (*agreement < 0.0) != (flipped[i as usize] != flipped[j as usize]) {
                conflicting += link.weight;
            }
        }
        let conflicts = if comparable > 0.0 { conflicting / comparable } else { 0.0 };
        Self { flipped, conflicts }
    }

    /// `agreement` of the frames of two points as they are oriented.
    #[must_use]
    pub fn agreement(&self, frames: &Frames, i: usize, j: usize) -> f64 {
        // the smaller index first, so that both directions compute the same bits
        let agreement = frames.agreement(i.min(j), i.max(j));
        if self.flipped[i] == self.flipped[j] { agreement } else { -agreement }
    }
}

/// Joins patches, each with the neighbor that it has the clearest vote with, until none are left to join.
fn by_patches(n: usize, mut votes: Vec<([u32; 2], f64)>) -> Vec<bool> {
    let mut patches = Patches::new(n);
    while !votes.is_empty() {
        let mut best: Vec<Option<usize>> = vec![None; n];
        for (k, ([a, b], vote)) in votes.iter().enumerate() {
            for patch in [*a, *b] {
                let other = best[patch as usize].map_or(-1.0, |k| votes[k].1.abs());
                if vote.abs() > other {
                    best[patch as usize] = Some(k);
                }
            }
        }
        let mut chosen: Vec<usize> = best.into_iter().flatten().collect();
        chosen.sort_unstable_by(|&a, &b| votes[b].1.abs().total_cmp(&votes[a].1.abs()).then(a.cmp(&b)));
        chosen.dedup();
        for &k in &chosen {
            let ([a, b], vote) = votes[k];
            patches.join(a, b, vote < 0.0);
        }
        let mut left: Vec<([u32; 2], f64)> = Vec::with_capacity(votes.len() / 2);
        for &([a, b], vote) in &votes {
            let ((a, flip_a), (b, flip_b)) = (patches.find(a), patches.find(b));
            if a != b {
                left.push(([a.min(b), a.max(b)], if flip_a == flip_b { vote } else { -vote }));
            }
        }
        // stable: sums do not depend on the sort
        left.sort_by_key(|&(ends, _)| ends);
        left.dedup_by(|later, sum| {
            let same = later.0 == sum.0;
            if same {
                sum.1 += later.1;
            }
            same
        });
        votes = left;
    }
    (0..n as u32).map(|i| patches.find(i).1).collect()
}

/// Turns single points around that most of their links ask to turn.
fn follow_majority(flipped: &mut [bool], votes: &[([u32; 2], f64)]) {
    let mut offsets = vec![0_usize; flipped.len() + 1];
    votes.iter().flat_map(|(ends, _)| ends).for_each(|&i| offsets[i as usize + 1] += 1);
    (0..flipped.len()).for_each(|i| offsets[i + 1] += offsets[i]);
    let mut around = vec![(0_u32, 0.0); 2 * votes.len()];
    let mut next = offsets.clone();
    for &([a, b], vote) in votes {
        for (i, j) in [(a, b), (b, a)] {
            around[next[i as usize]] = (j, vote);
            next[i as usize] += 1;
        }
    }
    for _ in 0..PASSES {
        for i in 0..flipped.len() {
            let signed =
                |&(j, vote): &(u32, f64)| if flipped[i] == flipped[j as usize] { vote } else { -vote };
            let sum: f64 = around[offsets[i]..offsets[i + 1]].iter().map(signed).sum();
            if sum < 0.0 {
                flipped[i] = !flipped[i];
            }
        }
    }
}

/// Union-find whose members know on which of two sides they are relative to their root.
struct Patches {
    parent: Vec<u32>,
    flipped: Vec<bool>,
}

impl Patches {
    fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect(), flipped: vec![false; n] }
    }

    /// Root of `i`, and whether `i` is on the other side than its root.
    fn find(&mut self, i: u32) -> (u32, bool) {
        let (mut root, mut flipped) = (i, false);
        while self.parent[root as usize] != root {
            flipped ^= self.flipped[root as usize];
            root = self.parent[root as usize];
        }
        let (mut k, mut side) = (i, flipped);
        while self.parent[k as usize] != root && k != root {
            let (next, step) = (self.parent[k as usize], self.flipped[k as usize]);
            self.parent[k as usize] = root;
            self.flipped[k as usize] = side;
            side ^= step;
            k = next;
        }
        (root, flipped)
    }

    fn join(&mut self, i: u32, j: u32, opposite: bool) {
        let ((a, side_i), (b, side_j)) = (self.find(i), self.find(j));
        if a != b {
            let (leader, follower) = (a.min(b), a.max(b));
            self.parent[follower as usize] = leader;
            self.flipped[follower as usize] = side_i ^ side_j ^ opposite;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_link_between_two_rows_is_outvoted_by_the_links_around_their_ends() {
        // two rows of 50, joined end to end by ten links each; frames alternate; one link across says the opposite
        let n = 100_u32;
        let mut votes: Vec<([u32; 2], f64)> = Vec::new();
        let sign = |i: u32| if i.is_multiple_of(3) { -1.0 } else { 1.0 };
        for i in 0..n {
            for step in 1..4 {
                let j = (i + step) % n;
                votes.push(([i.min(j), i.max(j)], 0.8 * sign(i) * sign(j)));
            }
        }
        votes.push(([20, 70], -0.99 * sign(20) * sign(70)));
        votes.sort_by_key(|vote| vote.0);
        let mut flipped = by_patches(n as usize, votes.clone());
        follow_majority(&mut flipped, &votes);
        let against = |([i, j], vote): &&([u32; 2], f64)| {
            (*vote < 0.0) != (flipped[*i as usize] != flipped[*j as usize])
        };
        let wrong: Vec<_> = votes.iter().filter(against).map(|vote| vote.0).collect();
        assert_eq!(wrong, [[20, 70]]);
    }
}
