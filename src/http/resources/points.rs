//! A cloud's points, given back as PLY, NPY or JSON.

use std::sync::Arc;

use axum::extract::{Path, State};
use axum::http::{Extensions, HeaderMap, Method};
use axum::response::Response;
use axum::routing::get;
use serde::Serialize;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;

use crate::arguments::groups;
use crate::cloud::PointCloud;
use crate::cloud::writer::{PlyEncoding, encode_rows, ply_columns, ply_properties};
use crate::http::results::cloud_file::{self, Ply, Rows, Unplaced};
use crate::http::results::offered::{ArrayType, Offered, Resource, Typed, offered};
use crate::http::results::request;
use crate::http::results::rows::{npy_layout, ply_layout};
use crate::http::results::view;
use crate::http::wire::accept::{
    self, CSV, JSON, LAS, LAZ, NPY, NPZ, OBJ, OFF, Offer, PCD, PLY, PNG, STL, XYZ,
};
use crate::http::wire::download::{self, Plan};
use crate::http::wire::notation::parse_id;
use crate::http::wire::owners;
use crate::http::wire::problem::Problem;
use crate::http::wire::problem_sets::{AnswerProblems, CloudProblems, RangeProblem};
use crate::http::wire::query::FromQuery;
use crate::http::wire::service::Shared;
use crate::jobs::Wanted;
use crate::picture::{Paint, View};
use crate::store::CHUNK_POINTS;

groups! {
    /// Arguments of `GET /clouds/{id}/points`.
    #[derive(Debug)]
    pub(crate) struct ReadPoints {
        /// How PLY is written.
        ply: Ply,
        /// Rows without a position.
        rows: Rows,
        /// Of the picture.
        view: View,
    }
}

offered!(ReadPoints: [PLY, NPY, JSON, NPZ, CSV, XYZ, LAS, LAZ, PCD, OBJ, OFF, STL, PNG] by view, "Format of the answer: `ply`, `npz`, `csv`, `xyz`, `las`, `laz` and `pcd` have the coordinates and all fields of the upload, `npy` and `json` the coordinates, `obj` and `off` the faces too, `stl` the faces alone; `png` is a picture.");

/// Points as JSON.
#[derive(Debug, Serialize, ToSchema)]
#[allow(clippy::struct_field_names)] // the field is the number of points
pub(crate) struct Points {
    /// Rows of the upload.
    points: usize,
    /// Coordinates per point.
    dimension: usize,
    /// The coordinates of every point; null where they are not finite.
    #[schema(value_type = Vec<Vec<Option<f64>>>)]
    coordinates: Vec<Vec<f64>>,
}

/// The cloud's points, row for row as uploaded.
#[utoipa::path(
    get,
    path = "/clouds/{id}/points",
    tag = "clouds",
    params(("id" = Uuid, Path, description = "The cloud."), FromQuery<Offered<ReadPoints>>),
    responses(
        (status = 200, description = "The points.", body = Points),
        (status = 206, description = "The requested range.", content((Vec<u8> = "application/ply"), (Vec<u8> = "application/x-npy"))),
        (status = 304, description = "The client's copy is current."),
        CloudProblems,
        RangeProblem,
        AnswerProblems,
    )
)]
pub(crate) async fn points(
    asked: Asked,
    FromQuery(Offered { typed, format }): FromQuery<Offered<ReadPoints>>,
) -> Result<Response, Problem> {
    let (_, _, headers, ..) = &asked;
    let offer = accept::choose(format, headers, ReadPoints::OFFERS)?;
    answer(asked, typed, offer).await
}

/// The points under file names: `/clouds/{id}/points.npy` is `/clouds/{id}/points?format=npy`.
pub(crate) fn files() -> OpenApiRouter<Shared> {
    ReadPoints::OFFERS.iter().fold(OpenApiRouter::new(), |router, &offer| {
        let file =
            move |asked: Asked, FromQuery(typed): FromQuery<Typed<ReadPoints>>| answer(asked, typed, offer);
        router.route(&format!("/clouds/{{id}}/points.{}", offer.name), get(file))
    })
}

