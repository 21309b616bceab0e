//! The reader of posted functions: NumPy arrays by columns.

#![no_main]

use chladni::cloud::reader::read_columns;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(columns) = read_columns(bytes) {
        assert!(columns.iter().map(Vec::len).sum::<usize>() <= bytes.len());
    }
});
