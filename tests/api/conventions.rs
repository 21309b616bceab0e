//! What HTTP promises: names of submissions, methods, origins, compression, events.

use std::time::{Duration, Instant};

use reqwest::header::HeaderMap;
use reqwest::{Method, Response, StatusCode};
use serde_json::Value;

use chladni::cloud::reader::Format;

use crate::service::{Service, detail, file, never_finishing, problem, sphere};

async fn named(service: &Service, path: &str, key: &str, body: Vec<u8>) -> Response {
    service.client.post(service.url(path)).header("idempotency-key", key).body(body).send().await.unwrap()
}

#[tokio::test]
async fn a_submission_that_is_sent_again_under_its_name_has_the_same_answer() {
    let service = Service::that_never_finishes().await;
    let cloud = file(&sphere(100), Format::Ply);
    let first = named(&service, "/clouds?bases=5", "a", cloud.clone()).await;
    assert_eq!(first.status(), StatusCode::ACCEPTED);
    assert!(!first.headers().contains_key("idempotency-replayed"));
    let location = first.headers()["location"].clone();
    let first: Value = first.json().await.unwrap();
    let again = named(&service, "/clouds?bases=5", "a", cloud.clone()).await;
    // Without the key this would be 200: the analysis is there already.
    assert_eq!(again.status(), StatusCode::ACCEPTED);
    assert_eq!(again.headers()["idempotency-replayed"], "true");
    assert_eq!(again.headers()["location"], location);
    let again: Value = again.json().await.unwrap();
    assert_eq!((&again["cloud"]["id"], &again["job"]["id"]), (&first["cloud"]["id"], &first["job"]["id"]));
    let service = service.restart().await;
    let after = named(&service, "/clouds?bases=5", "a", cloud).await;
    assert_eq!(after.headers()["idempotency-replayed"], "true", "names survive a restart");
}

