//! Stored bases on their way into a computation: read in blocks of rows, worked on by the computing threads.

use std::sync::Arc;

use futures_util::stream::{self, StreamExt, TryStreamExt};
use rayon::prelude::*;
use uuid::Uuid;

use super::{Compute, ComputeError};
use crate::harmonics::Block;
use crate::store::{JobRecord, Store, StoreError, StoredCoefficients};

/// Blocks that are read or worked on at once; fewer when a block is larger than [`AHEAD_BYTES`] over this.
const AHEAD: usize = 4;
/// Bytes of all blocks that are read or worked on at once, as long as one fits.
const AHEAD_BYTES: usize = 128 << 20;

/// Bases of at most this size are kept between two passes over them; larger ones are read again.
const KEPT_BYTES_MAX: usize = 256 << 20;

/// Why a computation on stored bases gave nothing.
#[derive(Debug, thiserror::Error)]
pub enum BasesError {
    /// They could not be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The computation panicked.
    #[error(transparent)]
    Compute(#[from] ComputeError),
}

/// All bases of a job that succeeded.
#[derive(Debug, Clone)]
pub struct StoredBases {
    store: Store,
    compute: Compute,
    job: Uuid,
    rows: usize,
    block_rows: usize,
    bases: usize,
    kept: Option<Vec<Arc<Block<Vec<f64>>>>>,
}

impl StoredBases {
    /// The first `bases` bases of a job.
    #[must_use]
    pub fn new(store: Store, compute: Compute, job: &JobRecord, bases: usize) -> Self {
        let (rows, block_rows) = (job.points as usize, job.chunk_points);
        Self { store, compute, job: job.id, rows, block_rows, bases, kept: None }
    }

    /// The first `count` of them only, where they are not kept already.
    #[must_use]
    pub fn first(self, count: usize) -> Self {
        let bases = if self.kept.is_none() { count.min(self.bases) } else { self.bases };
        Self { bases, ..self }
    }

    /// Bytes of memory that a computation on them takes at most: what it keeps between two passes, and the blocks that it
    /// works on.
    #[must_use]
    pub fn bytes_at_work(&self) -> u64 {
        let all = self.rows * self.bases * size_of::<f64>();
        (if all > KEPT_BYTES_MAX { AHEAD_BYTES } else { all }) as u64
    }

    /// Rows of every basis.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Rows of a block; the last may be shorter.
    #[must_use]
    pub fn block_rows(&self) -> usize {
        self.block_rows
    }

    /// Number of blocks.
    #[must_use]
    pub fn blocks(&self) -> usize {
        self.rows.div_ceil(self.block_rows)
    }

    /// What the coordinates and fields of the cloud itself are in them, where that was stored.
    ///
    /// # Errors
    /// [`BasesError`].
    pub async fn coefficients(&self) -> Result<Vec<StoredCoefficients>, BasesError> {
        Ok(self.store.coefficients(self.job).await?)
    }

    /// One block, checksums checked.
    ///
    /// # Errors
    /// [`BasesError`].
    pub async fn block(&self, block: usize) -> Result<Block<Vec<f64>>, BasesError> {
        let columns = self.store.bases_chunk(self.job, 0, self.bases, block).await?;
        Ok(Block { first: block * self.block_rows, columns })
    }

    /// What `work` makes of one block.
    ///
    /// # Errors
    /// [`BasesError`].
    pub async fn of_block<T: Send + 'static>(
        &self,
        block: usize,
        work: impl FnOnce(&Block<Vec<f64>>) -> T + Send + 'static,
    ) -> Result<T, BasesError> {
        let block = self.block(block).await?;
        Ok(self.compute.run(move || work(&block)).await?)
    }

    /// What `work` makes of every block, in their order; few blocks are in memory at once.
    ///
    /// # Errors
    /// [`BasesError`].
    pub async fn map<T, F>(&self, work: F) -> Result<Vec<T>, BasesError>
    where
        T: Send + 'static,
        F: Fn(&Block<Vec<f64>>) -> T + Send + Sync + 'static,
    {
        let work = Arc::new(work);
        if let Some(kept) = self.kept.clone() {
            let all = move || kept.par_iter().map(|block| work(block)).collect();
            return Ok(self.compute.run(all).await?);
        }
        self.streamed(move |block| work(&block)).await
    }

    /// As [`Self::map`]; bases that are small enough are kept for the next pass.
    ///
    /// # Errors
    /// [`BasesError`].
    pub async fn map_and_keep<T, F>(&mut self, work: F) -> Result<Vec<T>, BasesError>
    where
        T: Send + 'static,
        F: Fn(&Block<Vec<f64>>) -> T + Send + Sync + 'static,
    {
        if self.kept.is_some() || self.rows * self.bases * size_of::<f64>() > KEPT_BYTES_MAX {
            return self.map(work).await;
        }
        let with_block = move |block| (work(&block), Arc::new(block));
        let (results, blocks) = self.streamed(with_block).await?.into_iter().unzip();
        self.kept = Some(blocks);
        Ok(results)
    }

    async fn streamed<T, F>(&self, work: F) -> Result<Vec<T>, BasesError>
    where
        T: Send + 'static,
        F: Fn(Block<Vec<f64>>) -> T + Send + Sync + 'static,
    {
        let work = Arc::new(work);
        let block_bytes = self.block_rows.min(self.rows) * self.bases * size_of::<f64>();
        let ahead = (AHEAD_BYTES / block_bytes.max(1)).clamp(1, AHEAD);
        stream::iter(0..self.blocks())
            .map(|block| {
                let work = Arc::clone(&work);
                async move {
                    let block = self.block(block).await?;
                    Ok(self.compute.run(move || work(block)).await?)
                }
            })
            .buffered(ahead)
            .try_collect()
            .await
    }

    /// What `work` makes of every basis by itself, in their order; few bases are in memory at once.
    ///
    /// # Errors
    /// [`BasesError`].
    pub async fn map_columns<T, F>(
        &self,
        bases: std::ops::Range<usize>,
        work: F,
    ) -> Result<Vec<T>, BasesError>
    where
        T: Send + 'static,
        F: Fn(&[f64]) -> T + Send + Sync + 'static,
    {
        let work = Arc::new(work);
        stream::iter(bases)
            .map(|basis| {
                let work = Arc::clone(&work);
                async move {
                    let values = self.store.basis(self.job, basis).await?;
                    Ok(self.compute.run(move || work(&values)).await?)
                }
            })
            .buffered(AHEAD)
            .try_collect()
            .await
    }
}
