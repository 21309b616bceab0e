//! Salient feature points of a surface.

use std::sync::Arc;

use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::arguments::groups;
use crate::cloud::PointCloud;
use crate::harmonics::features::{self as salient, Feature, FeatureRequest};
use crate::harmonics::functions::rows_without_result;
use crate::harmonics::{Modes, Neighborhoods};
use crate::http::results::offered::offered;
use crate::http::results::request::{self, Harmonics, ResultRequest};
use crate::http::results::view;
use crate::http::wire::accept::{JSON, PLY, PNG};
use crate::http::wire::download;
use crate::http::wire::problem::Problem;
use crate::http::wire::problem_sets::{RangeProblem, ResultProblems};
use crate::jobs::Wanted;
use crate::picture::{Paint, View};

groups! {
    /// Arguments of `GET /jobs/{id}/features`.
    #[derive(Debug)]
    pub(crate) struct ReadFeatures {
        /// Which.
        features: FeatureRequest,
        /// Of the picture.
        view: View,
    }
}

offered!(ReadFeatures: [JSON, PLY, PNG] by view, "Format of the answer: `ply` has the feature points with `index`, `persistence` and the number of `pairs`; `png` is a picture of the cloud with them.");

/// Feature points, most persistent first.
#[derive(Debug, Serialize, ToSchema)]
#[allow(clippy::struct_field_names)] // the list is what the resource is called
pub(crate) struct Features {
    /// The job.
    job_id: Uuid,
    /// The cloud it analyzed.
    cloud_id: Uuid,
    /// Rows of the upload.
    points: usize,
    /// Rows that carry no result and were skipped.
    rows_without_result: usize,
    /// Modes examined.
    modes: usize,
    /// Radius of the neighborhoods, in units of the cloud.
    radius: f64,
    /// Index ranges `[first, last]` of modes whose extrema depend on an arbitrary choice of bases.
    clusters: Vec<[usize; 2]>,
    /// The feature points.
    features: Vec<Feature>,
}

/// Salient feature points: where two consecutive bases have an extremum at the same place.
///
/// An extremum is a maximum of `|H|` among the points within 2ε (at least the 6, at most the 48 nearest) where H has the
/// same sign, so the signs of bases do not matter. Places within 2ε are one. Pairs inside of `clusters` depend on an
/// arbitrary choice of bases.
#[utoipa::path(
    get,
    path = "/jobs/{id}/features",
    tag = "harmonics",
    params(("id" = Uuid, Path, description = "The job."), ResultRequest<ReadFeatures>),
    responses(
        (status = 200, description = "The feature points.", body = Features, headers(("ETag" = String, description = "Of these bytes."))),
        (status = 304, description = "The client's copy is current."),
        RangeProblem,
        ResultProblems,
    )
)]
pub(crate) async fn features(request: ResultRequest<ReadFeatures>) -> Result<Response, Problem> {
    let eigen = request.eigen().await?;
    let ReadFeatures { features: chosen, view } = request.arguments;
    let count = chosen.modes(eigen.1.eigenvalues.len());
    let epsilon = eigen.0.report.as_ref().map_or(0.0, |report| report.sampling.epsilon);
    let (persistence, radius) = (chosen.persistence, chosen.radius(epsilon));
    let limit = chosen.limit.unwrap_or(usize::MAX);
    let drawn = (request.offer == PNG).then(|| view::key(&view));
    let tag = request::tag(eigen.0.id, &(count, persistence.to_bits(), radius.to_bits(), limit, drawn));
    let plan = request.plan(tag, format!("features-{}", eigen.0.id));
    if let Some(answer) = plan.without_work() {
        return Ok(answer);
    }

    let Harmonics { job, modes, bases, reservation } = request.harmonics(eigen, 0).await?;
    let store = &request.service.store;
    let cloud = Arc::new(store.load_cloud(job.cloud_id).await?);
    let mass = store.mass(job.id).await?;
    let source = Arc::clone(&cloud);
    let surveyed = request.service.pools.answering.run(move || {
        let area: f64 = mass.iter().filter(|mass| !mass.is_nan()).sum();
        (Neighborhoods::find(&source, &mass, radius), rows_without_result(&mass), area)
    });
    let (neighborhoods, rows_without_result, area) = surveyed.await?;
    let neighborhoods = Arc::new(neighborhoods?);
    let around = Arc::clone(&neighborhoods);
    let first = modes.zero_modes().min(count);
    let extrema =
        bases.map_columns(first..count, move |basis| salient::extrema(basis, &around, area)).await?;

    let offer = request.offer;
    let answer = Answer { cloud, neighborhoods, modes, first, count, persistence, limit };
    let (job_id, cloud_id) = (job.id, job.cloud_id);
    let encode = move |wanted: &Wanted| {
        let found = answer.places(&extrema);
        if offer == PLY {
            return Ok(salient::as_ply(&found, &answer.cloud));
        }
        if offer == PNG {
            let marks: Vec<usize> = found.iter().map(|feature| feature.index).collect();
            return view::png(&answer.cloud, &Paint::Plain, &marks, &view, "feature points", wanted);
        }
        let clusters = answer.modes.clusters().iter().copied().filter(|[first, _]| *first < answer.count);
        let answer = Features {
            job_id,
            cloud_id,
            points: answer.cloud.len(),
            rows_without_result,
            modes: answer.count,
            radius,
            clusters: clusters.collect(),
            features: found,
        };
        download::json(&answer, wanted)
    };
    plan.send(reservation, request.service.pools.answering.run_while_wanted(encode).await??)
}

/// Inputs of the final ranking.
struct Answer {
    cloud: Arc<PointCloud>,
    neighborhoods: Arc<Neighborhoods>,
    modes: Modes,
    first: usize,
    count: usize,
    persistence: f64,
    limit: usize,
}

impl Answer {
    fn places(&self, extrema: &[Vec<salient::Extremum>]) -> Vec<Feature> {
        let mut places = salient::features(extrema, self.first, &self.neighborhoods, self.persistence);
        places.truncate(self.limit);
        places.iter().map(|place| place.in_cloud(&self.neighborhoods, &self.cloud)).collect()
    }
}
