//! Results of n rows of fixed width, streamed a chunk of rows at a time.

use std::future::Future;
use std::io;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use axum::body::{Body, Bytes};
use flate2::Crc;
use futures_util::stream::{self, Stream, StreamExt};

use crate::cloud::writer::{
    Column, PlyEncoding, PlyHeader, axis_name, encode_faces, encode_rows, npy_header, npy_vector_header,
    ply_columns,
};
use crate::cloud::{PointCloud, ScalarType};
use crate::http::wire::problem::Problem;
use crate::store::{CHUNK_POINTS, CloudRecord};

/// Chunks read and encoded at once, as long as they are not large.
const CHUNKS_AHEAD: usize = 2;
/// Bytes of a chunk from which on one is enough.
const AHEAD_BYTES: u64 = 16 << 20;

/// A file that is a header, n rows of `stride` bytes, and a tail.
#[derive(Debug)]
pub(crate) struct RowLayout {
    /// What stands before the rows.
    pub header: Vec<u8>,
    /// Bytes of a row, at least 1.
    pub stride: usize,
    /// Number of rows n.
    pub rows: usize,
    /// Rows that are made together, at least 1.
    pub chunk_rows: usize,
    /// What stands behind the rows.
    pub tail: Vec<u8>,
}

impl RowLayout {
    /// The same file, made in blocks of rows.
    #[must_use]
    pub(crate) fn in_chunks_of(self, chunk_rows: usize) -> Self {
        Self { chunk_rows, ..self }
    }

    /// Length of the file in bytes.
    #[must_use]
    pub(crate) fn length(&self) -> u64 {
        (self.header.len() + self.tail.len()) as u64 + self.stride as u64 * self.rows as u64
    }

    /// The bytes `span` of the file, where `encode` makes the bytes of a whole chunk.
    ///
    /// An error in the middle breaks the connection off, so that the client sees a short answer for what it is.
    pub(crate) fn stream<F, Encoded>(self, span: Range<u64>, encode: F) -> Body
    where
        F: Fn(usize) -> Encoded + Send + 'static,
        Encoded: Future<Output = Result<Vec<u8>, Problem>> + Send + 'static,
    {
        let (rows, tail) = self.cut(&span);
        let (chunk_bytes, chunks) = (self.chunk_bytes(), self.touched(&rows));
        let tail = part(self.tail, tail, &span);
        let encoded = in_order(chunks, chunk_bytes, encode, move |chunk, bytes| {
            part(bytes, chunk as u64 * chunk_bytes, &rows)
        });
        Body::from_stream(ready(part(self.header, 0, &span)).chain(encoded).chain(ready(tail)))
    }

    /// As [`Self::stream`], for a file that ends with a checksum of its rows: `seal` makes the tail, as long as the
    /// layout's. For a span that reaches into the tail all rows are made, and those before the span are not sent.
    pub(crate) fn stream_sealed<F, Encoded, S>(self, span: Range<u64>, encode: F, seal: S) -> Body
    where
        F: Fn(usize) -> Encoded + Send + 'static,
        Encoded: Future<Output = Result<(Vec<u8>, Crc), Problem>> + Send + 'static,
        S: FnOnce(&Crc) -> Vec<u8> + Send + 'static,
    {
        let (rows, tail) = self.cut(&span);
        let is_sealed = span.end > tail;
        let chunk_bytes = self.chunk_bytes();
        let chunks = if is_sealed { 0..self.rows.div_ceil(self.chunk_rows) } else { self.touched(&rows) };
        let checksum = Arc::new(Mutex::new(Crc::new()));
        let summed = Arc::clone(&checksum);
        let encoded =
            in_order(chunks, chunk_bytes, encode, move |chunk, (bytes, of_chunk): (Vec<u8>, Crc)| {
                summed.lock().unwrap_or_else(PoisonError::into_inner).combine(&of_chunk);
                part(bytes, chunk as u64 * chunk_bytes, &rows)
            });
        let header = part(self.header, 0, &span);
        let sealed = stream::once(async move {
            let bytes = if is_sealed {
                seal(&checksum.lock().unwrap_or_else(PoisonError::into_inner))
            } else {
                Vec::new()
            };
            Ok::<Bytes, io::Error>(part(bytes, tail, &span))
        });
        Body::from_stream(ready(header).chain(encoded).chain(sealed))
    }

    /// What `span` selects of the rows, and where the tail begins.
    fn cut(&self, span: &Range<u64>) -> (Range<u64>, u64) {
        let begin = self.header.len() as u64;
        let length = self.stride as u64 * self.rows as u64;
        let within = |x: u64| x.saturating_sub(begin).min(length);
        (within(span.start)..within(span.end), begin + length)
    }

    fn chunk_bytes(&self) -> u64 {
        (self.chunk_rows * self.stride) as u64
    }

