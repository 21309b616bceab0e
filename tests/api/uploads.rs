//! Sending clouds, and getting them back.

use std::time::Instant;

use chladni::cloud::reader::{self, Format, ReadOptions};
use reqwest::multipart::{Form, Part};
use reqwest::{Method, StatusCode};
use serde_json::Value;

use crate::service::{Service, file, problem, sphere};

#[tokio::test]
async fn every_format_is_told_from_its_bytes() {
    let service = Service::start().await;
    for format in Format::WRITTEN {
        // STL holds triangles and nothing else.
        let triangles = (0..20).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let cloud = sphere(60).with_faces(triangles).unwrap();
        let response = service.post("/clouds?analyze=false", file(&cloud, format)).await;
        assert!(response.status().is_success(), "{format}: {}", response.text().await.unwrap());
        let body: Value = response.json().await.unwrap();
        assert_eq!(body["cloud"]["points"], 60, "{format}");
        assert!(body["job"].is_null());
    }
}

#[tokio::test]
async fn curl_t_is_answered_with_202_and_the_job() {
    let service = Service::that_never_finishes().await;
    let url = service.url("/clouds?bases=5");
    let response = service.client.put(url).body(file(&sphere(100), Format::Ply)).send().await.unwrap();
    assert_eq!(response.status(), StatusCode::ACCEPTED);
    let location = response.headers()["location"].to_str().unwrap().to_owned();
    assert!(response.headers().contains_key("retry-after"));
    let body: Value = response.json().await.unwrap();
    assert_eq!(location, format!("/jobs/{}", body["job"]["id"].as_str().unwrap()));
    assert_eq!(body["links"]["job"], location);
    assert_eq!(body["job"]["cloud_id"], body["cloud"]["id"]);
    assert_eq!(body["job"]["parameters"]["bases"], 5);
    assert_eq!(service.json(&location).await["id"], body["job"]["id"]);
}

#[tokio::test]
async fn curl_t_to_the_folder_appends_a_name_that_tells_the_format() {
    let service = Service::start().await;
    for path in ["/clouds/scan.xyz?analyze=false", "/clouds/?analyze=false"] {
        let request = service.client.request(Method::PUT, service.url(path));
        let response = request.body(file(&sphere(50), Format::Xyz)).send().await.unwrap();
        assert!(response.status().is_success(), "{path}: {}", response.text().await.unwrap());
    }
}

#[tokio::test]
async fn a_browser_form_is_taken_by_its_first_file_part() {
    let service = Service::start().await;
    let part = Part::bytes(file(&sphere(50), Format::Csv)).file_name("scan.csv");
    let form = Form::new().text("comment", "hello").part("file", part);
    let response =
        service.client.post(service.url("/clouds?analyze=false")).multipart(form).send().await.unwrap();
    assert_eq!(response.status(), StatusCode::CREATED);
    let location = response.headers()["location"].to_str().unwrap().to_owned();
    assert_eq!(service.json(&location).await["points"], 50);
}

/// `CHLADNI_MULTIPART_UPLOADS=5000` is the measured run.
#[tokio::test(flavor = "multi_thread")]
async fn every_form_arrives_whole() {
    let uploads: usize =
        std::env::var("CHLADNI_MULTIPART_UPLOADS").map_or(400, |uploads| uploads.parse().unwrap());
    let service = Service::start().await;
    let (client, url) = (service.client.clone(), service.url("/clouds?analyze=false"));
    let clients = (0..8).map(|number| {
        let (client, url) = (client.clone(), url.clone());
        tokio::spawn(async move {
            for turn in (number..uploads).step_by(8) {
                let lines = format!("{turn} 1 2\n").repeat(1 + turn * 37 % 5000);
                let form = Form::new().part("file", Part::bytes(lines.into_bytes()).file_name("scan.xyz"));
                let answer = client.post(&url).multipart(form).send().await.unwrap();
                assert_eq!(answer.status(), StatusCode::CREATED, "{turn}: {}", answer.text().await.unwrap());
            }
        })
    });
    for client in clients.collect::<Vec<_>>() {
        client.await.unwrap();
    }
    println!("{uploads} of {uploads} multipart uploads arrived");
}

#[tokio::test(flavor = "multi_thread")]
async fn nobody_waits_for_answers_whose_clients_have_left() {
    const CLIENTS: u32 = 40;
    let service = Service::with_settings(|settings| settings.threads = 1).await;
    let id = service.succeed("kind=operator", file(&sphere(10_000), Format::Npy)).await;
    let path = format!("/jobs/{id}/operator.mtx");
    let asked = async |path: &str| {
        let began = Instant::now();
        let answer = service.get(path).await;
        assert_eq!(answer.status(), StatusCode::OK);
        answer.bytes().await.unwrap();
        began.elapsed()
    };
    let alone = asked(&path).await;
    let left = (0..CLIENTS).map(|_| service.client.get(service.url(&path)).timeout(alone / 4).send());
    let left = futures_util::future::join_all(left).await;
    assert!(left.iter().filter(|answer| answer.is_err()).count() > CLIENTS as usize / 2, "they leave early");
    let began = Instant::now();
    let upload = service.post("/clouds?analyze=false&format=xyz", b"1 2 3\n4 5 6\n".to_vec()).await;
    assert_eq!(upload.status(), StatusCode::CREATED);
    let (upload, after) = (began.elapsed(), asked(&path).await);
    println!("alone {alone:?}; after {CLIENTS} clients left: upload {upload:?}, the same answer {after:?}");
    assert!(after < alone * CLIENTS / 3 && upload < alone * CLIENTS / 3);
}

