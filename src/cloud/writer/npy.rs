//! Headers of NumPy arrays, version 1.0 of the format, little-endian. The numbers behind them come
//! from [`super::encode_rows()`].

use crate::cloud::ScalarType;

/// Header of a `rows × columns` array. Its length is a multiple of 64, so that the numbers can be mapped.
#[must_use]
pub fn npy_header(rows: usize, columns: usize, kind: ScalarType) -> Vec<u8> {
    header(&format!("({rows}, {columns})"), "False", kind)
}

/// Header of a `rows × columns` array that is written column by column (`fortran_order`).
#[must_use]
pub fn npy_header_by_columns(rows: usize, columns: usize, kind: ScalarType) -> Vec<u8> {
    header(&format!("({rows}, {columns})"), "True", kind)
}

/// Header of an array of one axis.
#[must_use]
pub fn npy_vector_header(rows: usize, kind: ScalarType) -> Vec<u8> {
    header(&format!("({rows},)"), "False", kind)
}

fn header(shape: &str, fortran_order: &str, kind: ScalarType) -> Vec<u8> {
    let descr = descr(kind);
    let dictionary = format!("{{'descr': '{descr}', 'fortran_order': {fortran_order}, 'shape': {shape}, }}");
    // Magic word, version and length take ten bytes, the line end one.
    let length = (10 + dictionary.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(dictionary.as_bytes());
    bytes.resize(10 + length - 1, b' ');
    bytes.push(b'\n');
    bytes
}

const fn descr(kind: ScalarType) -> &'static str {
    match kind {
        ScalarType::Int8 => "|i1",
        ScalarType::Uint8 => "|u1",
        ScalarType::Int16 => "<i2",
        ScalarType::Uint16 => "<u2",
        ScalarType::Int32 => "<i4",
        ScalarType::Uint32 => "<u4",
        ScalarType::Float32 => "<f4",
        ScalarType::Float64 => "<f8",
    }
}
