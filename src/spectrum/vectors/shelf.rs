//! Many vectors in single precision, in memory or, where there is no room for them, in a file.
//!
//! They are worked on in groups of neighboring columns, or all columns of some rows at a time. Numbers, and what is made of them,
//! are the same in both places, bit for bit.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::block::{Block, Columns};
use super::tiled_file::{Groups, TILE_ROWS, TiledFile};
use crate::progress::Progress;
use crate::spectrum::SpectrumError;

/// Vectors, one a column.
#[derive(Debug)]
pub struct Shelf {
    rows: usize,
    columns: usize,
    groups: Groups,
    place: Place,
}

#[derive(Debug)]
enum Place {
    Memory(Block<f32>),
    File(InFile),
}

#[derive(Debug)]
struct InFile {
    file: TiledFile,
    /// A group's block that is not in use.
    spare: Option<Block<f32>>,
    /// The group that was read last, and its first column.
    read: Mutex<Option<(usize, Arc<Block<f32>>)>>,
}

/// A group of columns that was read.
#[derive(Debug)]
pub enum Read<'a> {
    /// Where it is.
    InPlace(Columns<'a, f32>),
    /// From the file.
    Read(Arc<Block<f32>>),
}

impl Read<'_> {
    /// Its columns.
    #[must_use]
    pub fn columns(&self) -> Columns<'_, f32> {
        match self {
            Self::InPlace(columns) => *columns,
            Self::Read(block) => block.columns_from(0, block.columns()),
        }
    }
}

/// A group of columns that is worked on.
#[must_use = "what is not put back is lost"]
pub struct Group {
    columns: Range<usize>,
    /// Absent where they are worked on in their place.
    block: Option<Block<f32>>,
}

/// Rows of a shelf with all of their columns.
pub enum View<'a> {
    /// All rows.
    Memory(Columns<'a, f32>),
    /// Those in some tiles.
    Tiles(Vec<Option<Arc<Block<f32>>>>),
}

impl View<'_> {
    /// Row `i`.
    ///
    /// # Panics
    /// When it was not asked for.
    #[inline]
    #[must_use]
    #[expect(clippy::expect_used, reason = "documented")]
    pub fn row(&self, i: usize) -> &[f32] {
        match self {
            Self::Memory(columns) => columns.row(i),
            Self::Tiles(tiles) => {
                tiles[i / TILE_ROWS].as_ref().expect("a row that was asked for").row(i % TILE_ROWS)
            }
        }
    }
}

impl Shelf {
    /// Zeros in memory.
    #[must_use]
    pub fn in_memory(rows: usize, columns: usize, groups: Groups) -> Self {
        Self::of(Block::zeros(rows, columns), groups)
    }

    /// The columns of a block.
    #[must_use]
    pub fn of(block: Block<f32>, groups: Groups) -> Self {
        Self { rows: block.rows(), columns: block.columns(), groups, place: Place::Memory(block) }
    }

    /// Room in an empty file; nothing may be read before it was stored.
    #[must_use]
    pub fn in_file(file: File, rows: usize, columns: usize, groups: Groups) -> Self {
        let file = TiledFile::new(file, rows, columns, groups);
        let place = Place::File(InFile { file, spare: None, read: Mutex::default() });
        Self { rows, columns, groups, place }
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns in use.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Uses the first `columns` columns only.
    ///
    /// # Panics
    /// When there are fewer.
    pub fn set_columns(&mut self, columns: usize) {
        assert!(columns <= self.columns, "{} columns have no first {columns}", self.columns);
        self.columns = columns;
        match &mut self.place {
            Place::Memory(block) => block.set_columns(columns),
            Place::File(in_file) => in_file.forget(),
        }
    }

    /// The columns in use, group by group.
    #[must_use]
    pub fn groups(&self) -> Vec<Range<usize>> {
        self.groups.of(self.columns)
    }

    /// Takes a group to work on.
    ///
    /// # Errors
    /// [`SpectrumError::Canceled`], [`SpectrumError::Scratch`].
    pub fn take(&mut self, columns: Range<usize>, progress: &Progress) -> Result<Group, SpectrumError> {
        let (rows, most) = (self.rows, self.groups.width);
        let block = match &mut self.place {
            Place::Memory(_) => None,
            Place::File(InFile { file, spare, .. }) => {
                let mut block = spare.take().unwrap_or_else(|| Block::zeros(rows, most));
                read_group(file, columns.clone(), &mut block, progress)?;
                Some(block)
            }
        };
        Ok(Group { columns, block })
    }

    /// The columns of a group.
    #[must_use]
    pub fn columns_of<'a>(&'a self, Group { columns, block }: &'a Group) -> Columns<'a, f32> {
        match (&self.place, block) {
            (Place::Memory(all), None) => all.columns_from(columns.start, columns.len()),
            (_, Some(block)) => block.columns_from(0, columns.len()),
            (Place::File(..), None) => unreachable!("a group of a file is in a block"),
        }
    }

    /// Changes every row of a group in place, in parallel.
    pub fn change(&mut self, group: &mut Group, change: impl Fn(usize, &mut [f32]) + Sync + Send) {
        let Group { columns, block } = group;
        match (&mut self.place, block) {
            (Place::Memory(all), None) => all.for_each_row(|i, row| change(i, &mut row[columns.clone()])),
            (_, Some(block)) => block.for_each_row(change),
            (Place::File(..), None) => unreachable!("a group of a file is in a block"),
        }
    }

    /// Puts a group back that may have been changed.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn put(&mut self, Group { columns, block }: Group, progress: &Progress) -> Result<(), SpectrumError> {
        let Some(block) = block else { return Ok(()) };
        self.store(columns, &block, progress)?;
        self.keep(block);
        Ok(())
    }

