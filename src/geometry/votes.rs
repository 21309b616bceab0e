//! Planes that the neighbors of a point speak against.
//!
//! Where another sheet is as near as a point's own neighbors, its plane can lie across both. It then sees triangles that no
//! other corner sees, and one such point joins two sheets. Its neighbors, whose planes lie along their sheet, see it among
//! themselves: the triangles that both other corners see tell where its plane should lie.

use std::collections::VecDeque;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::planes::turn_between;
use super::points::Points;
use super::stars::{Spoke, Stars};
use crate::progress::{Canceled, Progress};

/// Points handled between two looks at the progress.
const BATCH: usize = 1 << 16;

/// The planes that neighbors vote for: points, ascending, of whose stars others see at most `share_max`, with the unit normals
/// of the triangles around them that both other corners see.
///
/// # Errors
/// [`Canceled`].
pub(super) fn voted_normals(
    points: &Points,
    stars: &Stars,
    share_max: f64,
    progress: &Progress,
) -> Result<Vec<(usize, Vector3<f64>)>, Canceled> {
    let batches = || (0..stars.len()).step_by(BATCH).map(|start| start..stars.len().min(start + BATCH));
    let mut doubted: Vec<bool> = Vec::with_capacity(stars.len());
    for batch in batches() {
        progress.checkpoint()?;
        let is_doubted = |i: usize| stars.agreed_share(i, stars.of(i)) <= share_max;
        doubted.par_extend(batch.into_par_iter().with_min_len(256).map(is_doubted));
    }
    let mut votes: Vec<Vote> = Vec::new();
    for batch in batches() {
        progress.checkpoint()?;
        let of_voter = |q: usize| votes_of(stars, q).filter(|vote| doubted[vote.on as usize]);
        votes.par_extend(batch.into_par_iter().with_min_len(256).flat_map_iter(of_voter));
    }
    votes.par_sort_unstable();
    progress.checkpoint()?;
    let of_point = |votes: &[Vote]| {
        let agreed: Vec<[u32; 2]> =
            votes.chunk_by(PartialEq::eq).filter(|same| same.len() == 2).map(|same| same[0].edge).collect();
        let on = votes[0].on as usize;
        Some((on, normal(points, on, &longest_path(points, on, agreed))?))
    };
    Ok(votes.par_chunk_by(|a, b| a.on == b.on).filter_map(of_point).collect())
}

/// A triangle that one of its corners sees: where it votes for the point `on`, the edge of the other two.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Vote {
    on: u32,
    edge: [u32; 2],
}

/// The votes of point `q`, each triangle of its star for the other two corners.
fn votes_of(stars: &Stars, q: usize) -> impl Iterator<Item = Vote> {
    stars.triangles(q).flat_map(|[q, a, b]| {
        [(a, b), (b, a)].map(|(on, other)| Vote { on, edge: [q.min(other), q.max(other)] })
    })
}

/// Of the paths that these edges around a point make, the one of the widest angle.
fn longest_path(points: &Points, i: usize, mut edges: Vec<[u32; 2]>) -> Vec<u32> {
    let mut longest = (0.0, Vec::new());
    while let Some([first, second]) = edges.pop() {
        let mut path = VecDeque::from([first, second]);
        while let Some(k) =
            edges.iter().position(|edge| edge.iter().any(|q| [path.front(), path.back()].contains(&Some(q))))
        {
            let [a, b] = edges.swap_remove(k);
            match (path.front(), path.back()) {
                (_, Some(&end)) if end == a => path.push_back(b),
                (_, Some(&end)) if end == b => path.push_back(a),
                (Some(&end), _) if end == a => path.push_front(b),
                _ => path.push_front(a),
            }
        }
        let path: Vec<u32> = path.into();
        let angle: f64 = turns(points, i, &path).map(|turn| turn.norm()).sum();
        if angle > longest.0 {
            longest = (angle, path);
        }
    }
    longest.1
}

