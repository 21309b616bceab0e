//! A cloud with its coordinates, or some of its fields, filtered by the modes of a job.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::arguments::{arguments, groups};
use crate::cloud::PointCloud;
use crate::cloud::writer::PlyEncoding;
use crate::harmonics::collapse::collapse;
use crate::harmonics::filtered::rows as rows_of;
use crate::harmonics::filtered::{Change, Named, Target};
use crate::harmonics::functions::rows_without_result;
use crate::harmonics::{Bands, Filter, Modes, Transfer};
use crate::http::results::cloud_file::{self, Ply, Rows, Unplaced};
use crate::http::results::functions::{self, NumberLists, own_coefficients};
use crate::http::results::offered::{Resource, offered};
use crate::http::results::request::{self, Harmonics, ResultRequest};
use crate::http::results::rows::{joined, npy_file};
use crate::http::results::view;
use crate::http::wire::accept::{CSV, JSON, LAS, LAZ, NPY, NPZ, OBJ, OFF, Offer, PCD, PLY, PNG, STL, XYZ};
use crate::http::wire::body::IncomingBody;
use crate::http::wire::download;
use crate::http::wire::memory::Reservation;
use crate::http::wire::problem::{Kind, Problem};
use crate::http::wire::problem_sets::{BodyProblems, RangeProblem, ResultProblems};
use crate::jobs::Wanted;
use crate::picture::{Paint, View};
use crate::spectrum::Spectrum;
use crate::store::JobRecord;

groups! {
    /// What is filtered, and how it is answered.
    #[derive(Debug)]
    pub(crate) struct Filtering {
        /// What.
        named: Named,
        /// How energies are summed.
        bands: Bands,
        /// How PLY is written.
        ply: Ply,
        /// Rows without a position.
        rows: Rows,
        /// Of the picture.
        view: View,
    }
}

groups! {
    /// Arguments of `GET /jobs/{id}/filtered`.
    #[derive(Debug)]
    pub(crate) struct ReadFiltered {
        /// By which filter.
        filter: Filter,
        /// What, and how it is answered.
        filtering: Filtering,
    }
}

arguments! {
    /// What lies outside of posted gains.
    #[derive(Debug)]
    pub(crate) struct Outside {
        /// Factor on what lies outside of the span of the bases, and on modes past the end of the list: 0 drops it, 1 keeps
        /// it.
        outside: f64 = nonnegative, default 0.0;
    }
}

groups! {
    /// Arguments of `POST /jobs/{id}/filtered`.
    #[derive(Debug)]
    pub(crate) struct FilterByGains {
        /// Beyond the gains.
        outside: Outside,
        /// What, and how it is answered.
        filtering: Filtering,
    }
}

offered!(ReadFiltered: [PLY, JSON, NPY, NPZ, CSV, XYZ, LAS, LAZ, PCD, OBJ, OFF, STL, PNG] by filtering.view, "Format of the answer: `ply`, `npz`, `csv`, `xyz`, `las`, `laz`, `pcd`, `obj`, `off` and `stl` are the upload with the filtered numbers in place, as far as the format holds it; `json` has them with gains and energies; `npy` is an array of points × coordinates or fields; `png` is a picture, colored by the first field that was filtered.");
offered!(FilterByGains as ReadFiltered by filtering.view, "Format of the answer, as for GET.");

/// A filtered cloud as JSON.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Filtered {
    /// The job.
    job_id: Uuid,
    /// The cloud it analyzed.
    cloud_id: Uuid,
    /// Rows of the upload.
    points: usize,
    /// Rows that carry no result and are left as they were.
    rows_without_result: usize,
    /// The filter as used.
    #[serde(flatten)]
    transfer: Transfer,
    /// Index ranges `[first, last]` of modes with different gains among which the choice of bases is arbitrary.
    divided_clusters: Vec<[usize; 2]>,
    /// Warnings, for example that the filter removes the cloud's shape.
    warnings: Vec<String>,
    /// Energy of every filtered function, before and after.
    energy: BTreeMap<String, Change>,
    /// Coordinates of every point, when they were filtered; null where they are not finite.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Vec<Option<f64>>>>)]
    coordinates: Option<Vec<Vec<f64>>>,
    /// Values of every field that was filtered, by name; null where they are not finite.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<BTreeMap<String, Vec<Option<f64>>>>)]
    fields: Option<BTreeMap<String, Vec<f64>>>,
}

