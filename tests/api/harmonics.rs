//! What the bases are for: transform, filters, feature points, signatures, distances, similarity.

#![allow(clippy::float_cmp)] // the same numbers, whatever the format

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use chladni::cloud::reader::{self, Format, ReadOptions};
use chladni::cloud::{NonFinite, PointCloud, ScalarField, ScalarType};
use reqwest::{Response, StatusCode};
use serde_json::{Value, json};
use sqlx::ConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;

use crate::service::{Service, detail, file, problem, sphere, sphere_and};

const BASES: usize = 20;
const POINTS: usize = 500;

async fn finished() -> (Service, String) {
    let service = Service::start().await;
    let id = service.succeed(&format!("bases={BASES}"), file(&sphere(POINTS), Format::Ply)).await;
    (service, id)
}

/// A sphere with faces, colors, normals that are a little off, and a scalar with a trend.
fn colored() -> PointCloud {
    let sphere = sphere(POINTS);
    let column = |value: &dyn Fn(&[f64]) -> f64| (0..POINTS).map(|i| value(sphere.point(i))).collect();
    let field = |name: &str, kind, values| ScalarField { name: name.to_owned(), kind, values };
    let fields = vec![
        field("nx", ScalarType::Float32, column(&|p| f64::from(p[0] as f32))),
        field("ny", ScalarType::Float32, column(&|p| f64::from((p[1] + 0.05) as f32))),
        field("nz", ScalarType::Float32, column(&|p| f64::from(p[2] as f32))),
        field("red", ScalarType::Uint8, column(&|p| (100.0 + 90.0 * p[0]).round())),
        field("intensity", ScalarType::Float32, column(&|p| f64::from((p[2] * 3.0) as f32))),
    ];
    let faces = vec![[0, 1, 2], [1, 2, 3]];
    sphere.with_fields(fields).unwrap().with_faces(faces).unwrap()
}

fn read(bytes: &[u8]) -> PointCloud {
    let options = ReadOptions { policy: NonFinite::Drop, ..ReadOptions::default() };
    reader::read(bytes, Format::Ply, &options).unwrap()
}

async fn bytes(response: Response) -> Vec<u8> {
    let status = response.status();
    let bytes = response.bytes().await.unwrap().to_vec();
    assert_eq!(status, StatusCode::OK, "{}", String::from_utf8_lossy(&bytes));
    bytes
}

async fn get(service: &Service, path: &str) -> Vec<u8> {
    bytes(service.get(path).await).await
}

fn array(bytes: &[u8]) -> (Vec<u64>, Vec<f64>) {
    let file = npyz::NpyFile::new(bytes).unwrap();
    (file.shape().to_vec(), file.into_vec().unwrap())
}

/// A file of single precision holds the numbers of that of double precision, rounded.
#[tokio::test]
async fn arrays_of_single_precision_are_the_rounded_ones() {
    let (service, id) = finished().await;
    let operator = service.succeed("kind=operator", file(&sphere(POINTS), Format::Ply)).await;
    let cloud = service.json(&format!("/jobs/{id}")).await["cloud_id"].as_str().unwrap().to_owned();
    let posted = json!(vec![0.1; POINTS]).to_string();
    for (path, body) in [
        (format!("/clouds/{cloud}/points?format=npy"), None),
        (format!("/jobs/{id}/bases.npy?first=1"), None),
        (format!("/jobs/{id}/coefficients.npy?bands=2"), None),
        (format!("/jobs/{id}/filtered.npy?cutoff=5"), None),
        (format!("/jobs/{id}/signatures.npy?count=3"), None),
        (format!("/jobs/{id}/distances.npy?from=3"), None),
        (format!("/jobs/{id}/synthesis?format=npy"), Some(json!([0.0, 1.0]).to_string())),
        (format!("/jobs/{id}/coefficients?format=npy"), Some(posted.clone())),
        (format!("/jobs/{operator}/laplacian?format=npy"), Some(posted)),
    ] {
        let send = async |path: &str| {
            let url = service.url(path);
            let request = match &body {
                Some(body) => service.client.post(url).body(body.clone()),
                None => service.client.get(url),
            };
            let answer = request.send().await.unwrap();
            let tag = answer.headers().get("etag").cloned();
            (tag, bytes(answer).await)
        };
        let (tag, double) = send(&path).await;
        let and = if path.contains('?') { '&' } else { '?' };
        let (tag_of_single, single) = send(&format!("{path}{and}dtype=f32")).await;
        let (shape, values) = array(&double);
        let file = npyz::NpyFile::new(&single[..]).unwrap();
        assert_eq!(file.shape(), shape, "{path}");
        let rounded: Vec<f32> = values.iter().map(|&x| x as f32).collect();
        let found: Vec<f32> = file.into_vec().unwrap();
        assert!(found.iter().zip(&rounded).all(|(a, b)| a.to_bits() == b.to_bits()), "{path}");
        assert!(tag.is_none() || tag != tag_of_single, "{path}: other bytes have another tag");
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap_or(f64::NAN)).collect()
}

