//! Clouds in other formats, and pictures.

#![allow(clippy::float_cmp)] // the same numbers, whatever the format

use std::io::Cursor;

use chladni::cloud::reader::{self, Format, ReadOptions};
use chladni::cloud::{NonFinite, PointCloud, ScalarField, ScalarType};
use las::{Builder, Transform, Vector};
use reqwest::{Method, StatusCode};
use serde_json::Value;

use crate::service::{Service, detail, file, problem, sphere};

/// A scale that is not a power of ten, offsets that are no multiples of it.
const SCALES: [f64; 3] = [0.001, 0.000_25, 0.01];
const OFFSETS: [f64; 3] = [1_000_000.0, 5_200_000.123, -77.7];

/// A scan of 300 points as another program writes it, and the steps that its coordinates are.
fn scan(is_compressed: bool) -> (Vec<u8>, Vec<[i32; 3]>) {
    let transform = |axis: usize| Transform { scale: SCALES[axis], offset: OFFSETS[axis] };
    let mut builder = Builder::from((1, 2));
    builder.point_format = las::point::Format::new(1).unwrap();
    builder.point_format.is_compressed = is_compressed;
    builder.transforms = Vector { x: transform(0), y: transform(1), z: transform(2) };
    let mut writer = las::Writer::new(Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
    let steps: Vec<[i32; 3]> =
        (0..300).map(|i: i32| [i * i * 17 - 800_000, 1_999_999_999 - 1_237 * i, i % 97 - 40]).collect();
    for steps in &steps {
        let [x, y, z] = [0, 1, 2].map(|axis| f64::from(steps[axis]) * SCALES[axis] + OFFSETS[axis]);
        writer.write_point(las::Point { x, y, z, gps_time: Some(0.0), ..las::Point::default() }).unwrap();
    }
    (writer.into_inner().unwrap().into_inner(), steps)
}

/// A georeferenced sphere in millimeters, with a color and an intensity.
fn survey() -> PointCloud {
    let sphere = sphere(200);
    let place = |x: f64, offset: f64| (x * 1000.0).round() / 1000.0 + offset;
    let offsets = [500_000.0, 5_200_000.0, 100.0];
    let rows = (0..200).flat_map(|row| [0, 1, 2].map(|axis| place(sphere.point(row)[axis], offsets[axis])));
    let field = |name: &str, kind, value: fn(usize) -> f64| ScalarField {
        name: name.to_owned(),
        kind,
        values: (0..200).map(value).collect(),
    };
    let fields = vec![
        field("intensity", ScalarType::Uint16, |i| 7.0 * i as f64),
        field("red", ScalarType::Uint16, |i| i as f64),
        field("green", ScalarType::Uint16, |_| 1.0),
        field("blue", ScalarType::Uint16, |_| 65_535.0),
    ];
    PointCloud::new(3, rows.collect(), NonFinite::Reject).unwrap().with_fields(fields).unwrap()
}

async fn stored(service: &Service, bytes: Vec<u8>) -> String {
    let created: Value = service.post("/clouds?analyze=false", bytes).await.json().await.unwrap();
    created["links"]["points"].as_str().expect("a stored cloud is linked").to_owned()
}

#[tokio::test]
async fn a_survey_in_las_comes_back_in_every_format_to_the_last_digit() {
    let service = Service::start().await;
    let path = stored(&service, file(&survey(), Format::Las)).await;
    let formats = [
        ("ply", Format::Ply, "application/ply"),
        ("ply&encoding=ascii", Format::Ply, "application/ply"),
        ("csv", Format::Csv, "text/csv"),
        ("xyz", Format::Xyz, "text/x-xyz"),
        ("las", Format::Las, "application/vnd.las"),
        ("laz", Format::Laz, "application/vnd.laszip"),
    ];
    for (name, format, media_type) in formats {
        let response = service.get(&format!("{path}?format={name}")).await;
        assert_eq!(response.headers()["content-type"], media_type);
        let disposition = response.headers()["content-disposition"].to_str().unwrap().to_owned();
        assert!(disposition.ends_with(&format!(".{}\"", format.name())), "{disposition}");
        let announced = response.content_length();
        let bytes = response.bytes().await.unwrap();
        assert_eq!(announced, Some(bytes.len() as u64));
        let back = reader::read(&bytes, format, &ReadOptions::default()).unwrap();
        for (found, expected) in back.coordinates().iter().zip(survey().coordinates()) {
            // A unit in the last place of 5.2e6.
            assert!((found - expected).abs() < 1e-9, "{name}: {found} {expected}");
        }
        for field in survey().fields() {
            let found = back.fields().iter().find(|found| found.name == field.name).unwrap();
            assert_eq!(found.values, field.values, "{name} {}", field.name);
        }
    }
    let npz = service.get(&format!("{path}?format=npz")).await.bytes().await.unwrap();
    let mut archive = npyz::npz::NpzArchive::new(std::io::Cursor::new(npz)).unwrap();
    assert_eq!(archive.by_name("points").unwrap().unwrap().shape(), [200, 3]);
    assert_eq!(archive.by_name("intensity").unwrap().unwrap().into_vec::<u16>().unwrap()[3], 21);
}

#[tokio::test]
async fn points_under_a_file_name_are_those_of_the_format() {
    let service = Service::start().await;
    let path = stored(&service, file(&survey(), Format::Las)).await;
    let capabilities = service.json("/capabilities").await;
    for format in capabilities["formats"]["points"].as_array().unwrap() {
        let name = format["name"].as_str().unwrap();
        if ["obj", "off", "stl"].contains(&name) {
            continue; // without faces
        }
        let named = service.get(&format!("{path}.{name}")).await;
        assert_eq!(named.status(), StatusCode::OK, "{name}");
        assert_eq!(named.headers()["content-type"], format["media_type"].as_str().unwrap());
        let asked = service.get(&format!("{path}?format={name}")).await;
        assert_eq!(named.headers()["etag"], asked.headers()["etag"]);
        assert_eq!(named.bytes().await.unwrap(), asked.bytes().await.unwrap(), "{name}");
    }
    let told = problem(
        service.get(&format!("{path}.ply?format=npy")).await,
        StatusCode::UNPROCESSABLE_ENTITY,
        "unknown-parameter",
    )
    .await;
    assert!(detail(&told).contains("format"), "{told}");
    problem(service.get(&format!("{path}.docx")).await, StatusCode::NOT_FOUND, "not-found").await;
}

#[tokio::test]
async fn points_are_had_as_meshes_and_pcd_and_without_rows_that_have_no_position() {
    let service = Service::start().await;
    let text = b"OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 nan 0\n3 0 1 2\n".to_vec();
    let created: Value =
        service.post("/clouds?analyze=false&nonfinite=drop", text).await.json().await.unwrap();
    let path = created["links"]["points"].as_str().unwrap();
    for (name, rows) in [("obj", 3), ("off", 3), ("stl", 3), ("pcd", 3), ("las", 3)] {
        let response = service.get(&format!("{path}?format={name}&nonfinite=omit")).await;
        assert_eq!(response.status(), StatusCode::OK, "{name}");
        let bytes = response.bytes().await.unwrap();
        let format = Format::from_name(name).unwrap();
        let back = reader::read(&bytes, format, &ReadOptions::default()).unwrap();
        assert_eq!(back.len(), rows, "{name}");
    }
    let response = service.get(&format!("{path}?format=las")).await;
    problem(response, StatusCode::NOT_ACCEPTABLE, "not-acceptable").await;
}

#[tokio::test]
async fn a_default_that_a_small_cloud_does_not_allow_is_lowered_and_told() {
    let service = Service::start().await;
    let id = service.succeed("operator=voronoi", file(&sphere(60), Format::Ply)).await;
    let job = service.json(&format!("/jobs/{id}")).await;
    assert_eq!(job["parameters"]["bases"], 60);
    let warnings = job["warnings"].as_array().unwrap();
    let is_told =
        |warning: &Value| warning.as_str().unwrap().contains("the most that 60 distinct points allow");
    assert!(warnings.iter().any(is_told), "{job}");
}

#[tokio::test]
async fn many_rows_at_few_places_and_points_without_a_result_lower_the_default_too() {
    let service = Service::start().await;
    let sphere = sphere(60);
    let rows: Vec<f64> = sphere.coordinates().repeat(20);
    let repeated = PointCloud::new(3, rows, NonFinite::Reject).unwrap();
    let stray = [sphere.coordinates(), &[90.0, 0.0, 0.0]].concat();
    let stray = PointCloud::new(3, stray, NonFinite::Reject).unwrap();
    for (cloud, told) in [
        (repeated, "60 bases were computed, the most that 60 distinct points allow"),
        (stray, "60 bases were computed in place of 61: of 61 distinct points 60 have a result"),
    ] {
        let id = service.succeed("operator=voronoi", file(&cloud, Format::Ply)).await;
        let job = service.json(&format!("/jobs/{id}")).await;
        let warnings = job["warnings"].as_array().unwrap();
        assert!(warnings.iter().any(|warning| warning.as_str().unwrap().contains(told)), "{job}");
        let spectrum = service.json(&format!("/jobs/{id}/spectrum")).await;
        assert_eq!(spectrum["eigenvalues"].as_array().unwrap().len(), 60);
    }
}

#[tokio::test]
async fn a_scan_comes_back_on_its_own_grid_bit_for_bit() {
    let service = Service::start().await;
    for is_compressed in [false, true] {
        let (bytes, steps) = scan(is_compressed);
        let path = stored(&service, bytes).await;
        for (name, transformed) in [("las", true), ("laz", true), ("ply", false), ("csv", false)] {
            let bytes = service.get(&format!("{path}?format={name}")).await.bytes().await.unwrap();
            if transformed {
                let reader = las::Reader::new(Cursor::new(bytes.to_vec())).unwrap();
                let Vector { x, y, z } = *reader.header().transforms();
                assert_eq!([x, y, z].map(|axis| axis.scale), SCALES, "{name}");
                assert_eq!([x, y, z].map(|axis| axis.offset), OFFSETS, "{name}");
            }
            let back =
                reader::read(&bytes, Format::from_name(name).unwrap(), &ReadOptions::default()).unwrap();
            for (row, steps) in steps.iter().enumerate() {
                let expected = [0, 1, 2].map(|axis| f64::from(steps[axis]) * SCALES[axis] + OFFSETS[axis]);
                assert_eq!(back.point(row), expected, "{name}, row {row}");
            }
        }
    }
}

#[tokio::test]
async fn a_filtered_survey_is_the_filtered_object_moved() {
    let service = Service::start().await;
    let offsets = [500_000.0, 5_200_000.0, 100.0];
    let here = sphere(300);
    let moved = here.coordinates().chunks(3).flat_map(|p| [0, 1, 2].map(|axis| p[axis] + offsets[axis]));
    let there = PointCloud::new(3, moved.collect(), NonFinite::Reject).unwrap();
    let mut filtered = Vec::new();
    for cloud in [&here, &there] {
        let id = service.succeed("bases=9", file(cloud, Format::Npy)).await;
        let bytes = service.get(&format!("/jobs/{id}/filtered.ply?cutoff=4")).await.bytes().await.unwrap();
        let cloud = reader::read(&bytes, Format::Ply, &ReadOptions::default()).unwrap();
        assert_eq!(cloud.coordinate_type(), ScalarType::Float64);
        filtered.push(cloud);
    }
    let pairs = filtered[0].coordinates().iter().zip(filtered[1].coordinates()).enumerate();
    let farthest = pairs.map(|(i, (here, there))| (here + offsets[i % 3] - there).abs()).fold(0.0, f64::max);
    // Two hundred units in the last place of 5.2e6.
    assert!(farthest < 2e-7, "{farthest:e}");
}

#[tokio::test]
async fn a_cloud_that_a_format_cannot_hold_is_refused_with_formats_that_can() {
    let service = Service::start().await;
    let text = (0..30).map(|i| format!("{i} {} 0 {}\n", i * i, i % 3)).collect::<Vec<_>>().concat();
    let created: Value =
        service.post("/clouds?analyze=false&coordinates=4", text).await.json().await.unwrap();
    let path = created["links"]["points"].as_str().unwrap();
    let response = service.get(&format!("{path}?format=las")).await;
    let refused = problem(response, StatusCode::NOT_ACCEPTABLE, "not-acceptable").await;
    assert!(detail(&refused).contains("these points have 4"), "{refused}");
    assert_eq!(refused["accepted"][0], "ply");
}

#[tokio::test]
async fn binary_formats_are_told_from_their_bytes_and_scans_by_number() {
    let service = Service::start().await;
    let mut stl = vec![0; 84];
    stl[80] = 4;
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0_f32]];
    for face in [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]] {
        stl.extend([0; 12]);
        stl.extend(face.iter().flat_map(|&corner: &usize| corners[corner]).flat_map(f32::to_le_bytes));
        stl.extend([0; 2]);
    }
    let created: Value = service.post("/clouds?analyze=false", stl).await.json().await.unwrap();
    assert_eq!((&created["cloud"]["points"], &created["cloud"]["faces"]), (&4.into(), &4.into()));
    let pcd = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA ascii\n1 2 x\n";
    let refused =
        problem(service.post("/clouds", pcd).await, StatusCode::BAD_REQUEST, "malformed-file").await;
    assert_eq!(
        detail(&refused),
        "PCD, line 8: `x` is not a number; decimal numbers such as -1.5e-3 are accepted"
    );
    let refused = service.post("/clouds?scan=some", pcd).await;
    problem(refused, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
}

