//! Supernodes of a sparse Cholesky factor: stretches of columns that share the rows of their entries.

use std::ops::Range;

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;

/// Most columns of a supernode: between two of them a cancellation is looked for, and the widest of 600,000 points takes
/// 1.7 s. Neither factors nor solves are any slower for it.
const COLUMNS_MAX: usize = 512;

/// Where the entries of a factor are, and which supernodes do not depend on each other.
pub(super) struct Supernodes {
    /// First column of every supernode, and the number of columns.
    begin: Vec<u32>,
    /// Rows of the entries below the diagonal block, ascending, supernode by supernode.
    rows: Vec<u32>,
    row_offsets: Vec<usize>,
    /// Where the entries begin: column by column, first those of the diagonal block.
    value_offsets: Vec<usize>,
    /// What every supernode is updated by, by the earlier supernodes that have entries in its rows.
    updates: Vec<Update>,
    update_offsets: Vec<usize>,
    /// Stretches of supernodes of which none has an entry in the rows of another, in ascending order.
    parts: Vec<Range<usize>>,
    /// Supernodes in none of the parts.
    top: Vec<usize>,
    /// Number of every row among those of `top`, or `u32::MAX`.
    top_place: Vec<u32>,
    top_rows: usize,
}

/// An earlier supernode with entries in the rows of a later one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Update {
    /// The earlier one.
    pub source: u32,
    /// Which of its rows below its own block are among the later one's columns.
    pub first: u32,
    pub end: u32,
}

/// One supernode.
#[derive(Debug, Clone, Copy)]
pub(super) struct Supernode<'a> {
    /// First of its columns.
    pub start: usize,
    /// Number of its columns.
    pub width: usize,
    /// Rows of the entries below its own columns.
    pub below: &'a [u32],
}

impl Supernode<'_> {
    pub(super) fn end(&self) -> usize {
        self.start + self.width
    }

    /// Entries of one column.
    pub(super) fn height(&self) -> usize {
        self.width + self.below.len()
    }
}

impl Supernodes {
    /// Reads faer's analysis, and cuts wide supernodes into several; `parts` are stretches of columns that do not touch
    /// each other.
    pub(super) fn new(symbolic: &SymbolicSupernodalCholesky<u32>, parts: &[Range<usize>]) -> Self {
        let n = symbolic.supernode_end().last().map_or(0, |&end| end as usize);
        let mut begin = Vec::new();
        let mut rows = Vec::new();
        let mut row_offsets = vec![0];
        for (s, (&start, &end)) in symbolic.supernode_begin().iter().zip(symbolic.supernode_end()).enumerate()
        {
            let first = symbolic.col_ptr_for_row_idx()[s] as usize;
            let below = &symbolic.row_idx()[first..][..symbolic.nnz_per_super()[s] as usize];
            let pieces = (end - start).div_ceil(COLUMNS_MAX as u32).max(1);
            let boundary = |piece: u32| start + (end - start) * piece / pieces;
            for piece in 0..pieces {
                begin.push(boundary(piece));
                rows.extend(boundary(piece + 1)..end);
                rows.extend_from_slice(below);
                row_offsets.push(rows.len());
            }
        }
        let count = begin.len();
        begin.push(n as u32);
        let mut value_offsets = vec![0];
        for s in 0..count {
            let width = (begin[s + 1] - begin[s]) as usize;
            value_offsets.push(value_offsets[s] + width * (width + row_offsets[s + 1] - row_offsets[s]));
        }
        let nodes = |columns: &Range<usize>| {
            let first = begin[..count].partition_point(|&b| (b as usize) < columns.start);
            first..begin[1..].partition_point(|&end| end as usize <= columns.end).max(first)
        };
        let parts: Vec<Range<usize>> = parts.iter().map(nodes).collect();
        let mut top: Vec<usize> = Vec::new();
        let mut next = 0;
        for part in parts.iter().chain([&(count..count)]) {
            top.extend(next..part.start);
            next = part.end;
        }
        let mut top_place = vec![u32::MAX; n];
        let mut top_rows = 0;
        for row in top.iter().flat_map(|&s| begin[s]..begin[s + 1]) {
            top_place[row as usize] = top_rows;
            top_rows += 1;
        }
        let mut nodes = Self {
            begin,
            rows,
            row_offsets,
            value_offsets,
            updates: Vec::new(),
            update_offsets: Vec::new(),
            parts,
            top,
            top_place,
            top_rows: top_rows as usize,
        };
        nodes.find_updates();
        nodes
    }