/// A `.npy` of one column.
fn npy(values: &[f64]) -> Vec<u8> {
    let mut bytes = chladni::cloud::writer::npy_vector_header(values.len(), ScalarType::Float64);
    bytes.extend(values.iter().flat_map(|x| x.to_le_bytes()));
    bytes
}

#[tokio::test]
async fn coefficients_of_coordinates_and_fields_go_there_and_back() {
    let service = Service::start().await;
    let id = service.succeed(&format!("bases={BASES}"), file(&colored(), Format::Ply)).await;
    let path = format!("/jobs/{id}/coefficients");
    let answer = service.json(&path).await;
    let names: Vec<_> = answer["fields"].as_object().unwrap().keys().cloned().collect();
    assert_eq!(names, ["x", "y", "z", "nx", "ny", "nz", "red", "intensity"]);
    assert_eq!(numbers(&answer["eigenvalues"]).len(), BASES);
    assert_eq!(answer["rows_without_result"], 0);
    // z is an eigenfunction of the sphere, and intensity is three times z
    let (z, intensity) = (numbers(&answer["fields"]["z"]), numbers(&answer["fields"]["intensity"]));
    assert!(z.iter().zip(&intensity).all(|(z, intensity)| (3.0 * z - intensity).abs() < 1e-5));
    let energy = &answer["energy"]["z"];
    assert!(energy["outside"].as_f64().unwrap() < 1e-3 * energy["total"].as_f64().unwrap(), "{energy}");
    assert_eq!(energy["bands"].as_array().unwrap().len(), 10);

    let (shape, values) = array(&get(&service, &format!("{path}.npy")).await);
    assert_eq!(shape, [BASES as u64, 8]);
    assert_eq!(values.iter().skip(2).step_by(8).copied().collect::<Vec<_>>(), z);

    let back = service.post(&format!("/jobs/{id}/synthesis"), answer.to_string()).await;
    let back: Value = serde_json::from_slice(&bytes(back).await).unwrap();
    assert_eq!(back["names"][2], "z");
    let sphere = colored();
    for (i, z) in numbers(&back["values"][2]).iter().enumerate() {
        assert!((z - sphere.point(i)[2]).abs() < 0.05, "{i}: {z}");
    }
    let ply = service.post(&format!("/jobs/{id}/synthesis?format=ply"), answer.to_string()).await;
    let ply = read(&bytes(ply).await);
    assert_eq!((ply.fields()[2].name.as_str(), ply.dimension(), ply.faces().len()), ("f_z", 3, 2));
}

/// Results of earlier versions lack the stored coefficients.
#[tokio::test]
async fn coefficients_and_filtered_clouds_are_the_same_with_and_without_stored_coefficients() {
    let service = Service::start().await;
    let id = service.succeed(&format!("bases={BASES}"), file(&colored(), Format::Ply)).await;
    let paths = ["coefficients", "filtered?cutoff=3", "filtered?cutoff=3&field=red&format=json"];
    let mut with = Vec::new();
    for path in paths {
        with.push(get(&service, &format!("/jobs/{id}/{path}")).await);
    }
    let database = SqliteConnectOptions::new().filename(service.directory.path().join("test.db"));
    let mut file = database.connect().await.unwrap();
    let deleted = sqlx::query("DELETE FROM coefficients").execute(&mut file).await.unwrap();
    assert_eq!(deleted.rows_affected(), 8);
    for (path, with) in paths.iter().zip(with) {
        let without = get(&service, &format!("/jobs/{id}/{path}")).await;
        assert!(with == without, "{path}");
    }
}

