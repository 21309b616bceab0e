//! Geometric nested dissection: a fill-reducing elimination order from the points' positions.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering};

use crate::operator::Sparse;
use crate::progress::{Canceled, Progress};

/// Parts of at most this many points are not split further.
const LEAF: usize = 64;

/// Splits after which the parts are worked on side by side, and the fewest points that are worth it.
const SPLITS: u32 = 3;
const PART_MIN: usize = 4_096;

/// An elimination order.
#[derive(Debug, Clone, PartialEq)]
pub struct Elimination {
    /// The row eliminated k-th.
    pub order: Vec<u32>,
    /// Stretches of the order, ascending, of which no row has an entry with a row of another.
    pub parts: Vec<Range<usize>>,
}

impl From<Vec<u32>> for Elimination {
    fn from(order: Vec<u32>) -> Self {
        Self { order, parts: Vec::new() }
    }
}

/// An elimination order of few fill-ins.
///
/// Splits at the median of the longest axis; the separator is those points of the left half that have a neighbor in
/// the right half; both parts come before it. For the 7-point stencil of a surface this leaves about 65 nonzeros a
/// row in the factor at 600,000 points.
///
/// `position(i)` are the coordinates of row `i` of `matrix`.
///
/// # Errors
/// [`Canceled`].
pub fn nested_dissection<'a>(
    matrix: &Sparse,
    position: impl Fn(u32) -> &'a [f64] + Sync,
    progress: &Progress,
) -> Result<Elimination, Canceled> {
    let n = matrix.rows();
    // the number of the split that put a point to the right last; 0 before the first
    let right_of: Vec<AtomicU32> = (0..n).map(|_| AtomicU32::new(0)).collect();
    let dissection = Dissection { matrix, position: &position, right_of: &right_of, progress };
    let apart = (n >= 2 * PART_MIN).then_some(SPLITS);
    dissection.of((0..n as u32).collect(), 1, apart)
}

/// Splits halves side by side. Each looks at the other's marks, of which none is the number of its own split.
struct Dissection<'d, P> {
    matrix: &'d Sparse,
    position: &'d P,
    right_of: &'d [AtomicU32],
    progress: &'d Progress,
}

impl<'a, P: Fn(u32) -> &'a [f64] + Sync> Dissection<'_, P> {
    /// The order of some points, of which the split is number `split`, and after how many splits their parts are told; none
    /// within such a part.
    fn of(&self, mut part: Vec<u32>, split: u32, apart: Option<u32>) -> Result<Elimination, Canceled> {
        let is_part = apart.is_some_and(|left| left == 0 || part.len() < 2 * PART_MIN);
        let parts: Vec<Range<usize>> = is_part.then_some(0..part.len()).into_iter().collect();
        let apart = apart.filter(|_| !is_part).map(|left| left - 1);
        if part.len() <= LEAF {
            return Ok(Elimination { order: part, parts });
        }
        let axis = longest_axis(&part, self.position);
        let middle = part.len() / 2;
        self.progress.leaving(|leave| {
            part.select_nth_unstable_by(middle, |&i, &j| {
                leave.if_canceled();
                (self.position)(i)[axis].total_cmp(&(self.position)(j)[axis]).then(i.cmp(&j))
            });
        })?;
        let mut right = part.split_off(middle);
        for &i in &right {
            self.right_of[i as usize].store(split, Ordering::Relaxed);
        }
        let is_right = |j: u32| self.right_of[j as usize].load(Ordering::Relaxed) == split;
        let (separator, mut left): (Vec<u32>, Vec<u32>) =
            part.into_iter().partition(|&i| self.matrix.neighbors(i as usize).any(is_right));
        if left.is_empty() {
            // everything touches: a clique; any order fills alike
            right.extend(separator);
            return Ok(Elimination { order: right, parts });
        }
        // selection scrambles; ascending indices keep neighbors together
        left.sort_unstable();
        right.sort_unstable();
        let sides = (|| self.of(right, 2 * split, apart), || self.of(left, 2 * split + 1, apart));
        let (all, left) =
            if middle < PART_MIN { (sides.0(), sides.1()) } else { rayon::join(sides.0, sides.1) };
        let (mut all, left) = (all?, left?);
        let offset = all.order.len();
        all.order.extend(left.order);
        all.order.extend(separator);
        all.parts.extend(left.parts.into_iter().map(|part| part.start + offset..part.end + offset));
        Ok(if is_part { Elimination { order: all.order, parts } } else { all })
    }
}

fn longest_axis<'a>(part: &[u32], position: &impl Fn(u32) -> &'a [f64]) -> usize {
    let mut low = position(part[0]).to_vec();
    let mut high = low.clone();
    for &i in part {
        for (axis, &x) in position(i).iter().enumerate() {
            low[axis] = low[axis].min(x);
            high[axis] = high[axis].max(x);
        }
    }
    (0..low.len()).max_by(|&a, &b| (high[a] - low[a]).total_cmp(&(high[b] - low[b]))).unwrap_or(0)
}
