//! Finite volumes on the tangent-space Voronoi cells; ours, not in the papers.
//!
//! `w_pq = |facet_pq| / |p − q|`, on a surface 6 to 7 nonzeros a row. It converges weakly (spectra), not pointwise, and serves the
//! kernel operators as preconditioner and start.

use rayon::prelude::*;

use super::Sparse;
use crate::geometry::Cells;
use crate::progress::{Canceled, Progress};

/// `S` of the finite-volume operator: every wall counts half as seen from either side, so that `S` is symmetric.
///
/// # Errors
/// [`Canceled`].
pub fn stiffness(cells: &Cells, progress: &Progress) -> Result<Sparse, Canceled> {
    let n = cells.volume.len();
    // walls that only the neighbor sees: few, by point and neighbor
    let one_sided = |p: usize| {
        let walls = if progress.is_canceled() { &[][..] } else { &cells.conductance[p] };
        let is_seen_back = move |q: u32| {
            cells.conductance[q as usize].binary_search_by_key(&(p as u32), |&(r, _)| r).is_ok()
        };
        walls.iter().filter(move |(q, _)| !is_seen_back(*q)).map(move |&(q, w)| (q, p as u32, w))
    };
    let mut unseen: Vec<(u32, u32, f64)> =
        (0..n).into_par_iter().with_min_len(1 << 12).flat_map_iter(one_sided).collect();
    progress.leaving(|leave| {
        unseen.par_sort_unstable_by_key(|&(q, p, _)| {
            leave.if_canceled();
            (q, p)
        });
    })?;
    Sparse::stiffness(
        n,
        || (),
        |p, (), row| {
            for &(q, w) in &cells.conductance[p] {
                let back = &cells.conductance[q as usize];
                let seen_back =
                    back.binary_search_by_key(&(p as u32), |&(r, _)| r).map_or(0.0, |k| back[k].1);
                row.push((q, 0.5 * (w + seen_back)));
            }
            let first = unseen.partition_point(|&(q, ..)| (q as usize) < p);
            let own = unseen[first..].iter().take_while(|&&(q, ..)| q as usize == p);
            row.extend(own.map(|&(_, q, w)| (q, 0.5 * w)));
            // an obtuse triangle at a rim, or views that disagree, leave a negative wall, which would cost the operator
            // its definiteness
            row.retain(|&(_, w)| w > 0.0);
            row.sort_unstable_by_key(|&(q, _)| q);
        },
        |rows| progress.advance(rows as f64 / n as f64),
    )
}
