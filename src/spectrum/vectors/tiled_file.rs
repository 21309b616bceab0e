//! A matrix in single precision in a file: rows cut into tiles, and every tile into groups of columns, so that some columns of all
//! rows and all columns of some rows both lie in runs of tens of kilobytes.

use std::cell::Cell;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::block::Block;

/// Rows of a tile: along the curve that orders the points, most neighbors of a row lie in its own.
pub const TILE_ROWS: usize = 1_024;

/// Tiles that are kept in memory, and those with what is looked at on two threads.
const TILES_KEPT: usize = 24;
pub const TILES_HELD: usize = 2 * TILES_KEPT;

/// How columns are grouped: those before `first` and those from there on, each in groups of `width` of which the last may have
/// fewer.
#[derive(Debug, Clone, Copy)]
pub struct Groups {
    /// Where a group begins in any case.
    pub first: usize,
    /// At least one.
    pub width: usize,
}

impl Groups {
    /// The groups of so many columns.
    #[must_use]
    pub fn of(self, columns: usize) -> Vec<Range<usize>> {
        let first = self.first.min(columns);
        let cut = |from: usize, end: usize| {
            (from..end).step_by(self.width).map(move |start| start..end.min(start + self.width))
        };
        cut(0, first).chain(cut(first, columns)).collect()
    }

    /// The group of so many columns that has column `j`.
    #[must_use]
    pub fn with(self, j: usize, columns: usize) -> Range<usize> {
        let (from, end) = if j < self.first { (0, self.first.min(columns)) } else { (self.first, columns) };
        let start = j - (j - from) % self.width;
        start..end.min(start + self.width)
    }
}

/// The file, with the tiles that were read last.
#[derive(Debug)]
pub(super) struct TiledFile {
    file: Mutex<File>,
    rows: usize,
    columns: usize,
    groups: Groups,
    kept: Mutex<VecDeque<(usize, Arc<Block<f32>>)>>,
}

/// Lends the thread's buffer: of thousands of runs every one would take memory from the system anew.
fn with_bytes<R>(length: usize, work: impl FnOnce(&mut [u8]) -> R) -> R {
    thread_local! {
        static BYTES: Cell<Vec<u8>> = const { Cell::new(Vec::new()) };
    }
    let mut bytes = BYTES.take();
    bytes.resize(length, 0);
    let result = work(&mut bytes);
    BYTES.set(bytes);
    result
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl TiledFile {
    pub(super) fn new(file: File, rows: usize, columns: usize, groups: Groups) -> Self {
        Self { file: Mutex::new(file), rows, columns, groups, kept: Mutex::default() }
    }

    /// Number of tiles.
    pub(super) fn tiles(&self) -> usize {
        self.rows.div_ceil(TILE_ROWS)
    }

    /// The rows of a tile.
    pub(super) fn rows_of(&self, tile: usize) -> Range<usize> {
        tile * TILE_ROWS..self.rows.min((tile + 1) * TILE_ROWS)
    }

    /// Tells that what was kept is about to change.
    pub(super) fn forget(&self) {
        locked(&self.kept).clear();
    }

    /// Reads the columns of a group, or the first of them, into rows of `width` numbers.
    pub(super) fn read(
        &self,
        tile: usize,
        columns: Range<usize>,
        values: &mut [f32],
        width: usize,
    ) -> io::Result<()> {
        let (place, length, all) = self.run(tile, columns.start);
        with_bytes(length, |bytes| {
            {
                let mut file = locked(&self.file);
                file.seek(SeekFrom::Start(place))?;
                file.read_exact(bytes)?;
            }
            for (row, bytes) in values.chunks_mut(width).zip(bytes.chunks_exact(all * size_of::<f32>())) {
                let numbers = row[..columns.len()].iter_mut().zip(bytes.as_chunks().0);
                numbers.for_each(|(x, bytes)| *x = f32::from_le_bytes(*bytes));
            }
            Ok(())
        })
    }

    /// Writes the columns of a group, or the first of them, from rows of `width` numbers.
    pub(super) fn write(
        &self,
        tile: usize,
        columns: Range<usize>,
        values: &[f32],
        width: usize,
    ) -> io::Result<()> {
        let (place, length, all) = self.run(tile, columns.start);
        with_bytes(length, |bytes| {
            for (row, bytes) in values.chunks(width).zip(bytes.chunks_exact_mut(all * size_of::<f32>())) {
                let numbers = row[..columns.len()].iter().zip(bytes.as_chunks_mut().0);
                numbers.for_each(|(x, bytes)| *bytes = x.to_le_bytes());
            }
            let mut file = locked(&self.file);
            file.seek(SeekFrom::Start(place))?;
            file.write_all(bytes)
        })
    }

    /// The first `columns` columns of a tile.
    pub(super) fn tile(&self, tile: usize, columns: usize) -> io::Result<Block<f32>> {
        let rows = self.rows_of(tile).len();
        let mut block = Block::zeros(rows, columns);
        for group in self.groups.of(columns) {
            block
                .with_values(|values| self.read(tile, group.clone(), &mut values[group.start..], columns))?;
        }
        Ok(block)
    }

    /// The same, kept for whoever asks next.
    pub(super) fn kept_tile(&self, tile: usize, columns: usize) -> io::Result<Arc<Block<f32>>> {
        let found = |kept: &VecDeque<(usize, Arc<Block<f32>>)>| {
            kept.iter().rev().find(|(other, _)| *other == tile).map(|(_, block)| Arc::clone(block))
        };
        if let Some(block) = found(&locked(&self.kept)) {
            return Ok(block);
        }
        let block = Arc::new(self.tile(tile, columns)?);
        let mut kept = locked(&self.kept);
        if kept.len() == TILES_KEPT {
            kept.pop_front();
        }
        kept.push_back((tile, Arc::clone(&block)));
        Ok(block)
    }

    /// Where the run of a tile's group is that begins with column `from`, its bytes, and the group's columns.
    fn run(&self, tile: usize, from: usize) -> (u64, usize, usize) {
        let rows = self.rows_of(tile);
        let columns = self.groups.with(from, self.columns).len();
        let before = rows.start as u64 * self.columns as u64 + (rows.len() * from) as u64;
        (size_of::<f32>() as u64 * before, size_of::<f32>() * rows.len() * columns, columns)
    }
}
