//! Which side of each tangent frame is which: handedness along the surface, by votes.
//!
//! Hoppe et al. (1992) carry handedness along a spanning tree of the best agreeing links. A link to the opposite sheet of
//! a thin part joins planes that agree best of all, and wrongly. Here patches grow as in Borůvka's tree, but two patches are
//! joined by the sum of the votes of all links between them: a few wrong ones are outvoted.

use rayon::prelude::*;

use super::frames::Frames;
use crate::progress::{Canceled, Progress};

/// Neighbors whose planes are within 45° of each other can be compared reliably.
const COMPARABLE: f64 = 0.7;

/// Passes in which single points follow the majority around them.
const PASSES: usize = 3;

/// Votes or points handled between two looks at the progress.
const BATCH: usize = 1 << 20;

/// No vote.
const NONE: u32 = u32::MAX;

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
    ///
    /// # Errors
    /// [`Canceled`].
    pub fn find(frames: &Frames, n: usize, links: &[Link], progress: &Progress) -> Result<Self, Canceled> {
        // found twice, because there is no room to keep them
        let agreement = |link: &Link| frames.agreement(link.ends[0] as usize, link.ends[1] as usize);
        let vote = |link: &Link| {
            let agreement = agreement(link);
            (link.ends, link.weight * agreement * agreement.abs())
        };
        let votes: Vec<Vote> = links.par_iter().with_min_len(1 << 12).map(vote).collect();
        progress.checkpoint()?;
        let mut flipped = by_patches(n, &votes, progress)?;
        follow_majority(&mut flipped, &votes, progress)?;
        drop(votes);
        let (mut comparable, mut conflicting) = (0.0, 0.0);
        for links in links.chunks(BATCH) {
            progress.checkpoint()?;
            for (link, agreement) in
                links.iter().map(|link| (link, agreement(link))).filter(|(_, a)| a.abs() > COMPARABLE)
            {
                let [i, j] = link.ends;
                comparable += link.weight;
                if (agreement < 0.0) != (flipped[i as usize] != flipped[j as usize]) {
                    conflicting += link.weight;
                }
            }
        }
        let conflicts = if comparable > 0.0 { conflicting / comparable } else { 0.0 };
        Ok(Self { flipped, conflicts })
    }

    /// `agreement` of the frames of two points as they are oriented.
    #[must_use]
    pub fn agreement(&self, frames: &Frames, i: usize, j: usize) -> f64 {
        // the smaller index first, so that both directions compute the same bits
        let agreement = frames.agreement(i.min(j), i.max(j));
        if self.flipped[i] == self.flipped[j] { agreement } else { -agreement }
    }
}

/// Two points or patches, and how strongly they are told to be on the same side, or negative, on different ones.
type Vote = ([u32; 2], f64);

/// Joins patches, each with the neighbor that it has the clearest vote with, until none are left to join.
fn by_patches(n: usize, links: &[Vote], progress: &Progress) -> Result<Vec<bool>, Canceled> {
    let mut patches = Patches::new(n);
    let mut joined: Option<Vec<Vote>> = None;
    loop {
        let votes = joined.as_deref().unwrap_or(links);
        if votes.is_empty() {
            break;
        }
        let mut best = vec![NONE; n];
        for (batch, some) in votes.chunks(BATCH).enumerate() {
            progress.checkpoint()?;
            for (k, ([a, b], vote)) in some.iter().enumerate() {
                for patch in [*a, *b] {
                    let other = best[patch as usize];
                    let other = if other == NONE { -1.0 } else { votes[other as usize].1.abs() };
                    if vote.abs() > other {
                        best[patch as usize] = (batch * BATCH + k) as u32;
                    }
                }
            }
        }
        best.retain(|&k| k != NONE);
        let mut chosen = best;
        let abs = |k: u32| votes[k as usize].1.abs();
        progress.leaving(|leave| {
            chosen.par_sort_unstable_by(|&a, &b| {
                leave.if_canceled();
                abs(b).total_cmp(&abs(a)).then(a.cmp(&b))
            });
        })?;
        chosen.dedup();
        for chosen in chosen.chunks(BATCH) {
            progress.checkpoint()?;
            for &k in chosen {
                let ([a, b], vote) = votes[k as usize];
                patches.join(a, b, vote < 0.0);
            }
        }
        drop(chosen);
        let mut left: Vec<Vote> = Vec::with_capacity(votes.len() / 2);
        for some in votes.chunks(BATCH) {
            progress.checkpoint()?;
            for &([a, b], vote) in some {
                let ((a, flip_a), (b, flip_b)) = (patches.find(a), patches.find(b));
                if a != b {
                    left.push(([a.min(b), a.max(b)], if flip_a == flip_b { vote } else { -vote }));
                }
            }
        }
        // stable: sums do not depend on the sort
        progress.leaving(|leave| {
            left.par_sort_by_key(|&(ends, _)| {
                leave.if_canceled();
                ends
            });
        })?;
        left.dedup_by(|later, sum| {
            let same = later.0 == sum.0;
            if same {
                sum.1 += later.1;
            }
            same
        });
        joined = Some(left);
    }
    Ok((0..n as u32).map(|i| patches.find(i).1).collect())
}

/// Turns single points around that most of their links ask to turn.
fn follow_majority(flipped: &mut [bool], votes: &[Vote], progress: &Progress) -> Result<(), Canceled> {
    // where the votes of every point end, once they are entered
    let mut ends = vec![0_u32; flipped.len() + 1];
    votes.iter().flat_map(|(ends, _)| ends).for_each(|&i| ends[i as usize + 1] += 1);
    (0..flipped.len()).for_each(|i| ends[i + 1] += ends[i]);
    ends.pop();
    let mut around = vec![0_u32; 2 * votes.len()];
    for (batch, some) in votes.chunks(BATCH).enumerate() {
        progress.checkpoint()?;
        for (k, (points, _)) in some.iter().enumerate() {
            for &i in points {
                let end = &mut ends[i as usize];
                around[*end as usize] = (batch * BATCH + k) as u32;
                *end += 1;
            }
        }
    }
    for _ in 0..PASSES {
        let mut start = 0;
        for i in 0..flipped.len() {
            if i.is_multiple_of(BATCH) {
                progress.checkpoint()?;
            }
            let signed = |&k: &u32| {
                let ([a, b], vote) = votes[k as usize];
                if flipped[a as usize] == flipped[b as usize] { vote } else { -vote }
            };
            let end = ends[i] as usize;
            let sum: f64 = around[start..end].iter().map(signed).sum();
            if sum < 0.0 {
                flipped[i] = !flipped[i];
            }
            start = end;
        }
    }
    Ok(())
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
        let mut flipped = by_patches(n as usize, &votes, &Progress::new()).unwrap();
        follow_majority(&mut flipped, &votes, &Progress::new()).unwrap();
        let against = |([i, j], vote): &&([u32; 2], f64)| {
            (*vote < 0.0) != (flipped[*i as usize] != flipped[*j as usize])
        };
        let wrong: Vec<_> = votes.iter().filter(against).map(|vote| vote.0).collect();
        assert_eq!(wrong, [[20, 70]]);
    }
}
