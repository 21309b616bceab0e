//! Blocks of vectors, one row per point: their numbers, their products with dense and sparse matrices, start vectors.

pub mod block;
pub mod pair;
pub mod scalar;
pub mod shelf;
pub mod single;
pub mod sparse_product;
pub mod start;
mod tiled_file;

pub use block::Block;
pub use tiled_file::{Groups, TILE_ROWS, TILES_HELD};