    /// The chunks that the bytes `rows` of all rows lie in.
    fn touched(&self, rows: &Range<u64>) -> Range<usize> {
        (rows.start / self.chunk_bytes()) as usize..rows.end.div_ceil(self.chunk_bytes()) as usize
    }
}

/// What `cut` leaves of every chunk, as `encode` makes them, one ahead of the other.
fn in_order<F, Encoded, T, C>(
    chunks: Range<usize>,
    chunk_bytes: u64,
    encode: F,
    cut: C,
) -> impl Stream<Item = Result<Bytes, io::Error>> + Send + 'static
where
    F: Fn(usize) -> Encoded + Send + 'static,
    Encoded: Future<Output = Result<T, Problem>> + Send + 'static,
    T: Send + 'static,
    C: Fn(usize, T) -> Bytes + Send + 'static,
{
    let ahead = if chunk_bytes > AHEAD_BYTES { 1 } else { CHUNKS_AHEAD };
    let encoded = stream::iter(chunks).map(move |chunk| {
        let encoded = encode(chunk);
        async move { encoded.await.map(|made| (chunk, made)) }
    });
    encoded.buffered(ahead).map(move |made| {
        let (chunk, made) = made.map_err(|problem| broken(&problem))?;
        Ok(cut(chunk, made))
    })
}

fn ready(bytes: Bytes) -> impl Stream<Item = Result<Bytes, io::Error>> + Send + 'static {
    stream::iter([Ok(bytes)])
}

/// What `span` selects of `bytes`, which begin at `begin`.
fn part(bytes: Vec<u8>, begin: u64, span: &Range<u64>) -> Bytes {
    let clip = |x: u64| x.saturating_sub(begin).min(bytes.len() as u64) as usize;
    let (from, to) = (clip(span.start), clip(span.end));
    Bytes::from(bytes).slice(from..to)
}

/// The error that ends a stream early.
pub(crate) fn broken(problem: &Problem) -> io::Error {
    io::Error::other(problem.document(None, None).detail)
}

/// A file with a row for each row of the upload: an array, or with a cloud its points and faces with further columns in PLY.
#[derive(Debug, Clone)]
pub(crate) struct Table {
    /// `None` for an array.
    pub cloud: Option<Arc<PointCloud>>,
    /// Type of the columns.
    pub kind: ScalarType,
    /// Whether its single column is an array of one axis.
    pub is_vector: bool,
}

impl Table {
    /// The file of `rows` rows with columns of these names.
    pub(crate) fn layout(&self, rows: usize, names: &[String]) -> RowLayout {
        let Some(cloud) = &self.cloud else {
            let layout = npy_layout(rows, names.len(), self.kind);
            return if self.is_vector {
                RowLayout { header: npy_vector_header(rows, self.kind), ..layout }
            } else {
                layout
            };
        };
        ply_layout(cloud, properties(cloud.dimension(), cloud.coordinate_type(), names, self.kind))
    }

    /// The bytes of the rows from `first` on, as many as the columns have.
    pub(crate) fn encode(&self, first: usize, values: &[Vec<f64>]) -> Vec<u8> {
        let mut columns = self.cloud.as_deref().map_or_else(Vec::new, |cloud| ply_columns(cloud, first));
        columns.truncate(self.cloud.as_deref().map_or(0, |cloud| axes(cloud.dimension())));
        columns.extend(values.iter().map(|values| Column { values, stride: 1, kind: self.kind }));
        encode_rows(&columns, values.first().map_or(0, Vec::len))
    }
}

/// Length in bytes of [`Table::layout`] in PLY, told without the cloud.
pub(crate) fn ply_length(cloud: &CloudRecord, names: &[String], kind: ScalarType) -> u64 {
    let encoding = PlyEncoding::Binary;
    let properties = properties(cloud.dimension, cloud.coordinate_type, names, kind);
    let header =
        PlyHeader { encoding, points: cloud.points as usize, properties, faces: cloud.faces as usize };
    let face_bytes = encode_faces(&[[0; 3]], encoding).len() as u64;
    header.to_bytes().len() as u64 + header.stride() as u64 * cloud.points + face_bytes * cloud.faces
}

/// Coordinates of a point in PLY: viewers want three at least.
fn axes(dimension: usize) -> usize {
    dimension.max(3)
}

fn properties(
    dimension: usize,
    coordinates: ScalarType,
    names: &[String],
    kind: ScalarType,
) -> Vec<(String, ScalarType)> {
    let axes = (0..axes(dimension)).map(|axis| (axis_name(axis), coordinates));
    axes.chain(names.iter().map(|name| (name.clone(), kind))).collect()
}

/// The columns of all blocks one behind another.
pub(crate) fn joined(blocks: Vec<Vec<Vec<f64>>>, rows: usize) -> Vec<Vec<f64>> {
    let mut columns = vec![Vec::with_capacity(rows); blocks.first().map_or(0, Vec::len)];
    for block in blocks {
        for (column, values) in columns.iter_mut().zip(block) {
            column.extend(values);
        }
    }
    columns
}