/// The cloud, method, headers, whose request it is, and where.
type Asked = (Path<String>, Method, HeaderMap, Extensions, State<Shared>);

async fn answer(
    (Path(id), method, headers, extensions, State(service)): Asked,
    Typed { arguments: ReadPoints { ply: Ply { encoding }, rows, view }, array }: Typed<ReadPoints>,
    offer: Offer,
) -> Result<Response, Problem> {
    let id = parse_id(&id)?;
    let omits = rows.nonfinite == Unplaced::Omit;
    let is_streamed = offer == NPY || (offer == PLY && encoding == PlyEncoding::Binary);
    let tag = if is_streamed {
        request::tag(id, &omits)
    } else {
        request::tag(id, &(encoding, omits, view::key(&view)))
    };
    let tag = array.tagged(tag, offer);
    let plan = Plan { method: &method, headers: &headers, offer, tag, stem: format!("cloud-{id}") };
    let stored = service.store.cloud(id).await?;
    if let Some(answer) = if is_streamed { plan.unchanged() } else { plan.without_work() } {
        return Ok(answer);
    }
    // Whole files stand beside the cloud. Text is three times as long, and JSON is put together from lists of numbers.
    let times = if is_streamed { 1 } else { 6 };
    let drawn = if offer == PNG { view::bytes(&view, stored.points) } else { 0 };
    let bytes = times * stored.bytes() + drawn;
    let reservation = service.memory.reserve(owners::owner(&extensions), bytes).await?;
    let loaded = service.store.load_cloud(id).await?;
    let cloud = if omits && loaded.nonfinite() > 0 {
        Arc::new(service.pools.answering.run(move || loaded.without_nonfinite()).await??)
    } else {
        Arc::new(loaded)
    };
    if !is_streamed {
        let encode = move |wanted: &Wanted| match offer {
            JSON => json(&cloud, wanted),
            PNG => view::png(&cloud, &Paint::Plain, &[], &view, &format!("cloud {id}"), wanted),
            _ => cloud_file::encode(&cloud, offer, encoding, &[], wanted),
        };
        return plan.send(reservation, service.pools.answering.run_while_wanted(encode).await??);
    }
    let layout = if offer == NPY {
        npy_layout(cloud.len(), cloud.dimension(), array.kind(offer))
    } else {
        let shown = Arc::clone(&cloud);
        service.pools.answering.run(move || ply_layout(&shown, ply_properties(&shown))).await?
    };
    let compute = service.pools.answering.clone();
    plan.answer(Some(layout.length()), reservation, move |span| {
        layout.stream(span, move |chunk| {
            let (compute, cloud) = (compute.clone(), Arc::clone(&cloud));
            async move { Ok(compute.run(move || encode(&cloud, offer, array, chunk)).await?) }
        })
    })
}

fn json(cloud: &PointCloud, wanted: &Wanted) -> Result<Vec<u8>, Problem> {
    let coordinates = cloud.coordinates().chunks(cloud.dimension()).map(<[f64]>::to_vec).collect();
    let points = Points { points: cloud.len(), dimension: cloud.dimension(), coordinates };
    download::json(&points, wanted)
}

/// The bytes of a chunk of rows, with all fields in PLY.
fn encode(cloud: &PointCloud, offer: Offer, array: ArrayType, chunk: usize) -> Vec<u8> {
    let first = chunk * CHUNK_POINTS;
    let rows = CHUNK_POINTS.min(cloud.len() - first);
    if offer == PLY {
        return encode_rows(&ply_columns(cloud, first), rows);
    }
    let mut columns = ply_columns(cloud, first);
    columns.truncate(cloud.dimension());
    for column in &mut columns {
        column.kind = array.kind(offer);
    }
    encode_rows(&columns, rows)
}
