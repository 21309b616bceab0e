//! Streams bases as files piece by piece, so that no file is held in memory.

use std::ops::Range;
use std::sync::Arc;

use axum::body::{Body, Bytes};
use flate2::Crc;
use futures_util::stream::{self, Stream, StreamExt, TryStreamExt};
use uuid::Uuid;

use crate::cloud::writer::{
    Archive, Column, OpenArchive, axis_name, csv_header, csv_lines, npy_header, npy_vector_header,
    ply_columns,
};
use crate::cloud::{PointCloud, ScalarType};
use crate::http::results::rows::{self, RowLayout, Table, npy_layout};
use crate::http::wire::problem::Problem;
use crate::jobs::Compute;
use crate::store::Store;

/// Numbers of CSV written together: about a megabyte of text.
const CSV_NUMBERS: usize = 1 << 16;

/// Which bases of which job, and how to get at them.
#[derive(Clone)]
pub(crate) struct Selection {
    pub store: Store,
    pub compute: Compute,
    pub job: Uuid,
    /// Rows of the upload.
    pub rows: usize,
    /// Rows that are stored, read and sent together.
    pub chunk_rows: usize,
    /// Indices of the bases.
    pub bases: Range<usize>,
}

impl Selection {
    /// Bytes of memory for the pieces that are made or sent at one time: numbers as they are stored, and as they are sent.
    pub(crate) fn bytes_at_work(&self, kind: ScalarType) -> u64 {
        let numbers = self.chunk_rows.min(self.rows) * self.bases.len();
        (2 * numbers * (size_of::<f64>() + kind.size())) as u64
    }

    /// Names of the columns.
    pub(crate) fn names(&self) -> Vec<String> {
        self.bases.clone().map(|basis| format!("basis_{basis}")).collect()
    }

    async fn columns(&self, chunk: usize) -> Result<Vec<Vec<f64>>, Problem> {
        Ok(self.store.bases_chunk(self.job, self.bases.start, self.bases.len(), chunk).await?)
    }

    /// Rows of a chunk.
    fn rows_of(&self, chunk: usize) -> Range<usize> {
        chunk * self.chunk_rows..((chunk + 1) * self.chunk_rows).min(self.rows)
    }

    /// The bytes of a chunk of rows of a table of the bases.
    pub(crate) async fn chunk(self, chunk: usize, table: Table) -> Result<Vec<u8>, Problem> {
        let values = self.columns(chunk).await?;
        let first = self.rows_of(chunk).start;
        Ok(self.compute.run(move || table.encode(first, &values)).await?)
    }

    /// An archive of `points`, `eigenvalues` (NaN for those that carry no information), `mass`, and `bases`, whose rows
    /// are the layout's.
    pub(crate) fn archive(
        &self,
        cloud: &PointCloud,
        eigenvalues: &[Option<f64>],
        mass: &[f64],
        kind: ScalarType,
    ) -> (RowLayout, OpenArchive) {
        let double = ScalarType::Float64;
        let eigenvalues: Vec<f64> = eigenvalues.iter().map(|lambda| lambda.unwrap_or(f64::NAN)).collect();
        let mut archive = Archive::default();
        archive.add(
            "points",
            &npy_header(cloud.len(), cloud.dimension(), double),
            cloud.coordinates(),
            double,
        );
        archive.add("eigenvalues", &npy_vector_header(eigenvalues.len(), double), &eigenvalues, double);
        archive.add("mass", &npy_vector_header(mass.len(), double), mass, double);
        let layout = npy_layout(self.rows, self.bases.len(), kind);
        let mut layout = layout.in_chunks_of(self.chunk_rows);
        let data_bytes = (layout.stride * layout.rows) as u64;
        let mut open = archive.open("bases", &layout.header, data_bytes);
        layout.header = open.take_head();
        layout.tail = vec![0; open.tail_bytes()];
        (layout, open)
    }

    /// The bytes of a chunk of rows of [`Self::archive`], and their checksum.
    pub(crate) async fn checked_chunk(
        self,
        chunk: usize,
        kind: ScalarType,
    ) -> Result<(Vec<u8>, Crc), Problem> {
        let compute = self.compute.clone();
        let bytes = self.chunk(chunk, Table { cloud: None, kind, is_vector: false }).await?;
        let checked = move || {
            let mut checksum = Crc::new();
            checksum.update(&bytes);
            (bytes, checksum)
        };
        Ok(compute.run(checked).await?)
    }

    /// A line per row: its coordinates, then its bases.
    pub(crate) fn csv(self, cloud: Arc<PointCloud>) -> Body {
        let names: Vec<String> = (0..cloud.dimension()).map(axis_name).chain(self.names()).collect();
        let lines_at_once = (CSV_NUMBERS / names.len()).max(1);
        let chunks = stream::iter(0..self.rows.div_ceil(self.chunk_rows)).then(move |chunk| {
            let (selection, cloud) = (self.clone(), Arc::clone(&cloud));
            async move {
                let values = Arc::new(selection.columns(chunk).await?);
                Ok::<_, Problem>(selection.csv_pieces(chunk, &cloud, &values, lines_at_once))
            }
        });
        let lines = chunks.try_flatten().map_err(|problem| rows::broken(&problem));
        Body::from_stream(stream::iter([Ok(Bytes::from(csv_header(&names)))]).chain(lines))
    }

    /// The lines of a chunk, `lines` of them at once.
    fn csv_pieces(
        self,
        chunk: usize,
        cloud: &Arc<PointCloud>,
        values: &Arc<Vec<Vec<f64>>>,
        lines: usize,
    ) -> impl Stream<Item = Result<Bytes, Problem>> + Send + use<> {
        let (cloud, values) = (Arc::clone(cloud), Arc::clone(values));
        let Range { start: first, end } = self.rows_of(chunk);
        stream::iter((0..end - first).step_by(lines)).then(move |line| {
            let (cloud, values) = (Arc::clone(&cloud), Arc::clone(&values));
            let encode = move || {
                let mut columns = ply_columns(&cloud, first);
                columns.truncate(cloud.dimension());
                let kind = ScalarType::Float64;
                columns.extend(values.iter().map(|values| Column { values, stride: 1, kind }));
                csv_lines(&columns, line..(line + lines).min(end - first))
            };
            let encoded = self.compute.run(encode);
            async move { Ok(Bytes::from(encoded.await?)) }
        })
    }

    /// The whole as JSON, a basis at a time.
    pub(crate) fn json(self, eigenvalues: &str) -> Body {
        let (first, count) = (self.bases.start, self.bases.len());
        let head = format!(
            "{{\"points\":{},\"first\":{first},\"count\":{count},\"eigenvalues\":{eigenvalues},\"bases\":[",
            self.rows
        );
        let bases = stream::iter(self.bases.clone()).then(move |basis| {
            let selection = self.clone();
            async move {
                let text = selection.json_basis(basis).await;
                text.map(Bytes::from).map_err(|problem| rows::broken(&problem))
            }
        });
        let whole = stream::iter([Ok(Bytes::from(head))]).chain(bases).chain(stream::iter([Ok("]}".into())]));
        Body::from_stream(whole)
    }

    async fn json_basis(self, basis: usize) -> Result<Vec<u8>, Problem> {
        let values = self.store.basis(self.job, basis).await?;
        let begin: &[u8] = if basis == self.bases.start { b"" } else { b"," };
        let encode = move || {
            let mut text = begin.to_vec();
            serde_json::to_writer(&mut text, &values).map(|()| text)
        };
        self.compute.run(encode).await?.map_err(|error| Problem::internal(&error))
    }
}
