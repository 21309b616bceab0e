//! Geometric nested dissection: a fill-reducing elimination order from the points' positions.

use std::ops::Range;

use crate::operator::Sparse;

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
pub fn nested_dissection<'a>(matrix: &Sparse, position: impl Fn(u32) -> &'a [f64]) -> Elimination {
    let n = matrix.rows();
    let mut order = Vec::with_capacity(n);
    let mut parts = Vec::new();
    // 0: in neither half; otherwise the number of the split that put it to the right
    let mut right_of = vec![0_u32; n];
    let mut splits = 0;
    // parts still to order, and separators waiting for both of their halves
    let apart = (n >= 2 * PART_MIN).then_some(SPLITS);
    let mut stack = vec![Pending::Part((0..n as u32).collect(), apart)];
    while let Some(pending) = stack.pop() {
        let splits_left;
        let mut part = match pending {
            Pending::Separator(points) => {
                order.extend(points);
                continue;
            }
            Pending::Part(points, apart) => {
                if apart.is_some_and(|left| left == 0 || points.len() < 2 * PART_MIN) {
                    parts.push(order.len()..order.len() + points.len());
                    splits_left = None;
                } else {
                    splits_left = apart.map(|left| left - 1);
                }
                points
            }
        };
        if part.len() <= LEAF {
            order.extend(part);
            continue;
        }
        splits += 1;
        let axis = longest_axis(&part, &position);
        let middle = part.len() / 2;
        part.select_nth_unstable_by(middle, |&i, &j| {
            position(i)[axis].total_cmp(&position(j)[axis]).then(i.cmp(&j))
        });
        let mut right = part.split_off(middle);
        for &i in &right {
            right_of[i as usize] = splits;
        }
        let (separator, mut left): (Vec<u32>, Vec<u32>) = part
            .into_iter()
            .partition(|&i| matrix.neighbors(i as usize).any(|j| right_of[j as usize] == splits));
        if left.is_empty() {
            // everything touches: a clique; any order fills alike
            order.extend(right);
            order.extend(separator);
            continue;
        }
        // selection scrambles; ascending indices keep neighbors together
        left.sort_unstable();
        right.sort_unstable();
        stack.push(Pending::Separator(separator));
        stack.push(Pending::Part(left, splits_left));
        stack.push(Pending::Part(right, splits_left));
    }
    Elimination { order, parts }
}

enum Pending {
    /// Points, and after how many splits their parts are told; none within such a part.
    Part(Vec<u32>, Option<u32>),
    Separator(Vec<u32>),
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