#[tokio::test]
async fn a_name_that_was_given_to_another_submission_is_refused() {
    let service = Service::that_never_finishes().await;
    let cloud = file(&sphere(100), Format::Ply);
    let created: Value =
        named(&service, "/clouds?analyze=false", "a", cloud.clone()).await.json().await.unwrap();
    let jobs = format!("/clouds/{}/jobs", created["cloud"]["id"].as_str().unwrap());
    for (path, body) in [
        ("/clouds?bases=6", cloud.clone()),
        ("/clouds?analyze=false", file(&sphere(101), Format::Ply)),
        (jobs.as_str(), b"{}".to_vec()),
    ] {
        let refused =
            problem(named(&service, path, "a", body).await, StatusCode::UNPROCESSABLE_ENTITY, "key-reused")
                .await;
        assert!(detail(&refused).contains("give every submission a key of its own"), "{refused}");
    }
    assert_eq!(service.json("/jobs").await["jobs"], serde_json::json!([]), "nothing was submitted");
    let job = named(&service, &jobs, "b", b"{\"bases\": 4}".to_vec()).await;
    assert_eq!(job.status(), StatusCode::ACCEPTED);
    let again = named(&service, &jobs, "b", b"{\"bases\": 4}".to_vec()).await;
    assert_eq!(again.headers()["idempotency-replayed"], "true");
    let refused = named(&service, &jobs, &"k".repeat(256), Vec::new()).await;
    problem(refused, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
}

#[tokio::test]
async fn a_name_is_forgotten_with_the_cloud_that_it_stands_for() {
    let service = Service::start().await;
    let cloud = file(&sphere(100), Format::Ply);
    let created: Value =
        named(&service, "/clouds?analyze=false", "a", cloud.clone()).await.json().await.unwrap();
    let path = format!("/clouds/{}", created["cloud"]["id"].as_str().unwrap());
    assert_eq!(
        service.client.delete(service.url(&path)).send().await.unwrap().status(),
        StatusCode::NO_CONTENT
    );
    let again = named(&service, "/clouds?analyze=false", "a", cloud).await;
    assert_eq!(again.status(), StatusCode::CREATED);
    assert!(!again.headers().contains_key("idempotency-replayed"));
}

#[tokio::test]
async fn options_names_the_methods_of_a_resource() {
    let service = Service::start().await;
    let options = |path: &str| service.client.request(Method::OPTIONS, service.url(path)).send();
    let response = options("/clouds").await.unwrap();
    assert_eq!(response.status(), StatusCode::NO_CONTENT);
    let allow = response.headers()["allow"].to_str().unwrap().to_owned();
    for method in ["GET", "HEAD", "POST", "PUT"] {
        assert!(allow.contains(method), "{allow}");
    }
    assert!(!response.headers().contains_key("access-control-allow-origin"));
}

async fn from_page(service: &Service, method: Method, origin: &str) -> HeaderMap {
    let request = service.client.request(method, service.url("/clouds")).header("origin", origin);
    let request = request.header("access-control-request-method", "PUT");
    request.header("access-control-request-headers", "authorization").send().await.unwrap().headers().clone()
}

#[tokio::test]
async fn pages_of_other_origins_are_let_in_only_by_a_setting() {
    const VIEWER: &str = "https://viewer.example";
    let closed = Service::start().await;
    for method in [Method::GET, Method::OPTIONS] {
        assert!(!from_page(&closed, method, VIEWER).await.contains_key("access-control-allow-origin"));
    }
    let open = Service::with_settings(|settings| settings.cors_origins = vec![VIEWER.parse().unwrap()]).await;
    let preflight = from_page(&open, Method::OPTIONS, VIEWER).await;
    assert_eq!(preflight["access-control-allow-origin"], VIEWER);
    assert!(preflight["access-control-allow-methods"].to_str().unwrap().contains("PUT"));
    assert_eq!(preflight["access-control-allow-headers"], "authorization");
    let answer = from_page(&open, Method::GET, VIEWER).await;
    assert!(answer["access-control-expose-headers"].to_str().unwrap().contains("etag"));
    assert!(
        !from_page(&open, Method::GET, "https://other.example")
            .await
            .contains_key("access-control-allow-origin")
    );
}

async fn accepting(service: &Service, path: &str, encoding: &str, range: Option<&str>) -> Response {
    let mut request = service.client.get(service.url(path)).header("accept-encoding", encoding);
    if let Some(range) = range {
        request = request.header("range", range);
    }
    request.send().await.unwrap()
}

#[tokio::test]
async fn text_is_compressed_for_who_accepts_it_and_arrays_never() {
    let service = Service::start().await;
    let id = service.succeed("bases=6", file(&sphere(200), Format::Ply)).await;
    let json = format!("/jobs/{id}/bases");
    let plain = service.get(&json).await;
    let (tag, plain) = (plain.headers()["etag"].clone(), plain.bytes().await.unwrap());
    for encoding in ["gzip", "zstd"] {
        let response = accepting(&service, &json, encoding, None).await;
        assert_eq!(response.headers()["content-encoding"], encoding);
        assert!(response.headers()["vary"].to_str().unwrap().contains("accept"));
        let weak = response.headers()["etag"].to_str().unwrap().to_owned();
        assert_eq!(weak, format!("W/{}", tag.to_str().unwrap()), "a strong tag names other bytes");
        let magic: &[u8] = if encoding == "gzip" { &[0x1F, 0x8B] } else { &[0x28, 0xB5, 0x2F, 0xFD] };
        let bytes = response.bytes().await.unwrap();
        assert!(bytes.starts_with(magic) && bytes.len() < plain.len() * 2 / 3, "{encoding}: {}", bytes.len());
        let known = service.client.get(service.url(&json)).header("if-none-match", weak);
        assert_eq!(known.send().await.unwrap().status(), StatusCode::NOT_MODIFIED);
    }
    for path in [
        format!("{json}.npy"),
        format!("{json}.ply"),
        format!("/jobs/{id}/bases/1/image.png?width=60&height=60"),
    ] {
        let response = accepting(&service, &path, "gzip, zstd", None).await;
        assert!(!response.headers().contains_key("content-encoding"), "{path}");
        assert_eq!(response.headers()["accept-ranges"], "bytes");
    }
    let csv = format!("/jobs/{id}/spectrum.csv");
    let part = accepting(&service, &csv, "gzip", Some("bytes=0-4")).await;
    assert_eq!(part.status(), StatusCode::PARTIAL_CONTENT);
    assert_eq!(part.text().await.unwrap(), "index");
}

/// The events of a stream: their names, ids and data.
fn events(text: &str) -> Vec<(String, String, Value)> {
    let field = |event: &str, name: &str| {
        let line = event.lines().find_map(|line| line.strip_prefix(&format!("{name}: ")));
        line.unwrap_or_default().to_owned()
    };
    let blocks = text.split("\n\n").filter(|event| event.contains("data: "));
    blocks
        .map(|event| {
            let data = serde_json::from_str(&field(event, "data")).unwrap();
            (field(event, "event"), field(event, "id"), data)
        })
        .collect()
}

#[tokio::test]
async fn events_tell_of_a_job_up_to_its_end() {
    let service = Service::start().await;
    let submission = service.accept("bases=6", file(&sphere(300), Format::Ply)).await;
    let path = format!("/jobs/{}/events", submission["job"]["id"].as_str().unwrap());
    let response = service.get(&path).await;
    assert_eq!(response.headers()["content-type"], "text/event-stream");
    let told = events(&response.text().await.unwrap());
    let (name, last, job) = told.last().unwrap();
    assert_eq!((name.as_str(), &job["state"]), ("succeeded", &"succeeded".into()));
    assert!(told[..told.len() - 1].iter().all(|(name, ..)| name == "progress"));
    let progress: Vec<f64> = told.iter().map(|(.., job)| job["progress"].as_f64().unwrap()).collect();
    assert!(progress.windows(2).all(|pair| pair[0] <= pair[1]), "{progress:?}");
    let ids: std::collections::BTreeSet<_> = told.iter().map(|(_, id, _)| id).collect();
    assert_eq!(ids.len(), told.len(), "every event has an id of its own");

    let again = events(&service.get(&path).await.text().await.unwrap());
    assert_eq!(again.len(), 1, "who comes late is told the end");
    let knowing = service.client.get(service.url(&path)).header("last-event-id", last);
    assert_eq!(knowing.send().await.unwrap().status(), StatusCode::NO_CONTENT);
    problem(
        service.get("/jobs/01a202a4-2e49-7277-b7ed-c196eeb908c1/events").await,
        StatusCode::NOT_FOUND,
        "not-found",
    )
    .await;
}

#[tokio::test]
async fn streams_and_waits_of_one_client_leave_places_to_others() {
    let service = Service::start_with(|settings| settings.connections_max = 6, never_finishing()).await;
    let submission = service.accept("bases=2", file(&sphere(60), Format::Ply)).await;
    let id = submission["job"]["id"].as_str().unwrap();
    let path = format!("/jobs/{id}/events");
    let mut held = Vec::new();
    for _ in 0..3 {
        held.push(service.get(&path).await);
    }
    let begun = Instant::now();
    // Beyond half of the connections a stream ends after what there is to tell, and nobody waits.
    assert_eq!(events(&service.get(&path).await.text().await.unwrap()).len(), 1);
    let asked = service.json(&format!("/jobs/{id}?wait=60")).await;
    assert!(begun.elapsed() < Duration::from_secs(20), "{asked}");
    drop(held);
}

#[tokio::test]
async fn a_stream_of_events_ends_with_the_job_or_the_service() {
    let service = Service::start_with(|settings| settings.grace_seconds = 10, never_finishing()).await;
    let submission = service.accept("bases=6", file(&sphere(100), Format::Ply)).await;
    let id = submission["job"]["id"].as_str().unwrap().to_owned();
    service.running(&id).await;
    let stream = service.get(&format!("/jobs/{id}/events")).await;
    service.post(&format!("/jobs/{id}/cancel"), "").await;
    let told = events(&stream.text().await.unwrap());
    assert_eq!(told.last().unwrap().0, "canceled");

    let submission = service.accept("bases=7", file(&sphere(100), Format::Ply)).await;
    let id = submission["job"]["id"].as_str().unwrap().to_owned();
    let stream = service.get(&format!("/jobs/{id}/events")).await;
    service.app.shutdown().await;
    assert!(!events(&stream.text().await.unwrap()).is_empty(), "the stream ends in order");
}
