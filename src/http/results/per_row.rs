//! Results with some numbers for every row of the upload, made from the bases a block of rows at a time.

use std::sync::Arc;

use axum::response::Response;
use serde_json::{Map, Value};

use super::offered::Resource;
use super::request::ResultRequest;
use super::rows::{axes, npy_layout, ply_layout};
use crate::cloud::writer::{Column, encode_rows, npy_vector_header, ply_columns, ply_properties};
use crate::cloud::{PointCloud, ScalarType};
use crate::harmonics::Block;
use crate::http::wire::accept::{JSON, PLY};
use crate::http::wire::memory::Reservation;
use crate::http::wire::problem::Problem;
use crate::jobs::StoredBases;
use crate::store::JobRecord;

/// Makes the columns of a block of rows.
type Work = dyn Fn(&Block<Vec<f64>>) -> Vec<Vec<f64>> + Send + Sync;

/// Some numbers for every row.
pub(crate) struct PerRow {
    /// What they are made from.
    pub bases: StoredBases,
    /// Names of the columns, as PLY has them.
    pub names: Vec<String>,
    /// How they are made.
    pub work: Arc<Work>,
    /// A single column is an array of one axis, and in JSON not wrapped in another array.
    pub is_single: bool,
    /// What stands in JSON before the values.
    pub head: Map<String, Value>,
    /// Names the values, beside the job.
    pub tag: String,
    /// Of the file's name.
    pub stem: &'static str,
    /// Held until they are sent.
    pub reservation: Reservation,
}

impl PerRow {
    /// The answer in the format request for; the values are made as they are sent, except for JSON.
    ///
    /// # Errors
    /// A problem.
    pub(crate) async fn answer<R: Resource>(
        mut self,
        request: &ResultRequest<R>,
        job: &JobRecord,
    ) -> Result<Response, Problem> {
        let plan = request.plan(self.tag.clone(), format!("{}-{}", self.stem, job.id));
        if let Some(answer) = plan.unchanged() {
            return Ok(answer);
        }
        let compute = request.service.compute.clone();
        if request.offer == JSON {
            if let Some(answer) = plan.without_work() {
                return Ok(answer);
            }
            let blocks = {
                let work = Arc::clone(&self.work);
                self.bases.map(move |block| work(block)).await?
            };
            let reservation = std::mem::replace(&mut self.reservation, Reservation::small());
            return plan.send(reservation, compute.run(move || self.json(blocks)).await??);
        }
        let cloud = match request.offer {
            PLY => Some(Arc::new(request.service.store.load_cloud(job.cloud_id).await?)),
            _ => None,
        };
        let kind = request.kind();
        let layout = match &cloud {
            None if self.is_single => {
                let mut layout = npy_layout(self.bases.rows(), 1, kind);
                layout.header = npy_vector_header(self.bases.rows(), kind);
                layout
            }
            None => npy_layout(self.bases.rows(), self.names.len(), kind),
            Some(cloud) => {
                let mut properties = ply_properties(cloud);
                properties.truncate(axes(cloud));
                properties.extend(self.names.iter().map(|name| (name.clone(), kind)));
                let cloud = Arc::clone(cloud);
                compute.run(move || ply_layout(&cloud, properties)).await?
            }
        };
        let layout = layout.in_chunks_of(self.bases.block_rows());
        let (bases, work) = (self.bases, self.work);
        plan.answer(Some(layout.length()), self.reservation, |span| {
            layout.stream(span, move |chunk| {
                let (bases, work, cloud) = (bases.clone(), Arc::clone(&work), cloud.clone());
                async move {
                    let encoded = bases
                        .of_block(chunk, move |block| encode(&work(block), block, cloud.as_deref(), kind));
                    Ok(encoded.await?)
                }
            })
        })
    }

    /// The head, then `values`: one array per column.
    fn json(mut self, blocks: Vec<Vec<Vec<f64>>>) -> Result<Vec<u8>, Problem> {
        let mut columns = vec![Vec::with_capacity(self.bases.rows()); self.names.len()];
        for block in blocks {
            for (column, values) in columns.iter_mut().zip(block) {
                column.extend(values);
            }
        }
        let values = if self.is_single { Value::from(columns.swap_remove(0)) } else { Value::from(columns) };
        self.head.insert("values".to_owned(), values);
        serde_json::to_vec(&self.head).map_err(|error| Problem::internal(&error))
    }
}

fn encode(
    values: &[Vec<f64>],
    block: &Block<Vec<f64>>,
    cloud: Option<&PointCloud>,
    kind: ScalarType,
) -> Vec<u8> {
    let mut columns = cloud.map_or_else(Vec::new, |cloud| ply_columns(cloud, block.first));
    columns.truncate(cloud.map_or(0, axes));
    columns.extend(values.iter().map(|values| Column { values, stride: 1, kind }));
    encode_rows(&columns, block.rows())
}