    /// Puts a group back that was only read.
    pub fn put_unchanged(&mut self, group: Group) {
        if let Some(block) = group.block {
            self.keep(block);
        }
    }

    fn keep(&mut self, block: Block<f32>) {
        if let Place::File(in_file) = &mut self.place {
            in_file.spare = Some(block);
        }
    }

    /// Makes the columns of a block those of a group.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn store(
        &mut self,
        columns: Range<usize>,
        block: &Block<f32>,
        progress: &Progress,
    ) -> Result<(), SpectrumError> {
        match &mut self.place {
            Place::Memory(all) => all.copy_columns(columns.start, block, 0, columns.len()),
            Place::File(in_file) => {
                in_file.forget();
                let file = &in_file.file;
                (0..file.tiles()).into_par_iter().try_for_each(|tile| {
                    progress.checkpoint()?;
                    let (values, width) = block.rows_from(file.rows_of(tile));
                    Ok::<_, SpectrumError>(file.write(tile, columns.clone(), values, width)?)
                })?;
            }
        }
        Ok(())
    }

    /// The group that has column `j`, and the column's place in it. Columns that follow each other are best asked for one after
    /// the other.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn read(&self, j: usize, progress: &Progress) -> Result<(Read<'_>, usize), SpectrumError> {
        let columns = self.groups.with(j, self.columns);
        let place = j - columns.start;
        let in_file = match &self.place {
            Place::Memory(all) => {
                return Ok((Read::InPlace(all.columns_from(columns.start, columns.len())), place));
            }
            Place::File(in_file) => in_file,
        };
        // Whoever asks for a column of the same group meanwhile waits for it. Nothing is done in parallel here: a thread that
        // waits for a part of its work may be given other work, which asks for a column too.
        let mut read = in_file.read.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((first, block)) = &*read
            && *first == columns.start
        {
            return Ok((Read::Read(Arc::clone(block)), place));
        }
        let mut block = Block::zeros(self.rows, columns.len());
        let file = &in_file.file;
        block.with_values(|values| {
            let tiles = values.chunks_mut((TILE_ROWS * columns.len()).max(1)).enumerate();
            tiles.into_iter().try_for_each(|(tile, values)| {
                progress.checkpoint()?;
                Ok::<_, SpectrumError>(file.read(tile, columns.clone(), values, columns.len())?)
            })
        })?;
        let block = Arc::new(block);
        *read = Some((columns.start, Arc::clone(&block)));
        Ok((Read::Read(block), place))
    }

    /// What `read` makes of row `i`. Rows that follow each other are best asked for one after the other.
    ///
    /// # Errors
    /// Those of the file.
    pub fn with_row<R>(&self, i: usize, read: impl FnOnce(&[f32]) -> R) -> io::Result<R> {
        match &self.place {
            Place::Memory(block) => Ok(read(block.row(i))),
            Place::File(in_file) => {
                let tile = in_file.file.kept_tile(i / TILE_ROWS, self.columns)?;
                Ok(read(tile.row(i % TILE_ROWS)))
            }
        }
    }

    /// Rows with all columns in use.
    ///
    /// # Errors
    /// Those of the file.
    pub fn view(&self, rows: impl IntoIterator<Item = usize>) -> io::Result<View<'_>> {
        let file = match &self.place {
            Place::Memory(block) => return Ok(View::Memory(block.columns_from(0, self.columns))),
            Place::File(in_file) => &in_file.file,
        };
        let mut tiles: Vec<Option<Arc<Block<f32>>>> = vec![None; file.tiles()];
        for i in rows {
            let tile = &mut tiles[i / TILE_ROWS];
            if tile.is_none() {
                *tile = Some(file.kept_tile(i / TILE_ROWS, self.columns)?);
            }
        }
        Ok(View::Tiles(tiles))
    }

    /// Changes every stretch of rows in place, in parallel: the number of its first row, and the rows, each the columns in use
    /// at the beginning of a width, which is passed on.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn for_each_stretch(
        &mut self,
        progress: &Progress,
        change: impl Fn(usize, &mut [f32], usize) + Sync + Send,
    ) -> Result<(), SpectrumError> {
        let (columns, groups) = (self.columns, self.groups());
        let in_file = match &mut self.place {
            Place::Memory(block) => {
                block.for_each_stretch(|first, values, width| {
                    if !progress.is_canceled() {
                        change(first, values, width);
                    }
                });
                return Ok(progress.checkpoint()?);
            }
            Place::File(in_file) => in_file,
        };
        in_file.forget();
        let file = &in_file.file;
        (0..file.tiles()).into_par_iter().try_for_each(|tile| {
            progress.checkpoint()?;
            let (first, mut block) = (file.rows_of(tile).start, file.tile(tile, columns)?);
            block.with_values(|values| change(first, values, columns));
            groups.iter().try_for_each(|group| {
                let (values, width) = block.rows_from(0..block.rows());
                Ok(file.write(tile, group.clone(), &values[group.start..], width)?)
            })
        })
    }
}

impl InFile {
    /// Tells that what was read is about to change.
    fn forget(&mut self) {
        self.file.forget();
        *self.read.get_mut().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

/// Reads a group's columns, which the block then has.
fn read_group(
    file: &TiledFile,
    columns: Range<usize>,
    block: &mut Block<f32>,
    progress: &Progress,
) -> Result<(), SpectrumError> {
    block.set_columns(columns.len());
    let read = block.map_tiles(TILE_ROWS, |first, values, width| {
        progress.checkpoint()?;
        Ok(file.read(first / TILE_ROWS, columns.clone(), values, width)?)
    });
    read.into_iter().collect()
}

#[cfg(test)]
mod tests;
