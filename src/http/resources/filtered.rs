//! A cloud with its coordinates, or some of its fields, filtered by the modes of a job.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use super::points;
use crate::cloud::writer::{Column, PlyEncoding, encode_rows, npy_header};
use crate::cloud::{PointCloud, ScalarType};
use crate::harmonics::collapse::collapse;
use crate::harmonics::filtered::{self as filtering, Change, Target};
use crate::harmonics::functions::rows_without_result;
use crate::harmonics::{Filter, FilterKind, Scale, Transfer};
use crate::http::results::asked::resource;
use crate::http::results::asked::{self, Asked, Harmonics, Resource, ResultProblems};
use crate::http::results::cloud_file;
use crate::http::results::functions::{self, BANDS, NumberLists, bands, of_own};
use crate::http::results::view::{self, VIEW};
use crate::http::wire::accept::{CSV, JSON, LAS, LAZ, NPY, NPZ, OBJ, OFF, Offer, PCD, PLY, PNG, STL, XYZ};
use crate::http::wire::body::IncomingBody;
use crate::http::wire::download::{self, Download};
use crate::http::wire::problem::{Kind, Problem, ProblemDocument};
use crate::http::wire::query::{Accepts, Argument, Arguments};
use crate::jobs::Wanted;
use crate::picture::{Paint, View};

/// What it can be had as.
pub(crate) const OFFERS: [Offer; 13] = [PLY, JSON, NPY, NPZ, CSV, XYZ, LAS, LAZ, PCD, OBJ, OFF, STL, PNG];

const fn number(name: &'static str, default: &'static str, meaning: &'static str) -> Argument {
    Argument { name, alias: None, accepts: Accepts::NonNegative, default, meaning }
}

/// Which filter.
pub(crate) const FILTER: &[Argument] = &[
    Argument {
        name: "filter",
        alias: Some("kind"),
        accepts: Accepts::Word(&["low-pass", "high-pass", "band-pass", "band-stop", "enhance", "heat"]),
        default: "low-pass",
        meaning: "What the filter does: `low-pass` keeps what lies below the cut-off, `high-pass` what lies above; `band-pass` keeps what lies between two edges, `band-stop` removes it, `enhance` multiplies it by a gain; `heat` smooths by exp(−sλ).",
    },
    Argument {
        name: "by",
        alias: Some("unit"),
        accepts: Accepts::Word(&["mode", "frequency", "wavelength"]),
        default: "mode",
        meaning: "In what edges are given: number of a mode, counting from 0; frequency √λ in 1/length; or wavelength 2π/√λ in units of the cloud.",
    },
    number(
        "cutoff",
        "the whole span of the bases",
        "The edge of low-pass and high-pass: what lies at it is above it. For heat, where the gain has fallen to 1/e.",
    ),
    number(
        "from",
        "the lowest mode",
        "Lower edge of a band, itself inside. Of two wavelengths, the longer one.",
    ),
    number("to", "no upper edge", "Upper edge of a band, itself outside."),
    number("gain", "2", "Factor on the band of `enhance`."),
    number("time", "from cutoff", "Time s of `heat`, in squared units of the cloud."),
    Argument {
        name: "taper",
        alias: None,
        accepts: Accepts::Range(0.0, 1.0),
        default: "0",
        meaning: "Width of the transition around every edge, as a share of its frequency, against ringing.",
    },
];

/// What is filtered, and how it is answered.
pub(crate) const TARGET: &[Argument] = &[
    Argument {
        name: "outside",
        alias: None,
        accepts: Accepts::NonNegative,
        default: "what the filter does at the highest frequencies",
        meaning: "Factor on what lies outside of the span of the bases: 0 drops it, 1 keeps it.",
    },
    Argument {
        name: "field",
        alias: Some("fields"),
        accepts: Accepts::Text,
        default: "the coordinates",
        meaning: "Filter this field of the upload in place of the coordinates; several are separated by commas.",
    },
    asked::format(
        &["ply", "json", "npy", "npz", "csv", "xyz", "las", "laz", "pcd", "obj", "off", "stl", "png"],
        "by Accept, else ply",
        "Format of the answer: `ply`, `npz`, `csv`, `xyz`, `las`, `laz`, `pcd`, `obj`, `off` and `stl` are the upload with the filtered numbers in place, as far as the format holds it; `json` has them with gains and energies; `npy` is an array of points × coordinates or fields; `png` is a picture, colored by the first field that was filtered.",
    ),
    points::ENCODING,
    points::NONFINITE,
];