#[tokio::test]
async fn posted_functions_have_the_same_coefficients_in_every_way_of_posting() {
    let (service, id) = finished().await;
    let path = format!("/jobs/{id}/coefficients");
    let expected = service.json(&path).await["fields"]["x"].clone();
    let x: Vec<f64> = (0..POINTS).map(|i| sphere(POINTS).point(i)[0]).collect();
    for (body, name) in [
        (json!(x).to_string().into_bytes(), "f0"),
        (json!([x]).to_string().into_bytes(), "f0"),
        (json!({"mine": x}).to_string().into_bytes(), "mine"),
        (npy(&x), "f0"),
    ] {
        let answer: Value = serde_json::from_slice(&bytes(service.post(&path, body).await).await).unwrap();
        assert_eq!(answer["fields"][name], expected);
    }
}

#[tokio::test]
async fn what_cannot_be_transformed_is_refused_with_the_reason() {
    let (service, id) = finished().await;
    let refused = async |resource: &str, body: String, status, kind| {
        let response = service.post(&format!("/jobs/{id}/{resource}"), body).await;
        detail(&problem(response, status, kind).await).to_owned()
    };
    let (bad, wrong) = (StatusCode::BAD_REQUEST, StatusCode::UNPROCESSABLE_ENTITY);
    let ones = vec![1.0; POINTS];
    let mut hole: Vec<Option<f64>> = ones.iter().copied().map(Some).collect();
    hole[7] = None;
    for (resource, body, status, kind, told) in [
        (
            "coefficients",
            json!([1, 2]).to_string(),
            wrong,
            "invalid-parameter",
            "2 values; the upload has 500",
        ),
        ("coefficients", json!(hole).to_string(), wrong, "invalid-parameter", "row 7"),
        ("coefficients", String::new(), bad, "malformed-request", "empty"),
        ("coefficients", "{".into(), bad, "malformed-request", "neither npy nor JSON"),
        ("coefficients", "{}".into(), bad, "malformed-request", "0 lists"),
        ("synthesis", json!(vec![1.0; BASES + 1]).to_string(), wrong, "invalid-parameter", "20 bases"),
        ("synthesis", "[null]".into(), wrong, "invalid-parameter", "place 0"),
        ("filtered", json!(vec![1.0; BASES + 1]).to_string(), wrong, "invalid-parameter", "20 bases"),
        ("filtered", json!([[1], [2]]).to_string(), bad, "malformed-request", "one list of gains"),
    ] {
        let detail = refused(resource, body, status, kind).await;
        assert!(detail.contains(told), "{resource}: {detail}");
    }
}

#[tokio::test]
async fn a_filtered_cloud_keeps_everything_else_of_the_upload() {
    let service = Service::start().await;
    let before = colored();
    let id = service.succeed(&format!("bases={BASES}"), file(&before, Format::Ply)).await;
    let after = read(&get(&service, &format!("/jobs/{id}/filtered?filter=enhance&from=1&to=4&gain=2")).await);
    assert_eq!(after.faces(), before.faces());
    assert_eq!(after.coordinate_type(), before.coordinate_type());
    for (one, other) in before.fields().iter().zip(after.fields()) {
        assert_eq!((&one.name, one.kind), (&other.name, other.kind));
        if !one.name.starts_with('n') {
            assert_eq!(one.values, other.values, "{}", one.name);
        }
    }
    let radius = |cloud: &PointCloud, i: usize| cloud.point(i).iter().map(|x| x * x).sum::<f64>().sqrt();
    assert!((0..POINTS).all(|i| (radius(&after, i) - 2.0).abs() < 0.1));
    // normals follow where the faces say so: those of rows 0 to 3
    assert_ne!(after.fields()[1].values[0], before.fields()[1].values[0]);
    assert_eq!(after.fields()[1].values[10], before.fields()[1].values[10]);

    let text = get(&service, &format!("/jobs/{id}/filtered?encoding=ascii")).await;
    let text = String::from_utf8(text).unwrap();
    assert!(text.starts_with("ply\nformat ascii 1.0\ncomment chladni job "), "{text:.200}");
    assert_eq!(read(text.as_bytes()).len(), POINTS);
}

