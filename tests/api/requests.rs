//! What holds for every request: ids, problems, methods, keys.

use std::io::{Read, Write};
use std::net::TcpStream;

use chladni::app::{App, Settings, StartError};
use reqwest::{Method, StatusCode};

use crate::service::{Service, detail, problem};

#[tokio::test]
async fn every_answer_carries_an_id_and_a_sane_one_of_the_client_is_kept() {
    let service = Service::start().await;
    let own = service.get("/livez").await.headers()["x-request-id"].to_str().unwrap().to_owned();
    assert_eq!(uuid::Uuid::parse_str(&own).unwrap().get_version_num(), 7);
    let send = async |id: &str| {
        let request = service.client.get(service.url("/livez")).header("x-request-id", id);
        request.send().await.unwrap().headers()["x-request-id"].to_str().unwrap().to_owned()
    };
    assert_eq!(send("scan-7").await, "scan-7");
    assert_ne!(send("two words").await, "two words");
}

#[tokio::test]
async fn unknown_paths_and_ids_are_not_found() {
    let service = Service::start().await;
    let unknown = uuid::Uuid::now_v7();
    for path in [
        "/nothing".to_owned(),
        "/clouds/not-an-id".to_owned(),
        format!("/clouds/{unknown}"),
        format!("/clouds/{unknown}/points"),
        format!("/jobs/{unknown}"),
        format!("/jobs/{unknown}/bases"),
        format!("/jobs/{unknown}/spectrum"),
        format!("/jobs/{unknown}/operator"),
        format!("/jobs/{unknown}/bases.npy"),
        format!("/jobs/{unknown}/bases.exe"),
        "/jobs/17".to_owned(),
    ] {
        let refused = problem(service.get(&path).await, StatusCode::NOT_FOUND, "not-found").await;
        assert_eq!(refused["instance"], path);
    }
    let refused = problem(service.get("/clouds/not-an-id").await, StatusCode::NOT_FOUND, "not-found").await;
    assert!(detail(&refused).contains("not-an-id"));
}

#[tokio::test]
async fn paths_of_other_services_are_answered_with_those_of_this_one() {
    let service = Service::start().await;
    for (path, meant) in [
        ("/healthz", "/livez"),
        ("/health", "/readyz"),
        ("/ready", "/readyz"),
        ("/api", "/docs"),
        ("/api/v1/clouds", "/clouds"),
        ("/v1/jobs", "/jobs"),
        ("/openapi", "/openapi.json"),
        ("/swagger", "/docs"),
    ] {
        let refused = problem(service.get(path).await, StatusCode::NOT_FOUND, "not-found").await;
        assert!(detail(&refused).contains(&format!(" {meant}")), "{path}: {refused}");
        for near in refused["near"].as_array().unwrap() {
            assert_eq!(service.get(near.as_str().unwrap()).await.status(), StatusCode::OK, "{path}: {near}");
        }
    }
}

#[tokio::test]
async fn a_wrong_method_is_refused_with_those_that_are_allowed() {
    let service = Service::start().await;
    for (method, path, allowed) in [
        (Method::DELETE, "/clouds", "POST"),
        (Method::PATCH, "/jobs", "GET"),
        (Method::POST, "/capabilities", "GET"),
    ] {
        let response = service.client.request(method, service.url(path)).send().await.unwrap();
        assert!(response.headers()["allow"].to_str().unwrap().contains(allowed), "{path}");
        problem(response, StatusCode::METHOD_NOT_ALLOWED, "method-not-allowed").await;
    }
    let slash =
        problem(service.get("/clouds/").await, StatusCode::METHOD_NOT_ALLOWED, "method-not-allowed").await;
    assert!(detail(&slash).ends_with("did you mean /clouds?"), "{slash}");
    let file = service.client.put(service.url("/viewer/a/b")).send().await.unwrap();
    let file = problem(file, StatusCode::METHOD_NOT_ALLOWED, "method-not-allowed").await;
    assert!(detail(&file).ends_with("supported: GET, HEAD"), "{file}");
    let capitals = problem(service.get("/JOBS").await, StatusCode::NOT_FOUND, "not-found").await;
    assert!(detail(&capitals).ends_with("did you mean /jobs?"), "{capitals}");
}