resource!(
    /// Query of `GET /jobs/{id}/filtered`.
    ReadFiltered: OFFERS, FILTER, TARGET, BANDS, VIEW
);
resource!(
    /// Query of `POST /jobs/{id}/filtered`.
    FilterByGains: OFFERS, TARGET, BANDS, VIEW
);

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
    /// What the caller should know, as that the filter leaves nothing of the shape of the cloud.
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
    params(("id" = Uuid, Path, description = "The job."), ReadFiltered),
    responses(
        (status = 200, description = "The filtered cloud.", content((Vec<u8> = "application/ply"), (Filtered = "application/json"), (Vec<u8> = "application/x-npy")), headers(("ETag" = String, description = "Of these bytes."))),
        (status = 206, description = "The range asked for.", content((Vec<u8> = "application/ply"), (Vec<u8> = "application/x-npy"))),
        (status = 304, description = "The client's copy is current."),
        (status = 416, description = "The range lies outside.", body = ProblemDocument, content_type = "application/problem+json"),
        ResultProblems,
    )
)]
pub(crate) async fn filtered(asked: Asked<ReadFiltered>) -> Result<Response, Problem> {
    let harmonics = asked.harmonics().await?;
    let filter = read_filter(&asked.arguments);
    let transfer = filter.transfer(&harmonics.modes)?;
    answer(&asked, harmonics, transfer, filter.describe()).await
}

/// The upload filtered by a list of gains, one per mode.
///
/// The body is JSON (`[1, 1, 0.5]` or `{"gains": […]}`) or an npy file. Modes behind the list's end are treated as what
/// lies outside of the bases: by `outside`, which is 0 unless given.
#[utoipa::path(
    post,
    path = "/jobs/{id}/filtered",
    tag = "harmonics",
    params(("id" = Uuid, Path, description = "The job."), FilterByGains),
    request_body(content((NumberLists = "application/json"), (Vec<u8> = "application/x-npy")), description = "The gains."),
    responses(
        (status = 200, description = "The filtered cloud.", content((Vec<u8> = "application/ply"), (Filtered = "application/json"), (Vec<u8> = "application/x-npy"))),
        (status = 400, description = "The body holds no numbers.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 413, description = "The body is too large.", body = ProblemDocument, content_type = "application/problem+json"),
        ResultProblems,
    )
)]
pub(crate) async fn by_gains(
    mut asked: Asked<FilterByGains>,
    body: IncomingBody,
) -> Result<Response, Problem> {
    let eigen = asked.eigen().await?;
    let (mut lists, reservation) = functions::receive(&asked.service, body).await?;
    if lists.len() != 1 {
        return Err(Problem::new(
            Kind::MalformedRequest,
            format!("the body holds {} lists; send one list of gains, as in [1, 1, 0.5]", lists.len()),
        ));
    }
    asked.forget_conditions();
    let harmonics = asked.harmonics_of(eigen, reservation).await?;
    let outside = asked.arguments.number("outside").unwrap_or(0.0);
    let transfer = Transfer::from_gains(lists.swap_remove(0).values, outside, &harmonics.modes)?;
    answer(&asked, harmonics, transfer, "gains as given".to_owned()).await
}

fn read_filter(arguments: &Arguments) -> Filter {
    let number = |name| arguments.number(name);
    Filter {
        kind: arguments.word("filter").and_then(FilterKind::from_name).unwrap_or_default(),
        by: arguments.word("by").and_then(Scale::from_name).unwrap_or_default(),
        cutoff: number("cutoff"),
        from: number("from"),
        to: number("to"),
        gain: number("gain"),
        time: number("time"),
        taper: number("taper").unwrap_or(0.0),
        outside: number("outside"),
    }
}

