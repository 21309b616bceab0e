//! A cloud's points, given back as PLY, NPY or JSON.

use std::sync::Arc;

use axum::extract::{Path, State};
use axum::http::{Extensions, HeaderMap, Method, Uri};
use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;

use crate::cloud::writer::{PlyEncoding, encode_rows, ply_columns, ply_properties};
use crate::cloud::{PointCloud, ScalarType};
use crate::http::notation::parse_id;
use crate::http::results::rows::{npy_layout, ply_layout};
use crate::http::results::view::{self, VIEW};
use crate::http::results::{asked, cloud_file};
use crate::http::service::Shared;
use crate::http::wire::accept::{
    self, CSV, JSON, LAS, LAZ, NPY, NPZ, OBJ, OFF, Offer, PCD, PLY, PNG, STL, XYZ,
};
use crate::http::wire::download::{self, Download};
use crate::http::wire::owners;
use crate::http::wire::problem::{Problem, ProblemDocument};
use crate::http::wire::query::{Accepts, Argument, arguments};
use crate::jobs::Wanted;
use crate::picture::Paint;
use crate::store::CHUNK_POINTS;

/// What they can be had as.
pub(crate) const OFFERS: [Offer; 13] = [PLY, NPY, JSON, NPZ, CSV, XYZ, LAS, LAZ, PCD, OBJ, OFF, STL, PNG];

/// Rows without a position.
pub(crate) const NONFINITE: Argument = Argument {
    name: "nonfinite",
    alias: None,
    accepts: Accepts::Word(&["keep", "omit"]),
    default: "keep",
    meaning: "Rows with a NaN or infinite coordinate in files of points: keep them, row for row as uploaded, or omit them, as formats such as LAS need it.",
};

/// Encoding of PLY.
pub(crate) const ENCODING: Argument = Argument {
    name: "encoding",
    alias: None,
    accepts: Accepts::Word(&["binary", "ascii"]),
    default: "binary",
    meaning: "Encoding of ply.",
};

pub(crate) const ARGUMENTS: &[Argument] = &[
    asked::format(
        &["ply", "npy", "json", "npz", "csv", "xyz", "las", "laz", "pcd", "obj", "off", "stl", "png"],
        "by Accept, else ply",
        "Format of the answer: `ply`, `npz`, `csv`, `xyz`, `las`, `laz` and `pcd` have the coordinates and all fields of the upload, `npy` and `json` the coordinates, `obj` and `off` the faces too, `stl` the faces alone; `png` is a picture.",
    ),
    ENCODING,
    NONFINITE,
];

arguments!(
    /// Query of `GET /clouds/{id}/points`.
    ReadPoints = ARGUMENTS, VIEW
);

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
    params(("id" = Uuid, Path, description = "The cloud."), ReadPoints),
    responses(
        (status = 200, description = "The points.", content((Vec<u8> = "application/ply"), (Vec<u8> = "application/x-npy"), (Points = "application/json"), (Vec<u8> = "application/x-npz"), (String = "text/csv"), (String = "text/x-xyz"), (Vec<u8> = "application/vnd.las"), (Vec<u8> = "application/vnd.laszip"), (Vec<u8> = "application/x-pcd"), (String = "model/obj"), (String = "application/x-off"), (Vec<u8> = "model/stl"), (Vec<u8> = "image/png"))),
        (status = 206, description = "The range asked for.", content((Vec<u8> = "application/ply"), (Vec<u8> = "application/x-npy"))),
        (status = 304, description = "The client's copy is current."),
        (status = 404, description = "No such cloud.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 406, description = "None of the formats is acceptable.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 416, description = "The range lies outside.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 422, description = "A parameter is not accepted.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 503, description = "The service makes as many answers as it has memory for.", body = ProblemDocument, content_type = "application/problem+json"),
    )
)]
pub(crate) async fn points(
    State(service): State<Shared>,
    Path(id): Path<String>,
    method: Method,
    uri: Uri,
    headers: HeaderMap,
    extensions: Extensions,
) -> Result<Response, Problem> {
    let arguments = ReadPoints::read(&uri)?;
    let offer = accept::choose(arguments.word("format"), &headers, &OFFERS)?;
    let id = parse_id(&id)?;
    let is_streamed = offer == NPY || (offer == PLY && arguments.word("encoding") != Some("ascii"));
    // Whole files stand beside the cloud. Text is three times as long, and JSON is put together from lists of numbers.
    let times = if is_streamed { 1 } else { 6 };
    let record = service.store.cloud(id).await?;
    let drawn = if offer == PNG { view::bytes(&view::read(&arguments), record.points) } else { 0 };
    let bytes = times * record.bytes() + drawn;
    let reservation = service.memory.reserve(owners::owner(&extensions), bytes).await?;
    let omits = arguments.word("nonfinite") == Some("omit");
    let loaded = service.store.load_cloud(id).await?;
    let cloud = if omits && loaded.nonfinite() > 0 {
        Arc::new(service.compute.run(move || loaded.without_nonfinite()).await??)
    } else {
        Arc::new(loaded)
    };
    let mut download =
        Download { offer, tag: asked::tag(id, &omits), stem: format!("cloud-{id}"), length: None };
    let encoding = match arguments.word("encoding") {
        Some("ascii") => PlyEncoding::Ascii,
        _ => PlyEncoding::BinaryLittleEndian,
    };
    if !is_streamed {
        let view = view::read(&arguments);
        download.tag = asked::tag(id, &(encoding == PlyEncoding::Ascii, omits, view::key(&view)));
        let encode = move |wanted: &Wanted| match offer {
            JSON => json(&cloud, wanted),
            PNG => view::png(&cloud, &Paint::Plain, &[], &view, &format!("cloud {id}")),
            _ => cloud_file::encode(&cloud, offer, encoding, &[], wanted),
        };
        let bytes = service.compute.run_while_wanted(encode).await??;
        download.length = Some(bytes.len() as u64);
        return download.answer(&method, &headers, reservation, |span| download::part(bytes, span));
    }
    let layout = if offer == NPY {
        npy_layout(cloud.len(), cloud.dimension(), ScalarType::Float64)
    } else {
        let shown = Arc::clone(&cloud);
        service.compute.run(move || ply_layout(&shown, ply_properties(&shown))).await?
    };
    download.length = Some(layout.length());
    let compute = service.compute.clone();
    download.answer(&method, &headers, reservation, move |span| {
        layout.stream(span, move |chunk| {
            let (compute, cloud) = (compute.clone(), Arc::clone(&cloud));
            async move { Ok(compute.run(move || encode(&cloud, offer, chunk)).await?) }
        })
    })
}

fn json(cloud: &PointCloud, wanted: &Wanted) -> Result<Vec<u8>, Problem> {
    let coordinates = cloud.coordinates().chunks(cloud.dimension()).map(<[f64]>::to_vec).collect();
    let points = Points { points: cloud.len(), dimension: cloud.dimension(), coordinates };
    download::json(&points, wanted)
}

/// The bytes of a chunk of rows, with all fields in PLY.
fn encode(cloud: &PointCloud, offer: Offer, chunk: usize) -> Vec<u8> {
    let first = chunk * CHUNK_POINTS;
    let rows = CHUNK_POINTS.min(cloud.len() - first);
    if offer == PLY {
        return encode_rows(&ply_columns(cloud, first), rows);
    }
    let mut columns = ply_columns(cloud, first);
    columns.truncate(cloud.dimension());
    for column in &mut columns {
        column.kind = ScalarType::Float64;
    }
    encode_rows(&columns, rows)
}
