//! Listings of clouds and jobs.

use chladni::cloud::reader::Format;
use reqwest::StatusCode;
use serde_json::Value;

use crate::service::{Service, file, problem, sphere};

async fn pages(service: &Service, path: &str, list: &str) -> Vec<Vec<Value>> {
    let mut pages = Vec::new();
    let mut cursor = String::new();
    loop {
        let page = service.json(&format!("{path}{cursor}")).await;
        pages.push(page[list].as_array().unwrap().iter().map(|item| item["id"].clone()).collect());
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return pages,
        }
    }
}

#[tokio::test]
async fn clouds_come_newest_first_in_pages() {
    let service = Service::start().await;
    let mut ids = Vec::new();
    for points in [50, 51, 52, 53, 54] {
        let response = service.post("/clouds?analyze=false", file(&sphere(points), Format::Ply)).await;
        ids.push(response.json::<Value>().await.unwrap()["cloud"]["id"].clone());
    }
    ids.reverse();
    let pages = pages(&service, "/clouds?limit=2", "clouds").await;
    assert_eq!(pages.iter().map(Vec::len).collect::<Vec<_>>(), [2, 2, 1]);
    assert_eq!(pages.concat(), ids);
}

#[tokio::test]
async fn jobs_are_listed_by_state_and_cloud() {
    let service = Service::that_never_finishes().await;
    let first = service.accept("bases=5", file(&sphere(100), Format::Ply)).await;
    service.running(first["job"]["id"].as_str().unwrap()).await;
    let second = service.accept("bases=5", file(&sphere(101), Format::Ply)).await;
    let listed =
        async |query: &str| pages(&service, &format!("/jobs?limit=10{query}"), "jobs").await.concat();
    let (first_id, second_id) = (first["job"]["id"].clone(), second["job"]["id"].clone());
    assert_eq!(listed("").await, [second_id.clone(), first_id.clone()]);
    assert_eq!(listed("&state=running").await, std::slice::from_ref(&first_id));
    assert_eq!(listed("&state=queued").await, [second_id]);
    assert_eq!(listed("&state=failed").await, Vec::<Value>::new());
    let cloud = first["cloud"]["id"].as_str().unwrap();
    assert_eq!(listed(&format!("&cloud={cloud}")).await, [first_id]);
}

#[tokio::test]
async fn pages_and_cursors_out_of_range_are_refused() {
    let service = Service::start().await;
    for path in
        ["/clouds?limit=0", "/clouds?limit=201", "/jobs?cursor=x", "/jobs?state=done", "/jobs?cloud=1"]
    {
        problem(service.get(path).await, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
    }
    problem(service.get("/jobs?stat=queued").await, StatusCode::UNPROCESSABLE_ENTITY, "unknown-parameter")
        .await;
}