async fn png(service: &Service, path: &str) -> Vec<u8> {
    let response = service.get(path).await;
    assert_eq!(response.status(), StatusCode::OK, "{path}");
    assert_eq!(response.headers()["content-type"], "image/png");
    let bytes = response.bytes().await.unwrap().to_vec();
    assert!(bytes.starts_with(b"\x89PNG\r\n\x1a\n"), "{path}");
    bytes
}

#[tokio::test]
async fn bases_filtered_clouds_feature_points_and_clouds_are_drawn() {
    let service = Service::start().await;
    let id = service.succeed("bases=6", file(&sphere(300), Format::Ply)).await;
    let cloud = service.json(&format!("/jobs/{id}")).await["cloud_id"].as_str().unwrap().to_owned();
    let size = "width=90&height=60";
    let paths = [
        format!("/jobs/{id}/bases/1/image.png?{size}"),
        format!("/jobs/{id}/bases/2/image.png?{size}"),
        format!("/jobs/{id}/bases/2/image.png?{size}&azimuth=40&up=y"),
        format!("/jobs/{id}/filtered.png?cutoff=3&{size}"),
        format!("/jobs/{id}/features.png?{size}"),
        format!("/clouds/{cloud}/points?format=png&{size}"),
    ];
    let mut pictures = Vec::new();
    for path in &paths {
        let picture = png(&service, path).await;
        assert!(!pictures.contains(&picture), "{path}");
        assert_eq!(png(&service, path).await, picture, "the same picture every time");
        pictures.push(picture);
    }
    let first = service.get(&paths[0]).await;
    let etag = first.headers()["etag"].clone();
    let again =
        service.client.get(service.url(&paths[0])).header("if-none-match", etag).send().await.unwrap();
    assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    let head = service.client.request(Method::HEAD, service.url(&paths[0])).send().await.unwrap();
    assert_eq!(head.headers()["etag"], first.headers()["etag"]);
    assert!(!head.headers().contains_key("content-length"), "the length is known once it is drawn");
}