/// The upload with its coordinates, or some of its fields, filtered.
///
/// `x' = Σ F(λ_i) x̃_i H_i + outside · (x − Σ x̃_i H_i)`. Everything else of the upload is kept; normals follow moved
/// points. Edges beyond the bases are refused unless `outside` says what becomes of the rest.
#[utoipa::path(
    get,
    path = "/jobs/{id}/filtered",
    tag = "harmonics",
    params(("id" = Uuid, Path, description = "The job."), ResultRequest<ReadFiltered>),
    responses(
        (status = 200, description = "The filtered cloud.", body = Filtered, headers(("ETag" = String, description = "Of these bytes."))),
        (status = 206, description = "The requested range.", content((Vec<u8> = "application/ply"), (Vec<u8> = "application/x-npy"))),
        (status = 304, description = "The client's copy is current."),
        RangeProblem,
        ResultProblems,
    )
)]
pub(crate) async fn filtered(request: ResultRequest<ReadFiltered>) -> Result<Response, Problem> {
    let eigen = request.eigen().await?;
    let ReadFiltered { filter, filtering } = &request.arguments;
    let transfer = filter.transfer(&Modes::of(&eigen.1))?;
    let reservation = request.service.memory.begin(request.owner.clone());
    answer(&request, filtering, (eigen, reservation), transfer, filter.describe()).await
}

/// The upload filtered by a list of gains, one per mode.
///
/// The body is JSON (`[1, 1, 0.5]` or `{"gains": […]}`) or an npy file. Modes past the end of the list are treated
/// like the part outside the bases: by `outside`, which is 0 unless given.
#[utoipa::path(
    post,
    path = "/jobs/{id}/filtered",
    tag = "harmonics",
    params(("id" = Uuid, Path, description = "The job."), ResultRequest<FilterByGains>),
    request_body(content((NumberLists = "application/json"), (Vec<u8> = "application/x-npy")), description = "The gains."),
    responses(
        (status = 200, description = "The filtered cloud.", content((Vec<u8> = "application/ply"), (Filtered = "application/json"), (Vec<u8> = "application/x-npy"))),
        BodyProblems,
        ResultProblems,
    )
)]
pub(crate) async fn by_gains(
    mut request: ResultRequest<FilterByGains>,
    body: IncomingBody,
) -> Result<Response, Problem> {
    let eigen = request.eigen().await?;
    let (mut lists, reservation) = functions::receive(&request.service, body).await?;
    if lists.len() != 1 {
        return Err(Problem::new(
            Kind::MalformedRequest,
            format!("the body holds {} lists; send one list of gains, as in [1, 1, 0.5]", lists.len()),
        ));
    }
    request.forget_conditions();
    let FilterByGains { outside: Outside { outside }, filtering } = &request.arguments;
    let modes = Modes::of(&eigen.1);
    let transfer = Transfer::from_gains(lists.swap_remove(0).values, *outside, &modes)?;
    answer(&request, filtering, (eigen, reservation), transfer, "gains as given".to_owned()).await
}

