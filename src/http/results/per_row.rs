//! Results with some numbers for every row of the upload, made from the bases a block of rows at a time.

use std::sync::Arc;

use axum::http::Method;
use axum::response::Response;

use super::offered::Resource;
use super::request::{Harmonics, ResultRequest};
use super::rows::{Table, joined, ply_length};
use crate::harmonics::Block;
use crate::http::wire::accept::{JSON, NPY, PLY};
use crate::http::wire::download::Plan;
use crate::http::wire::problem::Problem;
use crate::jobs::Wanted;
use crate::store::JobRecord;

/// Some numbers for every row, before they are made.
pub(crate) struct PerRow<'a, R> {
    request: &'a ResultRequest<R>,
    plan: Plan<'a>,
    names: Vec<String>,
    is_vector: bool,
}

impl<'a, R: Resource> PerRow<'a, R> {
    /// Columns of these names, as PLY has them; `plan` names their values. A vector, of a single column, is an array of one
    /// axis.
    pub(crate) fn new(
        request: &'a ResultRequest<R>,
        plan: Plan<'a>,
        names: Vec<String>,
        is_vector: bool,
    ) -> Self {
        Self { request, plan, names, is_vector }
    }

    /// The answer that needs neither bases nor memory: to a client that has these bytes already, or wants none (HEAD).
    ///
    /// # Errors
    /// As [`length`].
    pub(crate) async fn without_work(&self, job: &JobRecord) -> Result<Option<Response>, Problem> {
        let length = length(self.request, job, &self.names, self.is_vector).await?;
        Ok(self.plan.without_bytes(length))
    }

    /// The answer. `work` makes the columns of a block of rows, as they are sent; but for JSON all of them are made before,
    /// and `json` writes them.
    ///
    /// # Errors
    /// A problem.
    pub(crate) async fn answer(
        self,
        harmonics: Harmonics,
        work: impl Fn(&Block<Vec<f64>>) -> Vec<Vec<f64>> + Send + Sync + 'static,
        json: impl FnOnce(Vec<Vec<f64>>, &Wanted) -> Result<Vec<u8>, Problem> + Send + 'static,
    ) -> Result<Response, Problem> {
        let Harmonics { job, bases, reservation, .. } = harmonics;
        let (service, rows) = (&self.request.service, bases.rows());
        if self.request.offer == JSON {
            let blocks = bases.map(work).await?;
            let encode = move |wanted: &Wanted| json(joined(blocks, rows), wanted);
            return self.plan.send(reservation, service.pools.answering.run_while_wanted(encode).await??);
        }
        let cloud = match self.request.offer {
            PLY => Some(Arc::new(service.store.load_cloud(job.cloud_id).await?)),
            _ => None,
        };
        let table = Table { cloud, kind: self.request.kind(), is_vector: self.is_vector };
        let (planned, names, work) = (table.clone(), self.names, Arc::new(work));
        let layout = service.pools.answering.run(move || planned.layout(rows, &names)).await?;
        let layout = layout.in_chunks_of(bases.block_rows());
        self.plan.answer(Some(layout.length()), reservation, |span| {
            layout.stream(span, move |chunk| {
                let (bases, work, table) = (bases.clone(), Arc::clone(&work), table.clone());
                async move {
                    let encode = move |block: &Block<Vec<f64>>| table.encode(block.first, &work(block));
                    Ok(bases.of_block(chunk, encode).await?)
                }
            })
        })
    }
}

/// Length in bytes of columns for every row, told for HEAD without the cloud; `None` for other methods, and for text.
///
/// # Errors
/// A problem: the cloud is gone.
pub(crate) async fn length<R: Resource>(
    request: &ResultRequest<R>,
    job: &JobRecord,
    names: &[String],
    is_vector: bool,
) -> Result<Option<u64>, Problem> {
    let kind = request.kind();
    Ok(match request.offer {
        _ if request.method != Method::HEAD => None,
        NPY => Some(Table { cloud: None, kind, is_vector }.layout(job.points as usize, names).length()),
        PLY => Some(ply_length(&request.service.store.cloud(job.cloud_id).await?, names, kind)),
        _ => None,
    })
}