#[tokio::test]
async fn a_picture_of_what_is_not_there_is_refused() {
    let service = Service::start().await;
    let id = service.succeed("bases=4", file(&sphere(100), Format::Ply)).await;
    for (path, kind, status) in [
        ("bases/4/image.png", "not-found", StatusCode::NOT_FOUND),
        ("bases/first/image.png", "not-found", StatusCode::NOT_FOUND),
        ("bases/1/image.png?width=0", "invalid-parameter", StatusCode::UNPROCESSABLE_ENTITY),
        ("bases/1/image.png?height=2049", "invalid-parameter", StatusCode::UNPROCESSABLE_ENTITY),
        ("bases/1/image.png?elevation=91", "invalid-parameter", StatusCode::UNPROCESSABLE_ENTITY),
        ("bases/1/image.png?azimut=3", "unknown-parameter", StatusCode::UNPROCESSABLE_ENTITY),
    ] {
        problem(service.get(&format!("/jobs/{id}/{path}")).await, status, kind).await;
    }
}

#[tokio::test]
async fn the_spectrum_is_plotted() {
    let service = Service::start().await;
    let id = service.succeed("bases=6", file(&sphere(300), Format::Ply)).await;
    let asked =
        service.client.get(service.url(&format!("/jobs/{id}/spectrum"))).header("accept", "image/svg+xml");
    let response = asked.send().await.unwrap();
    assert_eq!(response.headers()["content-type"], "image/svg+xml");
    let svg = response.text().await.unwrap();
    assert_eq!(svg.matches("<circle").count(), 6);
    assert!(svg.contains("6 eigenvalues, operator pb-mhb"));
    assert_eq!(service.get(&format!("/jobs/{id}/spectrum.svg")).await.text().await.unwrap(), svg);
}