async fn answer<R: Resource>(
    request: &ResultRequest<R>,
    filtering: &Filtering,
    (eigen, reservation): ((JobRecord, Spectrum), Reservation),
    transfer: Transfer,
    description: String,
) -> Result<Response, Problem> {
    let ResultRequest { service, offer, .. } = request;
    let Filtering { named: Named { field: names }, bands, ply, rows, view } = filtering;
    let (bands, encoding, view) = (bands.bands, ply.encoding, *view);
    let omits = rows.nonfinite == Unplaced::Omit;
    let drawn = (*offer == PNG).then(|| view::key(&view));
    let determined =
        (names, (encoding, omits), bands, transfer.outside.to_bits(), &transfer.gains, &description, drawn);
    let tag = request::tag(eigen.0.id, &determined);
    let plan = request.plan(tag, format!("filtered-{}", eigen.0.id));
    if let Some(answer) = plan.without_work() {
        return Ok(answer);
    }
    let mut harmonics = request.harmonics_of(eigen, reservation, 0).await?;
    let cloud = Arc::new(service.store.load_cloud(harmonics.job.cloud_id).await?);
    let target = Target::named(&cloud, names)?;
    let columns = if target == Target::Coordinates { cloud.dimension() } else { names.len() };
    request.refuse_large_json((cloud.len() * columns) as u64)?;
    let mass = service.store.mass(harmonics.job.id).await?;
    let (source, chosen) = (Arc::clone(&cloud), target.clone());
    let choose = move || (chosen.functions(&source, &mass), rows_without_result(&mass), mass);
    let (given, lost, mass) = service.pools.answering.run(choose).await?;
    let (given, found) = own_coefficients(&mut harmonics, given?, mass).await?;
    let Harmonics { job, modes, bases, reservation } = harmonics;
    let divided_clusters = modes.divided_clusters(&transfer.gains);
    let energy = given
        .iter()
        .zip(&found)
        .map(|(function, found)| (function.name.clone(), Change::of(found, &transfer, bands)))
        .collect();
    let (applied, source) = (transfer.clone(), Arc::clone(&given));
    let blocks =
        bases.first(transfer.reach()).map(move |block| rows_of(block, &source, &found, &applied)).await?;

    let mut head = Filtered {
        job_id: job.id,
        cloud_id: job.cloud_id,
        points: cloud.len(),
        rows_without_result: lost,
        transfer,
        divided_clusters,
        warnings: Vec::new(),
        energy,
        coordinates: None,
        fields: None,
    };
    let (offer, kind, length) = (*offer, request.kind(), cloud.len());
    let encode = move |wanted: &Wanted| {
        let columns = joined(blocks, length);
        if target == Target::Coordinates {
            let before: Vec<&[f64]> = given.iter().map(|function| function.values.as_slice()).collect();
            head.warnings.extend(collapse(&before, &columns));
        }
        match offer {
            NPY => Ok(npy_file(&columns.iter().map(|column| &column[..]).collect::<Vec<_>>(), kind)),
            JSON => json(head, &target, given.iter().map(|f| f.name.clone()).zip(columns), wanted),
            PNG => picture(&target.replaced(&cloud, &columns)?, &target, &view, &description, wanted),
            _ => {
                let replaced = target.replaced(&cloud, &columns)?;
                let replaced = if omits { replaced.without_nonfinite()? } else { replaced };
                file(&replaced, offer, encoding, (&head, &description), wanted)
            }
        }
    };
    plan.send(reservation, service.pools.answering.run_while_wanted(encode).await??)
}

fn json(
    mut answer: Filtered,
    target: &Target,
    columns: impl Iterator<Item = (String, Vec<f64>)>,
    wanted: &Wanted,
) -> Result<Vec<u8>, Problem> {
    match target {
        Target::Fields(_) => answer.fields = Some(columns.collect()),
        Target::Coordinates => {
            let columns: Vec<Vec<f64>> = columns.map(|(_, column)| column).collect();
            let point = |row| columns.iter().map(|column| column[row]).collect();
            answer.coordinates = Some((0..answer.points).map(point).collect());
        }
    }
    download::json(&answer, wanted)
}

fn picture(
    cloud: &PointCloud,
    target: &Target,
    view: &View,
    description: &str,
    wanted: &Wanted,
) -> Result<Vec<u8>, Problem> {
    let paint = match target {
        Target::Fields(places) => Paint::Sequential(&cloud.fields()[places[0]].values),
        Target::Coordinates => Paint::Plain,
    };
    view::png(cloud, &paint, &[], view, description, wanted)
}

fn file(
    cloud: &PointCloud,
    offer: Offer,
    encoding: PlyEncoding,
    (head, description): (&Filtered, &str),
    wanted: &Wanted,
) -> Result<Vec<u8>, Problem> {
    let told = head.warnings.iter().map(|warning| format!("warning: {warning}"));
    let comment = format!(
        "chladni job {}: {description}; outside of the {} bases x {}; {} rows without a result unchanged",
        head.job_id,
        head.transfer.gains.len(),
        head.transfer.outside,
        head.rows_without_result
    );
    let comments: Vec<String> = std::iter::once(comment).chain(told).collect();
    cloud_file::encode(cloud, offer, encoding, &comments, wanted)
}