async fn answer<R: Resource>(
    asked: &Asked<R>,
    mut harmonics: Harmonics,
    transfer: Transfer,
    description: String,
) -> Result<Response, Problem> {
    let Asked { service, offer, arguments, .. } = asked;
    let cloud = Arc::new(service.store.load_cloud(harmonics.job.cloud_id).await?);
    let names: Vec<&str> = arguments
        .word("field")
        .unwrap_or_default()
        .split(',')
        .map(str::trim)
        .filter(|n| !n.is_empty())
        .collect();
    let target = Target::named(&cloud, &names)?;
    let columns = if target == Target::Coordinates { cloud.dimension() } else { names.len() };
    asked.refuse_large_json((cloud.len() * columns) as u64)?;
    let ascii = arguments.word("encoding") == Some("ascii");
    let omits = arguments.word("nonfinite") == Some("omit");
    let view = view::read(arguments);
    let bands = bands(arguments);
    let drawn = (*offer == PNG).then(|| view::key(&view));
    let determined =
        (&names, (ascii, omits), bands, transfer.outside.to_bits(), &transfer.gains, &description, drawn);
    let tag = asked::tag(harmonics.job.id, &determined);

    let mass = service.store.mass(harmonics.job.id).await?;
    let (source, chosen) = (Arc::clone(&cloud), target.clone());
    let choose = move || (chosen.functions(&source, &mass), rows_without_result(&mass), mass);
    let (given, lost, mass) = service.compute.run(choose).await?;
    let (given, found) = of_own(&mut harmonics, given?, mass).await?;
    let Harmonics { job, modes, bases, reservation } = harmonics;
    let divided_clusters = modes.divided_clusters(&transfer.gains);
    let energy = given
        .iter()
        .zip(&found)
        .map(|(function, found)| (function.name.clone(), Change::of(found, &transfer, bands)))
        .collect();
    let (applied, source) = (transfer.clone(), Arc::clone(&given));
    let blocks = bases
        .first(transfer.reach())
        .map(move |block| filtering::rows(block, &source, &found, &applied))
        .await?;

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
    let (offer, length) = (*offer, cloud.len());
    let encode = move |wanted: &Wanted| {
        let columns = joined(&blocks, length);
        if target == Target::Coordinates {
            let before: Vec<&[f64]> = given.iter().map(|function| function.values.as_slice()).collect();
            head.warnings.extend(collapse(&before, &columns));
        }
        match offer {
            NPY => Ok(npy(&columns)),
            JSON => json(head, &target, given.iter().map(|f| f.name.clone()).zip(columns), wanted),
            PNG => picture(&target.replaced(&cloud, &columns)?, &target, &view, &description),
            _ => {
                let replaced = target.replaced(&cloud, &columns)?;
                let replaced = if omits { replaced.without_nonfinite()? } else { replaced };
                file(&replaced, offer, ascii, (&head, &description), wanted)
            }
        }
    };
    let bytes = service.compute.run_while_wanted(encode).await??;
    let stem = format!("filtered-{}", job.id);
    let download = Download { offer, tag, stem, length: Some(bytes.len() as u64) };
    download.answer(&asked.method, &asked.headers, reservation, |span| download::part(bytes, span))
}

/// The columns of all blocks one behind another.
fn joined(blocks: &[Vec<Vec<f64>>], rows: usize) -> Vec<Vec<f64>> {
    let mut columns = vec![Vec::with_capacity(rows); blocks.first().map_or(0, Vec::len)];
    for block in blocks {
        for (column, values) in columns.iter_mut().zip(block) {
            column.extend_from_slice(values);
        }
    }
    columns
}

fn npy(columns: &[Vec<f64>]) -> Vec<u8> {
    let kind = ScalarType::Float64;
    let rows = columns.first().map_or(0, Vec::len);
    let encoded: Vec<_> = columns.iter().map(|values| Column { values, stride: 1, kind }).collect();
    let mut bytes = npy_header(rows, columns.len(), kind);
    bytes.extend(encode_rows(&encoded, rows));
    bytes
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

fn picture(cloud: &PointCloud, target: &Target, view: &View, description: &str) -> Result<Vec<u8>, Problem> {
    let paint = match target {
        Target::Fields(places) => Paint::Sequential(&cloud.fields()[places[0]].values),
        Target::Coordinates => Paint::Plain,
    };
    view::png(cloud, &paint, &[], view, description)
}

fn file(
    cloud: &PointCloud,
    offer: Offer,
    ascii: bool,
    (head, description): (&Filtered, &str),
    wanted: &Wanted,
) -> Result<Vec<u8>, Problem> {
    let encoding = if ascii { PlyEncoding::Ascii } else { PlyEncoding::BinaryLittleEndian };
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_offer_exactly_the_filters_and_scales_that_exist() {
        let words = |name| match FILTER.iter().find(|argument| argument.name == name).unwrap().accepts {
            Accepts::Word(words) => words.to_vec(),
            other => panic!("{other:?}"),
        };
        assert_eq!(words("filter"), FilterKind::ALL.map(FilterKind::name));
        assert_eq!(words("by"), Scale::ALL.map(Scale::name));
    }
}
