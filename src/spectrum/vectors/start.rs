//! Start vectors that depend on nothing but point and column, so that results repeat bit for bit.

use super::block::Block;

/// A number in [−1, 1) from a hash of point and column (the finaliser of `SplitMix64`).
#[must_use]
pub fn hashed(point: usize, column: usize) -> f64 {
    let mut z = (point as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (column as u64).wrapping_mul(0xD1B5_4A32_D192_ED03);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^= z >> 31;
    (z >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Fills a block with hashed numbers; `first` numbers its columns.
pub fn fill(block: &mut Block, first: usize) {
    block.for_each_row(|i, row| {
        for (j, x) in row.iter_mut().enumerate() {
            *x = hashed(i, first + j);
        }
    });
}
