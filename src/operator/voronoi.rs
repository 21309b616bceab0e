//! Finite volumes on the tangent-space Voronoi cells; ours, not in the papers.
//!
//! `w_pq = |facet_pq| / |p − q|`, on a surface 6 to 7 nonzeros a row. It converges weakly (spectra), not pointwise, and serves the
//! kernel operators as preconditioner and start.

use super::Sparse;
use crate::geometry::Cells;
use crate::progress::{Canceled, Progress};

/// `S` of the finite-volume operator: every wall counts half as seen from either side, so that `S` is symmetric.
///
/// # Errors
/// [`Canceled`].
pub fn stiffness(cells: &Cells, progress: &Progress) -> Result<Sparse, Canceled> {
    let n = cells.volume.len();
    // walls that only the neighbor sees
    let mut unseen: Vec<Vec<(u32, f64)>> = vec![Vec::new(); n];
    for (p, walls) in cells.conductance.iter().enumerate() {
        for &(q, w) in walls {
            let back = &cells.conductance[q as usize];
            if back.binary_search_by_key(&(p as u32), |&(r, _)| r).is_err() {
                unseen[q as usize].push((p as u32, w));
            }
        }
    }
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
            row.extend(unseen[p].iter().map(|&(q, w)| (q, 0.5 * w)));
            // an obtuse triangle at a rim, or views that disagree, leave a negative wall, which would cost the operator
            // its definiteness
            row.retain(|&(_, w)| w > 0.0);
            row.sort_unstable_by_key(|&(q, _)| q);
        },
        |rows| progress.advance(rows as f64 / n as f64),
    )
}
