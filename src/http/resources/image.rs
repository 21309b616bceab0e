//! `GET /jobs/{id}/bases/{basis}/image.png`: the cloud colored by one of its bases.

use axum::extract::Path;
use axum::response::Response;

use crate::arguments::groups;
use crate::http::results::offered::offered;
use crate::http::results::request::{self, ResultRequest};
use crate::http::results::view;
use crate::http::wire::accept::PNG;
use crate::http::wire::problem::{Kind, Problem};
use crate::http::wire::problem_sets::ResultProblems;
use crate::jobs::Wanted;
use crate::picture::{Legend, Paint, View, legend_of_basis};

groups! {
    /// Query of `GET /jobs/{id}/bases/{basis}/image.png`.
    #[derive(Debug)]
    pub(crate) struct ReadImage {
        /// Of the picture.
        view: View,
    }
}

offered!(ReadImage: [PNG] by view, "A picture.");

/// A picture of a basis.
///
/// Zero is pale, the two signs are blue and orange, rows without a result are gray; which sign has which color is as
/// arbitrary as the sign of a basis. The colors end at the 99.5th percentile of the magnitudes.
#[utoipa::path(
    get,
    path = "/jobs/{id}/bases/{basis}/image.png",
    tag = "results",
    params(
        ("id" = Uuid, Path, description = "The job."),
        ("basis" = u64, Path, description = "Index of the basis, from 0."),
        ResultRequest<ReadImage>,
    ),
    responses(
        (status = 200, description = "The picture.", body = Vec<u8>, content_type = "image/png", headers(("ETag" = String, description = "Of these bytes."))),
        (status = 304, description = "The client's copy is current."),
        ResultProblems,
    )
)]
pub(crate) async fn image(
    Path((_id, basis)): Path<(String, String)>,
    request: ResultRequest<ReadImage>,
) -> Result<Response, Problem> {
    let (job, spectrum) = request.eigen().await?;
    let available = spectrum.eigenvalues.len();
    let index = basis.parse().ok().filter(|index| *index < available).ok_or_else(|| {
        let shown: String = basis.chars().take(20).collect();
        Problem::new(
            Kind::NotFound,
            format!("there is no basis `{shown}`; the job has 0 to {}", available - 1),
        )
        .with("available", available)
    })?;
    let (view, service) = (request.arguments.view, &request.service);
    let tag = request::tag(job.id, &("image", index, view::key(&view)));
    let plan = request.plan(tag, format!("basis-{index}-{}", job.id));
    if let Some(answer) = plan.without_work() {
        return Ok(answer);
    }
    let record = service.store.cloud(job.cloud_id).await?;
    let bytes = record.bytes() + 8 * record.points + view::bytes(&view, record.points);
    let reservation = request.reserve(bytes).await?;
    let cloud = service.store.load_cloud(job.cloud_id).await?;
    let values = service.store.basis(job.id, index).await?;
    let title = format!("basis {index} of job {}", job.id);
    let shown = legend_of_basis(index, spectrum.eigenvalues[index]);
    let draw = move |wanted: &Wanted| {
        let legend = Legend { title: &shown, unit: "1/length" };
        view::png_with(&cloud, &Paint::Diverging(&values), &[], &view, (&title, &legend), wanted)
    };
    plan.send(reservation, service.pools.answering.run_while_wanted(draw).await??)
}