/// A NumPy array of `rows` × `columns` numbers, in C order.
#[must_use]
pub(crate) fn npy_layout(rows: usize, columns: usize, kind: ScalarType) -> RowLayout {
    RowLayout {
        header: npy_header(rows, columns, kind),
        stride: columns * kind.size(),
        rows,
        chunk_rows: CHUNK_POINTS,
        tail: Vec::new(),
    }
}

/// A whole NumPy array with these columns of the same length.
#[must_use]
pub(crate) fn npy_file(columns: &[&[f64]], kind: ScalarType) -> Vec<u8> {
    let rows = columns.first().map_or(0, |column| column.len());
    let encoded: Vec<_> = columns.iter().map(|values| Column { values, stride: 1, kind }).collect();
    let mut bytes = npy_header(rows, columns.len(), kind);
    bytes.extend(encode_rows(&encoded, rows));
    bytes
}

/// A binary PLY with these properties of every point, and the cloud's faces.
#[must_use]
pub(crate) fn ply_layout(cloud: &PointCloud, properties: Vec<(String, ScalarType)>) -> RowLayout {
    let encoding = PlyEncoding::Binary;
    let header = PlyHeader { encoding, points: cloud.len(), properties, faces: cloud.faces().len() };
    RowLayout {
        header: header.to_bytes(),
        stride: header.stride(),
        rows: cloud.len(),
        chunk_rows: CHUNK_POINTS,
        tail: encode_faces(cloud.faces(), encoding),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHUNK_ROWS: usize = 1000;

    /// Rows are their own number, four bytes each; then a tail.
    fn layout() -> RowLayout {
        RowLayout {
            header: b"HEADER".to_vec(),
            stride: 4,
            rows: 2 * CHUNK_ROWS + 100,
            chunk_rows: CHUNK_ROWS,
            tail: b"TAIL".to_vec(),
        }
    }

    async fn bytes(span: Range<u64>) -> Vec<u8> {
        let rows = layout().rows;
        let body = layout().stream(span, move |chunk| async move {
            let end = ((chunk + 1) * CHUNK_ROWS).min(rows);
            Ok((chunk * CHUNK_ROWS..end).flat_map(|row| (row as u32).to_le_bytes()).collect())
        });
        axum::body::to_bytes(body, usize::MAX).await.unwrap().to_vec()
    }

    #[tokio::test]
    async fn every_span_is_that_part_of_the_whole() {
        let length = layout().length();
        let whole = bytes(0..length).await;
        assert_eq!(whole.len() as u64, length);
        assert_eq!(&whole[..10], b"HEADER\0\0\0\0");
        let chunk = (CHUNK_ROWS * 4) as u64;
        for span in [
            0..3,
            2..9,
            6..7,
            5 + chunk..8 + chunk,
            6 + chunk..6 + 2 * chunk,
            length - 1..length,
            length - 9..length - 2,
        ] {
            assert_eq!(bytes(span.clone()).await, whole[span.start as usize..span.end as usize], "{span:?}");
        }
    }

    async fn sealed(span: Range<u64>) -> Vec<u8> {
        let rows = layout().rows;
        let encode = move |chunk: usize| async move {
            let end = ((chunk + 1) * CHUNK_ROWS).min(rows);
            let bytes: Vec<u8> =
                (chunk * CHUNK_ROWS..end).flat_map(|row| (row as u32).to_le_bytes()).collect();
            let mut checksum = Crc::new();
            checksum.update(&bytes);
            Ok((bytes, checksum))
        };
        let body = layout().stream_sealed(span, encode, |checksum| checksum.sum().to_be_bytes().to_vec());
        axum::body::to_bytes(body, usize::MAX).await.unwrap().to_vec()
    }

    #[tokio::test]
    async fn every_span_of_a_sealed_file_ends_with_the_checksum_of_all_rows() {
        let length = layout().length();
        let whole = sealed(0..length).await;
        let mut checksum = Crc::new();
        checksum.update(&whole[6..length as usize - 4]);
        assert_eq!(whole[length as usize - 4..], checksum.sum().to_be_bytes());
        let chunk = (CHUNK_ROWS * 4) as u64;
        for span in [0..3, 2..9, 5 + chunk..8 + chunk, length - 9..length - 2, length - 1..length, 7..length]
        {
            assert_eq!(sealed(span.clone()).await, whole[span.start as usize..span.end as usize], "{span:?}");
        }
    }

    #[tokio::test]
    async fn an_error_in_the_middle_breaks_the_answer_off() {
        let body = layout().stream(0..layout().length(), |chunk| async move {
            if chunk == 1 {
                Err(Problem::new(crate::http::wire::problem::Kind::Internal, "damaged"))
            } else {
                Ok(vec![0; CHUNK_ROWS * 4])
            }
        });
        assert!(axum::body::to_bytes(body, usize::MAX).await.is_err());
    }
}