    fn find_updates(&mut self) {
        let mut node_of = vec![0_u32; self.top_place.len()];
        for s in 0..self.len() {
            node_of[self.begin[s] as usize..self.begin[s + 1] as usize].fill(s as u32);
        }
        // calls `found(target, update)` in ascending order of sources
        let each = |found: &mut dyn FnMut(usize, Update)| {
            for source in 0..self.len() {
                let below = self.node(source).below;
                let mut first = 0;
                while first < below.len() {
                    let target = node_of[below[first] as usize];
                    let rows = below[first..].partition_point(|&row| node_of[row as usize] == target);
                    let end = first + rows;
                    found(
                        target as usize,
                        Update { source: source as u32, first: first as u32, end: end as u32 },
                    );
                    first = end;
                }
            }
        };
        let mut offsets = vec![0_usize; self.len() + 1];
        each(&mut |target, _| offsets[target + 1] += 1);
        for s in 0..self.len() {
            offsets[s + 1] += offsets[s];
        }
        let mut next = offsets.clone();
        let mut updates = vec![Update { source: 0, first: 0, end: 0 }; offsets[self.len()]];
        each(&mut |target, update| {
            updates[next[target]] = update;
            next[target] += 1;
        });
        (self.updates, self.update_offsets) = (updates, offsets);
    }

    /// Number of supernodes.
    pub(super) fn len(&self) -> usize {
        self.begin.len() - 1
    }

    /// Entries of the factor.
    pub(super) fn entries(&self) -> usize {
        self.value_offsets[self.len()]
    }

    /// Number of rows of the matrix.
    pub(super) fn rows(&self) -> usize {
        self.top_place.len()
    }

    pub(super) fn node(&self, s: usize) -> Supernode<'_> {
        let start = self.begin[s] as usize;
        Supernode {
            start,
            width: self.begin[s + 1] as usize - start,
            below: &self.rows[self.row_offsets[s]..self.row_offsets[s + 1]],
        }
    }

    /// Where the entries of a supernode are in the factor.
    pub(super) fn values(&self, s: usize) -> Range<usize> {
        self.value_offsets[s]..self.value_offsets[s + 1]
    }

    /// The same of a stretch of supernodes.
    pub(super) fn values_of(&self, nodes: &Range<usize>) -> Range<usize> {
        self.value_offsets[nodes.start]..self.value_offsets[nodes.end]
    }

    /// Columns of a stretch of supernodes.
    pub(super) fn columns_of(&self, nodes: &Range<usize>) -> Range<usize> {
        self.begin[nodes.start] as usize..self.begin[nodes.end] as usize
    }

    /// What supernode `s` is updated by.
    pub(super) fn updates(&self, s: usize) -> &[Update] {
        &self.updates[self.update_offsets[s]..self.update_offsets[s + 1]]
    }

    /// Every part with its stretch of `x`, where `span` tells which that is.
    pub(super) fn by_parts<'x, T>(
        &self,
        mut x: &'x mut [T],
        span: impl Fn(&Range<usize>) -> Range<usize>,
    ) -> Vec<(Range<usize>, &'x mut [T])> {
        let mut taken = 0;
        let take = |part: &Range<usize>| {
            let span = span(part);
            let (own, rest) = std::mem::take(&mut x)[span.start - taken..].split_at_mut(span.len());
            (x, taken) = (rest, span.end);
            (part.clone(), own)
        };
        self.parts.iter().map(take).collect()
    }

    /// Columns of the widest supernode.
    pub(super) fn widest(&self) -> usize {
        self.begin.windows(2).map(|pair| (pair[1] - pair[0]) as usize).max().unwrap_or(0)
    }

    /// Supernodes in none of the parts.
    pub(super) fn top(&self) -> &[usize] {
        &self.top
    }

    /// Number of rows of the supernodes in none of the parts.
    pub(super) fn top_rows(&self) -> usize {
        self.top_rows
    }

    /// Which of them `row` is.
    pub(super) fn top_place(&self, row: usize) -> usize {
        self.top_place[row] as usize
    }
}
