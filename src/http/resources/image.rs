//! `GET /jobs/{id}/bases/{basis}/image.png`: the cloud colored by one of its bases.

use axum::extract::{Path, State};
use axum::http::{Extensions, HeaderMap, Method, Uri};
use axum::response::Response;

use crate::http::results::asked::resource;
use crate::http::results::asked::{self, Resource, ResultProblems};
use crate::http::results::view::{self, VIEW};
use crate::http::service::Shared;
use crate::http::wait;
use crate::http::wire::accept::{self, Offer, PNG};
use crate::http::wire::download::{self, Download};
use crate::http::wire::owners;
use crate::http::wire::problem::{Kind, Problem};
use crate::picture::{Legend, Paint, legend_of_basis};

/// What it can be had as.
pub(crate) const OFFERS: [Offer; 1] = [PNG];

resource!(
    /// Query of `GET /jobs/{id}/bases/{basis}/image.png`.
    ReadImage: OFFERS, VIEW
);

/// A picture of a basis.
///
/// Zero is pale, the two signs are blue and orange, rows without a result are grey; which sign has which color is as
/// arbitrary as the sign of a basis. The colors end at the 99.5th percentile of the magnitudes.
#[utoipa::path(
    get,
    path = "/jobs/{id}/bases/{basis}/image.png",
    tag = "results",
    params(
        ("id" = Uuid, Path, description = "The job."),
        ("basis" = u64, Path, description = "Index of the basis, from 0."),
        ReadImage,
    ),
    responses(
        (status = 200, description = "The picture.", body = Vec<u8>, content_type = "image/png", headers(("ETag" = String, description = "Of these bytes."))),
        (status = 304, description = "The client's copy is current."),
        ResultProblems,
    )
)]
pub(crate) async fn image(
    State(service): State<Shared>,
    Path((id, basis)): Path<(String, String)>,
    method: Method,
    uri: Uri,
    headers: HeaderMap,
    extensions: Extensions,
) -> Result<Response, Problem> {
    let arguments = ReadImage::arguments(&uri)?;
    let offer = accept::choose(None, &headers, &OFFERS)?;
    let job = wait::finished(&service, &id, wait::wait(&arguments)).await?;
    let (job, spectrum) = asked::of_eigen(job)?;
    let available = spectrum.eigenvalues.len();
    let index = basis.parse().ok().filter(|index| *index < available).ok_or_else(|| {
        let shown: String = basis.chars().take(20).collect();
        Problem::new(
            Kind::NotFound,
            format!("there is no basis `{shown}`; the job has 0 to {}", available - 1),
        )
        .with("available", available)
    })?;
    let view = view::read(&arguments);
    let tag = asked::tag(job.id, &("image", index, view::key(&view)));
    let record = service.store.cloud(job.cloud_id).await?;
    let bytes = record.bytes() + 8 * record.points + view::bytes(&view, record.points);
    let reservation = service.memory.reserve(owners::owner(&extensions), bytes).await?;
    let cloud = service.store.load_cloud(job.cloud_id).await?;
    let values = service.store.basis(job.id, index).await?;
    let title = format!("basis {index} of job {}", job.id);
    let shown = legend_of_basis(index, spectrum.eigenvalues[index]);
    let draw = move || {
        let legend = Legend { title: &shown, unit: "1/length" };
        view::png_with(&cloud, &Paint::Diverging(&values), &[], &view, (&title, &legend))
    };
    let bytes = service.compute.run(draw).await??;
    let stem = format!("basis-{index}-{}", job.id);
    let download = Download { offer, tag, stem, length: Some(bytes.len() as u64) };
    download.answer(&method, &headers, reservation, |span| download::part(bytes, span))
}