#[tokio::test]
async fn a_format_that_is_named_or_declared_is_used() {
    let service = Service::start().await;
    let cloud = file(&sphere(40), Format::Xyz);
    let named = service.post("/clouds?analyze=false&format=xyz", cloud.clone()).await;
    assert!(named.status().is_success());
    let request = service.client.post(service.url("/clouds?analyze=false")).body(cloud);
    let contradicted = request.header("content-type", "application/x-ply").send().await.unwrap();
    assert_eq!(contradicted.status(), StatusCode::BAD_REQUEST);
}

#[tokio::test]
async fn the_same_content_is_stored_once_whatever_its_format() {
    let service = Service::start().await;
    let mut ids = Vec::new();
    for (format, status) in [(Format::Npy, StatusCode::CREATED), (Format::Npy, StatusCode::OK)] {
        let response = service.post("/clouds?analyze=false", file(&sphere(40), format)).await;
        assert_eq!(response.status(), status);
        ids.push(response.json::<Value>().await.unwrap()["cloud"]["id"].clone());
    }
    assert_eq!(ids[0], ids[1]);
}

#[tokio::test]
async fn the_same_analysis_is_answered_with_the_job_that_is_there() {
    let service = Service::that_never_finishes().await;
    let cloud = file(&sphere(100), Format::Ply);
    let first = service.accept("bases=5", cloud.clone()).await;
    let again = service.post("/clouds?bases=5", cloud.clone()).await;
    assert_eq!(again.status(), StatusCode::OK);
    assert_eq!(again.json::<Value>().await.unwrap()["job"]["id"], first["job"]["id"]);
    let other = service.accept("bases=6", cloud).await;
    assert_ne!(other["job"]["id"], first["job"]["id"]);
}

#[tokio::test]
async fn a_cloud_comes_back_as_it_was_sent() {
    let service = Service::start().await;
    let text =
        b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                 property uchar red\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
                 0 0 0 10\n1 0 0 20\n0 1 0 30\n0 0 1 40\n3 0 1 2\n";
    let created: Value = service.post("/clouds?analyze=false", text.to_vec()).await.json().await.unwrap();
    let path = created["links"]["points"].as_str().unwrap();
    let sent = reader::read(text, Format::Ply, &ReadOptions::default()).unwrap();
    let ply = service.get(path).await.bytes().await.unwrap();
    assert_eq!(reader::read(&ply, Format::Ply, &ReadOptions::default()).unwrap(), sent);
    let npy = service.get(&format!("{path}?format=npy")).await.bytes().await.unwrap();
    let npy = reader::read(&npy, Format::Npy, &ReadOptions::default()).unwrap();
    assert_eq!(npy.coordinates(), sent.coordinates());
    let json = service.json(&format!("{path}?format=json")).await;
    assert_eq!(json["coordinates"][1], serde_json::json!([1.0, 0.0, 0.0]));
    assert_eq!(json["dimension"], 3);
}

#[tokio::test]
async fn the_longest_ply_is_streamed_whole_and_in_parts() {
    let service = Service::start().await;
    let cloud = sphere(20_000);
    let created: Value =
        service.post("/clouds?analyze=false", file(&cloud, Format::Npy)).await.json().await.unwrap();
    let path = created["links"]["points"].as_str().unwrap();
    let whole = service.get(path).await.bytes().await.unwrap();
    assert_eq!(
        reader::read(&whole, Format::Ply, &ReadOptions::default()).unwrap().coordinates(),
        cloud.coordinates()
    );
    let mut parts = Vec::new();
    while parts.len() < whole.len() {
        let range = format!("bytes={}-{}", parts.len(), parts.len() + 99_999);
        let part = service.client.get(service.url(path)).header("range", range).send().await.unwrap();
        assert_eq!(part.status(), StatusCode::PARTIAL_CONTENT);
        parts.extend(part.bytes().await.unwrap());
    }
    assert_eq!(parts, whole);
}

#[tokio::test]
async fn a_cloud_is_called_like_its_file() {
    let service = Service::start().await;
    let put = async |path: &str, points: usize| {
        let request = service.client.put(service.url(path)).body(file(&sphere(points), Format::Ply));
        request.send().await.unwrap().json::<Value>().await.unwrap()
    };
    assert_eq!(put("/clouds/statue.ply?analyze=false", 50).await["cloud"]["name"], "statue.ply");
    assert_eq!(put("/clouds/a%2Fb.ply?analyze=false&name=the%20bust", 60).await["cloud"]["name"], "the bust");
    assert_eq!(put("/clouds?analyze=false", 70).await["cloud"]["name"], Value::Null);
    let part = reqwest::multipart::Part::bytes(file(&sphere(80), Format::Ply)).file_name("folder/head.ply");
    let form = reqwest::multipart::Form::new().part("file", part);
    let sent = service.client.post(service.url("/clouds?bases=3")).multipart(form).send().await.unwrap();
    let sent: Value = sent.json().await.unwrap();
    assert_eq!(
        (&sent["cloud"]["name"], &sent["job"]["cloud_name"]),
        (&"head.ply".into(), &"head.ply".into())
    );
    // The same content keeps its name; content without one takes the next.
    assert_eq!(put("/clouds/other.ply?analyze=false", 50).await["cloud"]["name"], "statue.ply");
    assert_eq!(put("/clouds/late.ply?analyze=false", 70).await["cloud"]["name"], "late.ply");
    let listed = service.json("/clouds").await;
    let names: Vec<_> = listed["clouds"].as_array().unwrap().iter().map(|cloud| &cloud["name"]).collect();
    assert_eq!(names, ["head.ply", "late.ply", "the bust", "statue.ply"]);
    assert_eq!(service.json("/jobs").await["jobs"][0]["cloud_name"], "head.ply");
    let refused = service.post("/clouds?name=a%0ab", file(&sphere(90), Format::Ply)).await;
    problem(refused, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
}