#[tokio::test]
async fn the_service_tells_what_it_is_and_can_do() {
    let service = Service::with_settings(|settings| settings.bases_max = 77).await;
    assert_eq!(service.json("/").await["service"], "chladni");
    assert_eq!(service.json("/livez").await["status"], "ok");
    assert_eq!(service.json("/readyz").await["status"], "ok");
    let capabilities = service.json("/capabilities").await;
    assert_eq!(capabilities["limits"]["bases_max"], 77);
    assert!(capabilities["operators"].as_array().unwrap().contains(&"pb-mhb".into()));
    let parameters = capabilities["parameters"].as_array().unwrap();
    let bases = parameters.iter().find(|parameter| parameter["name"] == "bases").unwrap();
    assert_eq!(bases["schema"]["maximum"], 77);
    assert_eq!(bases["default"], "100");
}

#[tokio::test]
async fn every_path_of_the_index_answers() {
    let service = Service::start().await;
    let index = service.json("/").await;
    for path in index["links"].as_object().unwrap().values() {
        assert_eq!(service.get(path.as_str().unwrap()).await.status(), StatusCode::OK, "{path}");
    }
}

#[tokio::test]
async fn an_address_open_to_others_is_refused_without_keys() {
    let directory = tempfile::tempdir().unwrap();
    let settings = Settings {
        listen: "0.0.0.0:0".parse().unwrap(),
        database: directory.path().join("test.db").into(),
        ..Settings::default()
    };
    let refused = App::start(settings.clone()).await.err().unwrap();
    assert!(matches!(refused, StartError::Public(_)), "{refused}");
    let app = App::start(Settings { allow_public: true, ..settings }).await.unwrap();
    app.shutdown().await;
}

#[tokio::test]
async fn a_client_that_never_ends_its_head_is_closed() {
    let service = Service::with_settings(|settings| settings.header_seconds = 1).await;
    let address = service.app.address();
    let ended = tokio::task::spawn_blocking(move || {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(b"GET /livez HTTP/1.1\r\nHost: localhost\r\n").unwrap();
        let mut rest = Vec::new();
        stream.read_to_end(&mut rest).is_ok()
    });
    assert_eq!(service.get("/livez").await.status(), StatusCode::OK);
    assert!(ended.await.unwrap());
}

#[tokio::test]
async fn clients_that_say_nothing_before_or_after_a_request_are_closed_while_others_are_served() {
    let service = Service::with_settings(|settings| settings.header_seconds = 1).await;
    let address = service.app.address();
    let idle = ["", "GET /livez HTTP/1.1\r\nHost: localhost\r\n\r\n"].map(|said| {
        tokio::task::spawn_blocking(move || {
            let mut stream = TcpStream::connect(address).unwrap();
            stream.write_all(said.as_bytes()).unwrap();
            let mut heard = Vec::new();
            stream.read_to_end(&mut heard).unwrap();
            assert_eq!(heard.starts_with(b"HTTP/1.1 200 OK"), !said.is_empty());
        })
    });
    assert_eq!(service.get("/livez").await.status(), StatusCode::OK);
    for client in idle {
        client.await.unwrap();
    }
}

#[tokio::test]
async fn the_type_of_a_problem_leads_somewhere() {
    let service = Service::start().await;
    let refused = problem(service.get("/nothing").await, StatusCode::NOT_FOUND, "not-found").await;
    let kind = service.json(refused["type"].as_str().unwrap()).await;
    assert_eq!((&kind["type"], &kind["title"]), (&refused["type"], &refused["title"]));
    problem(service.get("/problems/none").await, StatusCode::NOT_FOUND, "not-found").await;
}