/// Unit normal of the triangles of point `i` and the edges of a path, each weighing its angle (Thürmer and Wüthrich 1998).
fn normal(points: &Points, i: usize, path: &[u32]) -> Option<Vector3<f64>> {
    turns(points, i, path).sum::<Vector3<f64>>().try_normalize(1e-3)
}

/// For each edge of a path the normal of its triangle with point `i`, as long as the angle there.
fn turns(points: &Points, i: usize, path: &[u32]) -> impl Iterator<Item = Vector3<f64>> {
    let p = Vector3::from_column_slice(points.point(i));
    let offset = move |q: u32| Vector3::from_column_slice(points.point(q as usize)) - p;
    path.windows(2).map(move |edge| turn_between(offset(edge[0]), offset(edge[1])))
}

impl Stars {
    /// Share of the spokes in a star of point `i` behind which lies a triangle that its other two corners see too.
    pub(super) fn agreed_share(&self, i: usize, star: &[Spoke]) -> f64 {
        let is_agreed = |k: &usize| {
            let [q, r] = [star[*k].neighbor, star[(k + 1) % star.len()].neighbor];
            star[*k].filled && self.is_seen_by_others([i as u32, q, r])
        };
        (0..star.len()).filter(is_agreed).count() as f64 / star.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{NonFinite, PointCloud};
    use crate::geometry::survey::{Rules, Survey};
    use crate::geometry::{NearestNeighbors, SearchTree, frames};

    /// Points of a paraboloid, evenly spread.
    fn rows() -> Vec<[f64; 3]> {
        (0..900)
            .map(|i| {
                let (r, angle) = ((f64::from(i) / 900.0).sqrt(), f64::from(i) * 2.399_963_229_728_653);
                let [x, y] = [r * angle.cos(), r * angle.sin()];
                [x, y, 0.3 * (x * x + y * y)]
            })
            .collect()
    }

    #[test]
    fn a_plane_across_the_surface_is_turned_to_where_its_neighbors_see_the_point() {
        let cloud = PointCloud::new(3, rows().concat(), NonFinite::Reject).unwrap();
        let points = Points::prepare(&cloud, 2).unwrap();
        let (tree, progress) = (SearchTree::new(&points), Progress::new());
        let nearest = NearestNeighbors::find(&tree, &points, 20, &progress).unwrap();
        let right = frames(&points, &nearest, 2, &progress).unwrap();
        let right_stars = Stars::find(&points, &tree, &nearest, &right, true, &progress).unwrap();
        let astray = points.of_row(30).unwrap();
        let mut wrong = right.clone();
        let axis = Vector3::from_column_slice(right.tangent(astray, 0));
        wrong.turn_to(&[(astray, axis)]);
        let survey = Survey { points: &points, tree: &tree, nearest: &nearest, rules: Rules::default() };

        let mut found = wrong.clone();
        let wrong_stars = Stars::find(&points, &tree, &nearest, &wrong, true, &progress).unwrap();
        assert!(wrong_stars.agreed_share(astray, wrong_stars.of(astray)) < 0.5);
        assert!(right_stars.agreed_share(astray, right_stars.of(astray)) > 0.99);
        let stars = survey.outvoted(wrong_stars, &mut found, &progress).unwrap();
        let cosine = |frames: &crate::geometry::Frames| {
            let [x, y] = [0, 1].map(|axis| Vector3::from_column_slice(frames.tangent(astray, axis)));
            let [a, b] = [0, 1].map(|axis| Vector3::from_column_slice(right.tangent(astray, axis)));
            x.cross(&y).dot(&a.cross(&b)).abs()
        };
        assert!(cosine(&wrong) < 1e-6 && cosine(&found) > 0.99, "{}", cosine(&found));
        let neighbors = |stars: &Stars| {
            let mut all: Vec<u32> = stars.of(astray).iter().map(|spoke| spoke.neighbor).collect();
            all.sort_unstable();
            all
        };
        assert_eq!(neighbors(&stars), neighbors(&right_stars));
    }
}