#[tokio::test]
async fn a_filter_that_leaves_nothing_of_the_shape_says_so_in_every_answer_that_has_words() {
    let service = Service::start().await;
    let id = service.succeed(&format!("bases={BASES}"), file(&colored(), Format::Ply)).await;
    let path = format!("/jobs/{id}/filtered");
    let whole = service.json(&format!("{path}?format=json")).await;
    assert_eq!(whole["warnings"].as_array().unwrap().len(), 0, "{whole}");
    let one = service.json(&format!("{path}?format=json&cutoff=1")).await;
    assert!(one["warnings"][0].as_str().unwrap().contains("at one place"), "{one}");
    let text = String::from_utf8(get(&service, &format!("{path}?encoding=ascii&cutoff=1")).await).unwrap();
    assert!(text.contains("\ncomment warning: the filter leaves the points at one place"), "{text:.400}");
    let field = service.json(&format!("{path}?format=json&cutoff=1&field=red")).await;
    assert_eq!(field["warnings"].as_array().unwrap().len(), 0, "a field has no shape");
}

#[tokio::test]
async fn a_named_field_is_filtered_in_place_of_the_coordinates() {
    let service = Service::start().await;
    let before = colored();
    let id = service.succeed(&format!("bases={BASES}"), file(&before, Format::Ply)).await;
    let path = format!("/jobs/{id}/filtered?field=red,intensity&filter=low-pass&cutoff=1");
    let after = read(&get(&service, &path).await);
    assert_eq!(after.coordinates(), before.coordinates());
    assert_eq!(after.fields()[..3], before.fields()[..3]);
    // the mean is all that is left
    assert!(after.fields()[3].values.iter().all(|red| (red - 100.0).abs() <= 1.0));
    let json = service.json(&format!("{path}&format=json")).await;
    assert!(json["fields"]["red"].is_array() && json.get("coordinates").is_none(), "{json}");
    assert_eq!(json["gains"][0], 1.0);
    assert_eq!(json["gains"][1], 0.0);
    let change = &json["energy"]["intensity"];
    assert!(change["after"]["total"].as_f64().unwrap() < 1e-3 * change["before"]["total"].as_f64().unwrap());
    let (shape, values) = array(&get(&service, &format!("{path}&format=npy")).await);
    assert_eq!(shape, [POINTS as u64, 2]);
    assert_eq!(values[0], numbers(&json["fields"]["red"])[0]);
    let unknown = service.get(&format!("/jobs/{id}/filtered?field=blue")).await;
    let unknown = problem(unknown, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
    assert!(detail(&unknown).contains("red, intensity"), "{unknown}");
}

#[tokio::test]
async fn gains_that_are_posted_do_what_the_named_filter_does() {
    let (service, id) = finished().await;
    let path = format!("/jobs/{id}/filtered?format=npy");
    let named = array(&get(&service, &format!("{path}&filter=low-pass&cutoff=4")).await);
    for body in [
        json!([1, 1, 1, 1]).to_string().into_bytes(),
        json!({"gains": [1, 1, 1, 1]}).to_string().into_bytes(),
        npy(&[1.0; 4]),
    ] {
        assert_eq!(array(&bytes(service.post(&path, body).await).await), named);
    }
}

#[tokio::test]
async fn an_etag_stands_for_the_bytes_of_one_filter() {
    let (service, id) = finished().await;
    let etag = async |query: &str| {
        let response = service.get(&format!("/jobs/{id}/filtered?{query}")).await;
        response.headers()["etag"].to_str().unwrap().to_owned()
    };
    let one = etag("cutoff=4").await;
    assert_eq!(one, etag("cutoff=4&filter=low-pass").await);
    for other in [
        "cutoff=5",
        "cutoff=4&outside=0.5",
        "cutoff=4&encoding=ascii",
        "cutoff=4&format=npy",
        "cutoff=4&taper=0.1",
    ] {
        assert_ne!(one, etag(other).await, "{other}");
    }
    let url = service.url(&format!("/jobs/{id}/filtered?cutoff=4"));
    let again = service.client.get(&url).header("if-none-match", &one).send().await.unwrap();
    assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    let whole = get(&service, &format!("/jobs/{id}/filtered?cutoff=4")).await;
    let part = service.client.get(&url).header("range", "bytes=100-199").send().await.unwrap();
    assert_eq!(part.status(), StatusCode::PARTIAL_CONTENT);
    assert_eq!(part.bytes().await.unwrap(), whole[100..200]);
}

/// A client that asks for `path` and takes the first bytes of the answer; it holds the answer's memory until it is dropped.
fn slow_reader(service: &Service, path: &str) -> TcpStream {
    let mut stream = TcpStream::connect(service.app.address()).unwrap();
    stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n").as_bytes()).unwrap();
    let mut first = [0; 64];
    stream.read_exact(&mut first).unwrap();
    assert!(first.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&first));
    stream
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_client_has_or_only_asks_about_needs_no_memory() {
    let service = Service::start().await;
    let id = service.succeed(&format!("bases={BASES}"), file(&colored(), Format::Ply)).await;
    let operator = service.succeed("kind=operator", file(&sphere(POINTS), Format::Ply)).await;
    // 24 MB: more than the buffers of a connection hold.
    let large: Vec<_> = (0..1_000_000).flat_map(|i| format!("{i} 0 0\n").into_bytes()).collect();
    let large = service.post("/clouds?format=xyz&analyze=false", large).await;
    let large: Value = large.json().await.unwrap();
    let large = large["cloud"]["id"].as_str().unwrap();
    let mut answers = Vec::new();
    for path in [
        "filtered",
        "filtered.json?cutoff=3",
        "filtered.png",
        "coefficients",
        "coefficients.npy",
        "features",
        "features.ply",
        "signatures",
        "signatures.npy?count=3",
        "signatures.ply?count=3",
        "distances",
        "distances.npy?from=3&kind=diffusion",
        "distances.ply",
        "spectrum",
        "operator",
        "operator.mtx?matrix=b",
        "bases",
        "bases.npy",
        "bases.ply?first=3",
        "bases/1/image.png",
    ] {
        answers.push(format!("/jobs/{id}/{path}"));
    }
    answers.extend([format!("/jobs/{operator}/operator"), format!("/jobs/{operator}/operator.npz")]);
    let mut known = Vec::new();
    for path in answers {
        let response = service.get(&path).await;
        let headers = response.headers().clone();
        bytes(response).await;
        known.push((path, headers));
    }

    let service = service.restart_with(|settings| settings.body_memory = 1 << 20).await;
    let reader = slow_reader(&service, &format!("/clouds/{large}/points?format=npy"));
    let waits = service.client.get(service.url(&format!("/jobs/{id}/filtered"))).send();
    let waits = tokio::time::timeout(Duration::from_secs(1), waits).await;
    assert!(waits.is_err(), "there is no memory left: {waits:?}");
    for (path, headers) in &known {
        let etag = &headers["etag"];
        let url = service.url(path);
        let again = service.client.get(&url).header("if-none-match", etag).send().await.unwrap();
        assert_eq!(again.status(), StatusCode::NOT_MODIFIED, "{path}");
        let head = service.client.head(&url).send().await.unwrap();
        assert_eq!(head.status(), StatusCode::OK, "{path}");
        assert_eq!(&head.headers()["etag"], etag, "{path}");
        if let Some(length) = head.headers().get("content-length") {
            assert_eq!(length, &headers["content-length"], "{path}");
        }
        let is_streamed = ["bases", "signatures", "distances"].iter().any(|name| path.contains(name))
            && [".npy", ".ply"].iter().any(|ending| path.contains(ending));
        assert_eq!(head.headers().contains_key("content-length"), is_streamed, "{path}");
    }
    drop(reader);
    bytes(service.get(&format!("/jobs/{id}/filtered")).await).await;
}

#[tokio::test]
async fn a_time_belongs_to_the_distance_that_has_one() {
    let (service, id) = finished().await;
    for query in ["time=1", "time=1&kind=biharmonic"] {
        let response = service.get(&format!("/jobs/{id}/distances?{query}")).await;
        let refused = problem(response, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
        assert_eq!(refused["parameter"], "time", "{refused}");
        assert!(detail(&refused).contains("belongs to kind=diffusion"), "{refused}");
    }
}

#[tokio::test]
async fn wrong_filters_are_refused_by_the_argument_at_fault() {
    let (service, id) = finished().await;
    for (query, parameter, told) in [
        ("cutoff=21", "cutoff", "from 0 to 20"),
        ("cutoff=9&by=frequency", "cutoff", "ask for more bases"),
        ("filter=band-pass", "from", "where the band lies"),
        ("filter=band-pass&from=5&to=5", "to", "above `from`"),
        ("gain=2", "gain", "belongs to enhance"),
        ("filter=heat", "time", "is needed"),
        ("filter=lowpass", "filter", "low-pass"),
        ("outside=keep", "outside", "a number from 0"),
    ] {
        let response = service.get(&format!("/jobs/{id}/filtered?{query}")).await;
        let refused = problem(response, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
        assert_eq!(refused["parameter"], parameter, "{refused}");
        assert!(detail(&refused).contains(told), "{refused}");
    }
    let response = service.get(&format!("/jobs/{id}/filtered?cutof=3")).await;
    let refused = problem(response, StatusCode::UNPROCESSABLE_ENTITY, "unknown-parameter").await;
    assert_eq!(refused["nearest"], "cutoff");
}

#[tokio::test]
async fn rows_without_a_result_stay_and_duplicates_move_with_their_first_occurrence() {
    let service = Service::start().await;
    let sphere = sphere(POINTS);
    let first = [sphere.point(3)[0], sphere.point(3)[1], sphere.point(3)[2]];
    let body = sphere_and(POINTS, &[first, [0.0, f64::NAN, 7.0], [50.0, 0.0, 0.0]]);
    let id = service.succeed(&format!("bases={BASES}&nonfinite=drop"), body).await;
    let after = read(&get(&service, &format!("/jobs/{id}/filtered?filter=heat&time=0.5")).await);
    assert_eq!(after.point(POINTS), after.point(3));
    assert_ne!(after.point(3), sphere.point(3));
    assert!(after.point(POINTS + 1)[1].is_nan());
    assert_eq!(after.point(POINTS + 1)[2], 7.0);
    assert_eq!(after.point(POINTS + 2), [50.0, 0.0, 0.0]);
    let json = service.json(&format!("/jobs/{id}/filtered?format=json")).await;
    assert_eq!(json["rows_without_result"], 2);
    assert!(json["coordinates"][POINTS + 1][1].is_null());
    let signatures = service.json(&format!("/jobs/{id}/signatures?count=2")).await;
    assert!(signatures["values"][0][POINTS + 2].is_null() && signatures["values"][1][0].is_f64());
    let distances = service.json(&format!("/jobs/{id}/distances?from=3")).await;
    assert_eq!((&distances["values"][POINTS], &distances["values"][3]), (&json!(0.0), &json!(0.0)));
    let refused = service.get(&format!("/jobs/{id}/distances?from={}", POINTS + 1)).await;
    let refused = problem(refused, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
    assert!(detail(&refused).contains("carries no result"), "{refused}");
    let features = service.json(&format!("/jobs/{id}/features")).await;
    let lost = |feature: &Value| feature["index"].as_u64().unwrap() > POINTS as u64;
    assert!(!features["features"].as_array().unwrap().iter().any(lost), "{features}");
}

#[tokio::test]
async fn a_field_with_a_gap_is_filtered_around_it() {
    const GAP: usize = 7;
    let service = Service::start().await;
    let sphere = sphere(POINTS);
    let mut values: Vec<f64> = (0..POINTS).map(|i| sphere.point(i)[2]).collect();
    values[GAP] = f64::NAN;
    let field = ScalarField { name: "heat".to_owned(), kind: ScalarType::Float64, values: values.into() };
    let body = file(&sphere.clone().with_fields(vec![field]).unwrap(), Format::Ply);
    let id = service.succeed(&format!("bases={BASES}&operator=voronoi"), body).await;
    let json = service.json(&format!("/jobs/{id}/filtered?field=heat&cutoff=4&format=json")).await;
    let filtered = json["fields"]["heat"].as_array().unwrap();
    assert_eq!(filtered.iter().filter(|value| value.is_null()).count(), 1);
    assert!(filtered[GAP].is_null(), "a gap stays a gap");
    // z is an eigenfunction of the sphere, which modes 0 to 3 hold: but for the gap nothing changes
    for (i, value) in filtered.iter().enumerate().filter(|(i, _)| *i != GAP) {
        let (before, after) = (sphere.point(i)[2], value.as_f64().unwrap());
        assert!((after - before).abs() < 0.05, "{i}: {before} {after}");
    }
    let written = read(&get(&service, &format!("/jobs/{id}/filtered.ply?field=heat&cutoff=4")).await);
    assert!(written.fields()[0].values[GAP].is_nan());
}

#[tokio::test]
async fn feature_points_are_rows_of_the_upload_in_json_and_in_ply() {
    let service = Service::start().await;
    let shape = chladni::cloud::shapes::Shape::TwoHoleTorus;
    let request = chladni::cloud::shapes::SampleRequest::new(shape, 2_000);
    let torus = chladni::cloud::shapes::sample(&request).unwrap();
    let id = service.succeed("bases=30", file(&torus, Format::Ply)).await;
    let answer = service.json(&format!("/jobs/{id}/features")).await;
    let features = answer["features"].as_array().unwrap();
    assert!(features.len() >= 2, "{answer}");
    for feature in features {
        let index = feature["index"].as_u64().unwrap() as usize;
        assert_eq!(numbers(&feature["position"]), torus.point(index));
        let pair = numbers(&feature["pairs"][0]);
        assert_eq!(pair[0] + 1.0, pair[1]);
    }
    let persistence: Vec<f64> = features.iter().map(|f| f["persistence"].as_f64().unwrap()).collect();
    assert!(persistence.is_sorted_by(|a, b| a >= b) && persistence.last().unwrap() >= &0.1);
    let ply = read(&get(&service, &format!("/jobs/{id}/features.ply?limit=2")).await);
    assert_eq!((ply.len(), ply.fields()[0].name.as_str()), (2, "index"));
    assert_eq!(ply.fields()[0].values[0], features[0]["index"].as_f64().unwrap());
    let none = service.json(&format!("/jobs/{id}/features?persistence=1e9")).await;
    assert_eq!(none["features"], json!([]));
}

#[tokio::test]
async fn signatures_and_distances_are_the_same_in_every_format() {
    let (service, id) = finished().await;
    for (path, columns) in [
        ("signatures?kind=hks&count=3", 3),
        ("signatures?kind=wks&count=3", 3),
        ("distances?from=2", 1),
        ("distances?from=2&kind=diffusion&time=0.1", 1),
    ] {
        let json = service.json(&format!("/jobs/{id}/{path}")).await;
        let (shape, values) = array(&get(&service, &format!("/jobs/{id}/{path}&format=npy")).await);
        let ply = read(&get(&service, &format!("/jobs/{id}/{path}&format=ply")).await);
        assert_eq!(ply.coordinates(), sphere(POINTS).coordinates());
        assert_eq!(ply.fields().len(), columns);
        let expected = if columns == 1 { vec![POINTS as u64] } else { vec![POINTS as u64, columns as u64] };
        assert_eq!(shape, expected, "{path}");
        for column in 0..columns {
            let from_json = numbers(if columns == 1 { &json["values"] } else { &json["values"][column] });
            for i in 0..POINTS {
                assert_eq!(values[i * columns + column], from_json[i], "{path}");
                assert_eq!(ply.fields()[column].values[i], f64::from(from_json[i] as f32));
            }
        }
    }
}

#[tokio::test]
async fn similarity_tells_shapes_apart_and_not_samplings() {
    use chladni::cloud::shapes::{SampleRequest, Sampling, Shape, sample};
    let service = Service::start().await;
    let analyzed = async |shape, sampling| {
        let cloud = sample(&SampleRequest { sampling, ..SampleRequest::new(shape, 1_500) }).unwrap();
        service.succeed(&format!("bases={BASES}"), file(&cloud, Format::Npy)).await
    };
    let even = analyzed(Shape::Sphere, Sampling::Uniform).await;
    let random = analyzed(Shape::Sphere, Sampling::Iid).await;
    let other = analyzed(Shape::Torus, Sampling::Uniform).await;
    let distance = async |a: &str, b: &str| {
        service.json(&format!("/jobs/{a}/similarity/{b}")).await["distance"].as_f64().unwrap()
    };
    let (same, different) = (distance(&even, &random).await, distance(&even, &other).await);
    assert!(5.0 * same < different, "{same} {different}");
    assert_eq!(distance(&other, &even).await, different);
    assert_eq!(distance(&even, &even).await, 0.0);
    let nowhere = service.get(&format!("/jobs/{even}/similarity/{}", uuid::Uuid::now_v7())).await;
    problem(nowhere, StatusCode::NOT_FOUND, "not-found").await;
}

#[tokio::test]
async fn a_spectrum_tells_its_invariants() {
    let service = Service::start().await;
    let id = service.succeed("bases=100", file(&sphere(1_500), Format::Npy)).await;
    let invariants = service.json(&format!("/jobs/{id}/spectrum")).await["invariants"].clone();
    assert_eq!(invariants["euler_characteristic_rounded"], 2, "{invariants}");
    assert_eq!(invariants["is_open"], false);
    assert!(invariants["boundary_length"].is_null());
    let area = invariants["heat_trace_area"]["value"].as_f64().unwrap() / (4.0 * std::f64::consts::PI);
    assert!((area - 1.0).abs() < 0.02, "{invariants}");
}

#[tokio::test]
async fn harmonics_of_an_unfinished_or_an_operator_job_are_a_conflict_also_after_a_wait() {
    let service = Service::that_never_finishes().await;
    let submission = service.accept("bases=5", file(&sphere(100), Format::Ply)).await;
    let id = submission["job"]["id"].as_str().unwrap();
    service.running(id).await;
    for result in [
        "coefficients",
        "filtered",
        "filtered.ply",
        "features",
        "signatures.npy",
        "distances?wait=1",
        "similarity/",
    ] {
        let path = if result == "similarity/" {
            format!("/jobs/{id}/similarity/{id}")
        } else {
            format!("/jobs/{id}/{result}")
        };
        let refused = problem(service.get(&path).await, StatusCode::CONFLICT, "not-finished").await;
        assert_eq!(refused["state"], "running", "{result}");
    }
    let posted = service.post(&format!("/jobs/{id}/synthesis"), "[1]").await;
    problem(posted, StatusCode::CONFLICT, "not-finished").await;

    let service = Service::start().await;
    let id = service.succeed("kind=operator", file(&sphere(POINTS), Format::Ply)).await;
    let refused = service.get(&format!("/jobs/{id}/filtered")).await;
    let refused = problem(refused, StatusCode::CONFLICT, "no-such-result").await;
    assert!(detail(&refused).contains("eigen"), "{refused}");
}

#[tokio::test]
async fn a_result_can_be_waited_for() {
    let service = Service::start().await;
    let submission = service.accept("bases=5", file(&sphere(300), Format::Ply)).await;
    let id = submission["job"]["id"].as_str().unwrap();
    assert_eq!(read(&get(&service, &format!("/jobs/{id}/filtered.ply?wait=60&cutoff=4")).await).len(), 300);
}

#[tokio::test]
async fn json_over_the_limit_is_refused_and_other_formats_named() {
    let service = Service::start().await;
    let id = service.succeed("bases=4", file(&sphere(13_000), Format::Npy)).await;
    let refused = service.get(&format!("/jobs/{id}/signatures?count=256")).await;
    let refused = problem(refused, StatusCode::NOT_ACCEPTABLE, "not-acceptable").await;
    assert_eq!(refused["accepted"], json!(["npy", "ply"]));
    // two blocks of rows, streamed
    let (shape, values) = array(&get(&service, &format!("/jobs/{id}/signatures.npy?count=2")).await);
    assert_eq!(shape, [13_000, 2]);
    assert!(values.iter().all(|x| *x > 0.0));
}

#[tokio::test]
async fn capabilities_list_filters_and_what_results_take() {
    let service = Service::start().await;
    let capabilities = service.json("/capabilities").await;
    assert!(capabilities["filters"].as_array().unwrap().contains(&"band-stop".into()));
    let parameters = capabilities["results"]["filtered"]["parameters"].as_array().unwrap();
    let cutoff = parameters.iter().find(|parameter| parameter["name"] == "cutoff").unwrap();
    assert_eq!(cutoff["type"], "number");
    assert_eq!(capabilities["results"]["features"]["formats"][1]["name"], "ply");
}
