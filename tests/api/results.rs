//! Bases, spectra and operators of finished jobs.

#![allow(clippy::float_cmp)] // the same numbers, whatever the format

use chladni::cloud::reader::{self, Format, ReadOptions};
use chladni::cloud::{NonFinite, PointCloud};
use reqwest::{Method, StatusCode};
use serde_json::Value;

use crate::service::{Service, detail, file, problem, sphere, sphere_and};

const BASES: usize = 6;
const POINTS: usize = 300;

async fn finished() -> (Service, String) {
    let service = Service::start().await;
    let id = service.succeed(&format!("bases={BASES}"), file(&sphere(POINTS), Format::Ply)).await;
    (service, id)
}

fn read(bytes: &[u8], format: Format) -> PointCloud {
    let options = ReadOptions { policy: NonFinite::Drop, ..ReadOptions::default() };
    reader::read(bytes, format, &options).unwrap()
}

/// `(shape, values)` of an array file of doubles.
fn array(bytes: &[u8]) -> (Vec<u64>, Vec<f64>) {
    let file = npyz::NpyFile::new(bytes).unwrap();
    (file.shape().to_vec(), file.into_vec().unwrap())
}

async fn bytes(service: &Service, path: &str) -> Vec<u8> {
    let response = service.get(path).await;
    assert_eq!(response.status(), StatusCode::OK, "{path}");
    let announced = response.content_length();
    let bytes = response.bytes().await.unwrap().to_vec();
    assert_eq!(announced, Some(bytes.len() as u64), "{path}");
    bytes
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

#[tokio::test]
async fn json_array_and_ply_hold_the_same_bases() {
    let (service, id) = finished().await;
    let json = service.json(&format!("/jobs/{id}/bases")).await;
    assert_eq!(json["points"], POINTS);
    assert_eq!(json["first"], 0);
    assert_eq!(json["count"], BASES);
    assert_eq!(json["eigenvalues"].as_array().unwrap().len(), BASES);
    let (shape, values) = array(&bytes(&service, &format!("/jobs/{id}/bases?format=npy")).await);
    assert_eq!(shape, [POINTS as u64, BASES as u64]);
    let ply = read(&bytes(&service, &format!("/jobs/{id}/bases.ply")).await, Format::Ply);
    assert_eq!(ply.coordinates(), sphere(POINTS).coordinates());
    for j in 0..BASES {
        assert_eq!(ply.fields()[j].name, format!("basis_{j}"));
        for i in 0..POINTS {
            let value = values[i * BASES + j];
            assert_eq!(number(&json["bases"][j][i]), value);
            assert_eq!(ply.fields()[j].values[i], f64::from(value as f32));
        }
    }
    let single = bytes(&service, &format!("/jobs/{id}/bases.npy?dtype=f32")).await;
    let single: Vec<f32> = npyz::NpyFile::new(&single[..]).unwrap().into_vec().unwrap();
    assert!(single.iter().zip(&values).all(|(single, double)| *single == *double as f32));
}

#[tokio::test]
async fn an_archive_and_a_table_hold_the_points_beside_the_bases() {
    let service = Service::start().await;
    let mut upload = file(&sphere(POINTS), Format::Xyz);
    upload.extend_from_slice(b"nan 0 0\n");
    let id = service.succeed(&format!("format=xyz&nonfinite=drop&bases={BASES}"), upload).await;
    let (_, values) = array(&bytes(&service, &format!("/jobs/{id}/bases.npy?first=1")).await);
    let count = BASES - 1;

    let whole = bytes(&service, &format!("/jobs/{id}/bases.npz?first=1")).await;
    let mut archive = npyz::npz::NpzArchive::new(std::io::Cursor::new(whole)).unwrap();
    let mut member = |name: &str| {
        let array = archive.by_name(name).unwrap().unwrap();
        (array.shape().to_vec(), array.into_vec::<f64>().unwrap())
    };
    let (shape, found) = member("bases");
    assert_eq!(shape, [POINTS as u64 + 1, count as u64]);
    assert!(found.iter().zip(&values).all(|(a, b)| a.to_bits() == b.to_bits()));
    let (shape, points) = member("points");
    assert_eq!(shape, [POINTS as u64 + 1, 3]);
    assert_eq!(points[..3 * POINTS], *sphere(POINTS).coordinates());
    let eigenvalues: Vec<f64> =
        service.json(&format!("/jobs/{id}/spectrum")).await["eigenvalues"].as_array().unwrap()[1..]
            .iter()
            .map(number)
            .collect();
    assert_eq!(member("eigenvalues"), (vec![count as u64], eigenvalues));
    let (shape, mass) = member("mass");
    assert_eq!(shape, [POINTS as u64 + 1]);
    let norm: f64 = (0..POINTS).map(|i| mass[i] * values[i * count] * values[i * count]).sum();
    assert!((norm - 1.0).abs() < 1e-8, "{norm}");

    let response = service.get(&format!("/jobs/{id}/bases?format=csv&first=1")).await;
    assert_eq!(response.headers()["content-type"], "text/csv");
    assert!(!response.headers().contains_key("accept-ranges"), "its length is not known beforehand");
    let text = response.text().await.unwrap();
    assert_eq!(text.lines().next().unwrap(), "x,y,z,basis_1,basis_2,basis_3,basis_4,basis_5");
    assert_eq!(text.lines().count(), POINTS + 2);
    assert!(text.ends_with("nan,nan,nan,nan,nan\n"), "{text}");
    let table = read(text.as_bytes(), Format::Csv);
    for j in 0..count {
        for i in 0..POINTS {
            assert_eq!(table.fields()[j].values[i], values[i * count + j]);
        }
    }
}

#[tokio::test]
async fn a_part_of_the_bases_is_that_part_of_the_whole() {
    let (service, id) = finished().await;
    let (_, whole) = array(&bytes(&service, &format!("/jobs/{id}/bases.npy")).await);
    let (shape, part) = array(&bytes(&service, &format!("/jobs/{id}/bases.npy?first=2&count=3")).await);
    assert_eq!(shape, [POINTS as u64, 3]);
    for i in 0..POINTS {
        assert_eq!(part[3 * i..3 * i + 3], whole[BASES * i + 2..BASES * i + 5]);
    }
    let json = service.json(&format!("/jobs/{id}/bases?first=5")).await;
    assert_eq!((json["first"].as_u64(), json["count"].as_u64()), (Some(5), Some(1)));
    for query in ["first=6", "first=2&count=5", "count=7"] {
        let refused = service.get(&format!("/jobs/{id}/bases?{query}")).await;
        let refused = problem(refused, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
        assert_eq!(refused["available"], BASES, "{query}");
    }
}

#[tokio::test]
async fn the_bases_are_orthonormal_in_the_mass_that_is_served() {
    let (service, id) = finished().await;
    let (_, values) = array(&bytes(&service, &format!("/jobs/{id}/bases.npy")).await);
    let text = bytes(&service, &format!("/jobs/{id}/operator.mtx?matrix=b")).await;
    let text = String::from_utf8(text).unwrap();
    let mass: Vec<f64> =
        text.lines().skip(2).map(|line| line.rsplit_once(' ').unwrap().1.parse().unwrap()).collect();
    assert_eq!(mass.len(), POINTS);
    for i in 0..BASES {
        for j in 0..BASES {
            let dot: f64 = (0..POINTS).map(|p| mass[p] * values[p * BASES + i] * values[p * BASES + j]).sum();
            let expected = if i == j { 1.0 } else { 0.0 };
            assert!((dot - expected).abs() < 1e-8, "{i} {j}: {dot}");
        }
    }
}

#[tokio::test]
async fn ranges_put_together_are_the_whole() {
    let (service, id) = finished().await;
    for file in ["bases.npy", "bases.ply", "bases.npz"] {
        let path = format!("/jobs/{id}/{file}");
        let whole = bytes(&service, &path).await;
        let mut parts = Vec::new();
        while parts.len() < whole.len() {
            let range = format!("bytes={}-{}", parts.len(), parts.len() + 999);
            let part = service.client.get(service.url(&path)).header("range", range).send().await.unwrap();
            assert_eq!(part.status(), StatusCode::PARTIAL_CONTENT);
            let last = whole.len().min(parts.len() + 1000) - 1;
            let expected = format!("bytes {}-{last}/{}", parts.len(), whole.len());
            assert_eq!(part.headers()["content-range"], expected);
            parts.extend(part.bytes().await.unwrap());
        }
        assert_eq!(parts, whole, "{file}");
        let beyond =
            service.client.get(service.url(&path)).header("range", "bytes=99999999-").send().await.unwrap();
        assert_eq!(beyond.headers()["content-range"], format!("bytes */{}", whole.len()));
        problem(beyond, StatusCode::RANGE_NOT_SATISFIABLE, "range-not-satisfiable").await;
    }
}

#[tokio::test]
async fn head_announces_the_length_of_the_answer_or_none() {
    let (service, id) = finished().await;
    for (file, is_known) in [
        ("bases.npy", true),
        ("bases.npz", true),
        ("bases.json", false),
        ("bases.csv", false),
        ("bases.ply", true),
    ] {
        let url = service.url(&format!("/jobs/{id}/{file}"));
        let head = service.client.head(&url).send().await.unwrap();
        let got = service.client.get(&url).send().await.unwrap();
        assert_eq!(head.headers()["etag"], got.headers()["etag"], "{file}");
        assert_eq!(head.headers().get("content-length"), got.headers().get("content-length"), "{file}");
        assert_eq!(head.headers().contains_key("content-length"), is_known, "{file}");
    }
}

#[tokio::test]
async fn bytes_that_the_client_has_are_not_sent_again() {
    let (service, id) = finished().await;
    let path = format!("/jobs/{id}/bases.npy");
    let etag = service.get(&path).await.headers()["etag"].clone();
    let send = async |path: &str, name: &str, etag: &str| {
        let request = service.client.get(service.url(path)).header(name, etag).header("range", "bytes=0-9");
        request.send().await.unwrap().status()
    };
    let etag = etag.to_str().unwrap();
    assert_eq!(send(&path, "if-none-match", etag).await, StatusCode::NOT_MODIFIED);
    assert_eq!(send(&format!("{path}?dtype=f32"), "if-none-match", etag).await, StatusCode::PARTIAL_CONTENT);
    assert_eq!(send(&path, "if-range", etag).await, StatusCode::PARTIAL_CONTENT);
    assert_eq!(send(&path, "if-range", "\"other\"").await, StatusCode::OK);
}

#[tokio::test]
async fn head_tells_the_length_without_the_bytes() {
    let (service, id) = finished().await;
    let response = service
        .client
        .request(Method::HEAD, service.url(&format!("/jobs/{id}/bases.npy")))
        .send()
        .await
        .unwrap();
    assert_eq!(response.status(), StatusCode::OK);
    let whole = bytes(&service, &format!("/jobs/{id}/bases.npy")).await;
    assert_eq!(response.headers()["content-length"], whole.len().to_string());
    assert_eq!(response.headers()["accept-ranges"], "bytes");
    let disposition = response.headers()["content-disposition"].to_str().unwrap();
    assert!(disposition.contains(".npy") && disposition.starts_with("attachment"), "{disposition}");
    assert!(response.bytes().await.unwrap().is_empty());
}

#[tokio::test]
async fn the_accept_header_chooses_the_format() {
    let (service, id) = finished().await;
    let ask = async |accept: &str| {
        let request = service.client.get(service.url(&format!("/jobs/{id}/bases"))).header("accept", accept);
        request.send().await.unwrap()
    };
    for (accept, media_type) in [
        ("application/x-npy", "application/x-npy"),
        ("application/json;q=0.1, model/ply", "application/ply"),
        ("*/*", "application/json"),
    ] {
        assert_eq!(ask(accept).await.headers()["content-type"], media_type, "{accept}");
    }
    problem(ask("image/png").await, StatusCode::NOT_ACCEPTABLE, "not-acceptable").await;
}

#[tokio::test]
async fn json_over_the_limit_is_refused_and_npy_named() {
    let service = Service::start().await;
    let id = service.succeed("bases=150", file(&sphere(21_000), Format::Npy)).await;
    let refused = problem(
        service.get(&format!("/jobs/{id}/bases")).await,
        StatusCode::NOT_ACCEPTABLE,
        "not-acceptable",
    )
    .await;
    assert!(detail(&refused).contains("npy"), "{refused}");
    let (shape, values) = array(&bytes(&service, &format!("/jobs/{id}/bases.npy")).await);
    assert_eq!(shape, [21_000, 150]);
    let some = service.json(&format!("/jobs/{id}/bases?first=149")).await;
    for i in [0, 8191, 8192, 20_999] {
        assert_eq!(number(&some["bases"][0][i]), values[i * 150 + 149]);
    }
}

#[tokio::test]
async fn duplicates_have_the_values_of_their_first_occurrence() {
    let service = Service::start().await;
    let sphere = sphere(POINTS);
    let repeated = [sphere.point(7), sphere.point(0)].map(|point| [point[0], point[1], point[2]]);
    let submission = service.accept("bases=4", sphere_and(POINTS, &repeated)).await;
    assert_eq!(submission["cloud"]["duplicates"], 2);
    let id = submission["job"]["id"].as_str().unwrap();
    assert_eq!(service.finished(id).await["state"], "succeeded");
    let json = service.json(&format!("/jobs/{id}/bases")).await;
    for basis in json["bases"].as_array().unwrap() {
        assert_eq!(basis[POINTS], basis[7]);
        assert_eq!(basis[POINTS + 1], basis[0]);
        assert!(basis[7].is_f64());
    }
}

#[tokio::test]
async fn rows_that_were_dropped_have_no_values() {
    let service = Service::start().await;
    let body = sphere_and(POINTS, &[[0.0, f64::NAN, 0.0]]);
    let id = service.succeed("bases=4&nonfinite=drop", body).await;
    let json = service.json(&format!("/jobs/{id}/bases")).await;
    assert!(json["bases"][3][POINTS].is_null() && json["bases"][3][0].is_f64());
    let (_, values) = array(&bytes(&service, &format!("/jobs/{id}/bases.npy")).await);
    assert!(
        values[4 * POINTS..].iter().all(|x| x.is_nan()) && values[..4 * POINTS].iter().all(|x| x.is_finite())
    );
}

#[tokio::test]
async fn the_spectrum_is_ascending_and_the_same_as_csv() {
    let (service, id) = finished().await;
    let json = service.json(&format!("/jobs/{id}/spectrum")).await;
    assert_eq!(json["job_id"], id);
    let eigenvalues: Vec<f64> = json["eigenvalues"].as_array().unwrap().iter().map(number).collect();
    assert!(eigenvalues.is_sorted() && eigenvalues.len() == BASES);
    // The unit sphere: 0, then 2 three times.
    assert!(eigenvalues[0].abs() < 1e-6, "{eigenvalues:?}");
    assert!(eigenvalues[1..4].iter().all(|x| (x - 2.0).abs() < 0.1), "{eigenvalues:?}");
    let response = service.get(&format!("/jobs/{id}/spectrum.csv")).await;
    assert_eq!(response.headers()["content-type"], "text/csv");
    let text = response.text().await.unwrap();
    let mut rows = text.lines();
    assert_eq!(rows.next(), Some("index,eigenvalue,raw_eigenvalue,residual,frequency"));
    for (i, row) in rows.enumerate() {
        let cells: Vec<f64> = row.split(',').map(|cell| cell.parse().unwrap()).collect();
        assert_eq!(cells[..2], [i as f64, eigenvalues[i]]);
        assert_eq!(cells[2], number(&json["raw_eigenvalues"][i]));
        assert_eq!(cells[3], number(&json["residuals"][i]));
    }
}

#[tokio::test]
async fn an_operator_job_hands_its_matrices_out() {
    let service = Service::start().await;
    let id = service.succeed("kind=operator", file(&sphere(POINTS), Format::Ply)).await;
    let description = service.json(&format!("/jobs/{id}/operator")).await;
    assert_eq!(description["kind"], "operator");
    assert!(description.get("spectrum").is_none());
    let text = String::from_utf8(bytes(&service, &format!("/jobs/{id}/operator.mtx")).await).unwrap();
    assert!(text.starts_with("%%MatrixMarket matrix coordinate real symmetric\n"));
    let archive = bytes(&service, &format!("/jobs/{id}/operator?format=npz")).await;
    let mut archive = npyz::npz::NpzArchive::new(std::io::Cursor::new(archive)).unwrap();
    let csr = npyz::sparse::Csr::<f64>::from_npz(&mut archive).unwrap();
    assert_eq!(csr.shape, [POINTS as u64, POINTS as u64]);
    let lower = (0..POINTS)
        .flat_map(|row| csr.indices[csr.indptr[row]..csr.indptr[row + 1]].iter().map(move |c| (row, *c)));
    let lower = lower.filter(|(row, column)| *column as usize <= *row).count();
    assert_eq!(text.lines().nth(1).unwrap(), format!("{POINTS} {POINTS} {lower}"));
    for row in 0..POINTS {
        let sum: f64 = csr.data[csr.indptr[row]..csr.indptr[row + 1]].iter().sum();
        assert!(sum.abs() < 1e-9, "row {row} of Q sums to {sum}");
    }
    let refused =
        problem(service.get(&format!("/jobs/{id}/bases")).await, StatusCode::CONFLICT, "no-such-result")
            .await;
    assert!(detail(&refused).contains("eigen"), "{refused}");
}

#[tokio::test]
async fn an_eigen_job_sends_who_asks_for_q_to_an_operator_job() {
    let (service, id) = finished().await;
    let refused = service.get(&format!("/jobs/{id}/operator?format=mtx")).await;
    let refused = problem(refused, StatusCode::CONFLICT, "no-such-result").await;
    assert!(detail(&refused).contains("\"kind\": \"operator\""), "{refused}");
    let path = refused["links"]["jobs"].as_str().unwrap();
    let response = service.post(path, r#"{"kind": "operator"}"#).await;
    assert_eq!(response.status(), StatusCode::ACCEPTED);
}

#[tokio::test]
async fn a_cloud_tells_of_its_sampling_once_a_job_has_measured_it() {
    let service = Service::start().await;
    let submission = service.accept("bases=4", file(&sphere(POINTS), Format::Ply)).await;
    let path = submission["links"]["cloud"].as_str().unwrap();
    service.finished(submission["job"]["id"].as_str().unwrap()).await;
    let cloud = service.json(path).await;
    assert_eq!(cloud["points_used"], POINTS);
    assert_eq!(cloud["dimension"], 3);
    assert!(cloud["bounding_box"]["maximum"][0].as_f64().unwrap() > 0.9);
    assert!(cloud["sampling"]["epsilon"].as_f64().unwrap() > 0.0, "{cloud}");
}
