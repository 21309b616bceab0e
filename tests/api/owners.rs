//! Two keys, and what each may see: every endpoint of the interface's own description is tried.

use chladni::app::Settings;
use chladni::cloud::reader::Format;
use reqwest::{Method, Response, StatusCode};
use serde_json::Value;

use crate::service::{Service, file, problem, sphere};

/// What an endpoint's path may name.
struct Own {
    cloud: String,
    eigen: String,
    operator: String,
}

/// A cloud that every format holds: STL has triangles alone.
fn cloud() -> Vec<u8> {
    let triangles = (0..30).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    file(&sphere(100).with_faces(triangles).unwrap(), Format::Ply)
}

struct Keyed(Service);

impl Keyed {
    async fn start() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let list = directory.path().join("keys");
        std::fs::write(&list, "# pipeline\nalpha-key\n").unwrap();
        let keys = |settings: &mut Settings| {
            settings.api_keys = Some(list);
            settings.keys = Some("lab beta-key, lab gamma-key".parse().unwrap());
        };
        Self(Service::with_settings(keys).await)
    }

    async fn send(&self, key: &str, method: Method, path: &str, body: Vec<u8>) -> Response {
        let request = self.0.client.request(method, self.0.url(path)).body(body);
        if key.is_empty() { request } else { request.bearer_auth(key) }.send().await.unwrap()
    }

    async fn json(&self, key: &str, path: &str) -> Value {
        let response = self.send(key, Method::GET, path, Vec::new()).await;
        assert_eq!(response.status(), StatusCode::OK, "{path}");
        response.json().await.unwrap()
    }

    async fn submit(&self, key: &str, query: &str) -> (StatusCode, Value) {
        let response = self.send(key, Method::POST, &format!("/clouds?{query}"), cloud()).await;
        (response.status(), response.json().await.unwrap())
    }

    /// A cloud with a finished job of either kind.
    async fn own(&self, key: &str) -> Own {
        let mut jobs = Vec::new();
        let mut cloud = String::new();
        for query in ["bases=4&operator=voronoi", "kind=operator&operator=voronoi"] {
            let (status, submitted) = self.submit(key, query).await;
            assert_eq!(status, StatusCode::ACCEPTED, "{submitted}");
            submitted["cloud"]["id"].as_str().unwrap().clone_into(&mut cloud);
            let job = submitted["job"]["id"].as_str().unwrap().to_owned();
            while self.json(key, &format!("/jobs/{job}?wait=60")).await["state"] != "succeeded" {}
            jobs.push(job);
        }
        let operator = jobs.pop().unwrap();
        Own { cloud, eigen: jobs.pop().unwrap(), operator }
    }
}

/// Every method and path of the description, with the path's parameters filled in.
fn requests(own: &Own, other: &str) -> Vec<(Method, String, String)> {
    let document = serde_json::to_value(chladni::http::document()).unwrap();
    let mut requests = Vec::new();
    for (path, item) in document["paths"].as_object().unwrap() {
        for method in item.as_object().unwrap().keys() {
            let Ok(method) = method.to_uppercase().parse::<Method>() else { continue };
            let id = match path.as_str() {
                path if path.starts_with("/clouds/") => &own.cloud,
                "/jobs/{id}/laplacian" => &own.operator,
                path if path.starts_with("/jobs/{id}/operator.") => &own.operator,
                _ => &own.eigen,
            };
            let filled = path
                .replace("{id}", id)
                .replace("{other}", other)
                .replace("{basis}", "1")
                .replace("{file}", "spectrum.json")
                .replace("/problems/{name}", "/problems/not-found");
            assert!(!filled.contains('{'), "{path}: say here what its parameters stand for");
            // Stored only: a job would keep the cloud from being deleted at the end.
            let uploads = path == "/clouds" && method != Method::GET || method == Method::PUT;
            let filled = if uploads { format!("{filled}?analyze=false") } else { filled };
            requests.push((method, path.clone(), filled));
        }
    }
    // What deletes comes last.
    requests.sort_by_key(|(method, path, _)| (*method == Method::DELETE, path.len()));
    requests
}

fn body_for(method: &Method, path: &str) -> Vec<u8> {
    let ones = serde_json::to_vec(&vec![1.0; 100]).unwrap();
    match (method, path) {
        (&Method::POST, "/clouds") | (&Method::PUT, _) => cloud(),
        (&Method::POST, "/clouds/{id}/jobs") => b"{\"bases\": 4, \"operator\": \"voronoi\"}".to_vec(),
        (&Method::POST, "/jobs/{id}/filtered" | "/jobs/{id}/synthesis") => b"[1, 1, 1, 1]".to_vec(),
        (&Method::POST, _) => ones,
        _ => Vec::new(),
    }
}

#[tokio::test]
async fn every_endpoint_asks_for_a_key_and_gives_only_what_is_the_keys_own() {
    let service = Keyed::start().await;
    let (alpha, beta) = (service.own("alpha-key").await, service.own("beta-key").await);
    assert_ne!(alpha.cloud, beta.cloud, "the same content, but two clouds");

    let names_something = |method: &Method, path: &str| {
        path.contains("{id}") && !(*method == Method::PUT && path == "/clouds/{id}")
    };
    for (method, path, filled) in requests(&alpha, &alpha.eigen) {
        let body = body_for(&method, &path);
        let without = service.send("", method.clone(), &filled, body.clone()).await;
        let is_page = ["/livez", "/readyz", "/", "/docs", "/capabilities"].contains(&path.as_str())
            || path.starts_with("/openapi.")
            || path.starts_with("/problems/");
        if is_page {
            assert!(without.status().is_success(), "{path}");
        } else {
            problem(without, StatusCode::UNAUTHORIZED, "unauthorized").await;
        }
        problem(
            service.send("delta-key", method.clone(), "/clouds", body.clone()).await,
            StatusCode::UNAUTHORIZED,
            "unauthorized",
        )
        .await;
        if names_something(&method, &path) {
            for query in ["", "?no_such_parameter=1", "?wait=0"] {
                let foreign =
                    service.send("beta-key", method.clone(), &format!("{filled}{query}"), body.clone()).await;
                let foreign = problem(foreign, StatusCode::NOT_FOUND, "not-found").await;
                // As for an id that is nobody's.
                let nobodys = filled.replace(&alpha.cloud, &uuid::Uuid::now_v7().to_string());
                let nobodys = nobodys.replace(&alpha.eigen, &uuid::Uuid::now_v7().to_string());
                let nobodys = nobodys.replace(&alpha.operator, &uuid::Uuid::now_v7().to_string());
                let missing = service
                    .send("beta-key", method.clone(), &format!("{nobodys}{query}"), body.clone())
                    .await;
                let missing = problem(missing, StatusCode::NOT_FOUND, "not-found").await;
                assert_eq!(foreign["detail"], missing["detail"], "{method} {path}{query}");
            }
        }
    }
    // Nothing of that did anything to what is alpha's: it can still do everything with it.
    for (method, path, filled) in requests(&alpha, &alpha.eigen) {
        let own = service.send("alpha-key", method.clone(), &filled, body_for(&method, &path)).await;
        assert!(own.status().is_success(), "{method} {path}: {}", own.text().await.unwrap());
    }
    let similarity = format!("/jobs/{}/similarity/{}", beta.eigen, alpha.eigen);
    let foreign = service.send("beta-key", Method::GET, &similarity, Vec::new()).await;
    problem(foreign, StatusCode::NOT_FOUND, "not-found").await;
}

#[tokio::test]
async fn listings_and_submissions_tell_nothing_of_other_keys() {
    let service = Keyed::start().await;
    let (first, alpha) = service.submit("alpha-key", "analyze=false").await;
    let (second, beta) = service.submit("beta-key", "analyze=false").await;
    assert_eq!(
        (first, second),
        (StatusCode::CREATED, StatusCode::CREATED),
        "the second learns nothing of the first"
    );
    assert_eq!(alpha["cloud"]["digest"], beta["cloud"]["digest"]);
    for (key, own) in [("alpha-key", &alpha), ("beta-key", &beta)] {
        let clouds = service.json(key, "/clouds").await;
        let ids: Vec<_> = clouds["clouds"].as_array().unwrap().iter().map(|cloud| &cloud["id"]).collect();
        assert_eq!(ids, [&own["cloud"]["id"]]);
        let (status, again) = service.submit(key, "analyze=false").await;
        assert_eq!((status, &again["cloud"]["id"]), (StatusCode::OK, &own["cloud"]["id"]));
    }
    let (_, job) = service.submit("alpha-key", "bases=3").await;
    for path in ["/jobs".to_owned(), format!("/jobs?cloud={}", job["cloud"]["id"].as_str().unwrap())] {
        assert_eq!(service.json("alpha-key", &path).await["jobs"].as_array().unwrap().len(), 1);
        assert!(service.json("beta-key", &path).await["jobs"].as_array().unwrap().is_empty());
    }
}

#[tokio::test]
async fn keys_of_one_name_share_what_they_have() {
    let service = Keyed::start().await;
    let (_, stored) = service.submit("beta-key", "analyze=false").await;
    let path = format!("/clouds/{}", stored["cloud"]["id"].as_str().unwrap());
    assert_eq!(service.json("gamma-key", &path).await["id"], stored["cloud"]["id"]);
    let (status, _) = service.submit("gamma-key", "analyze=false").await;
    assert_eq!(status, StatusCode::OK);
}

#[tokio::test]
async fn what_was_stored_without_keys_is_out_of_reach_of_every_key() {
    let service = Service::start().await;
    let cloud = file(&sphere(50), Format::Ply);
    let stored: Value = service.post("/clouds?analyze=false", cloud).await.json().await.unwrap();
    let path = format!("/clouds/{}", stored["cloud"]["id"].as_str().unwrap());
    let service = service.restart_with(|settings| settings.keys = Some("alpha-key".parse().unwrap())).await;
    let keyed = service.client.get(service.url(&path)).bearer_auth("alpha-key").send().await.unwrap();
    problem(keyed, StatusCode::NOT_FOUND, "not-found").await;
    let service = service.restart().await;
    assert_eq!(service.get(&path).await.status(), StatusCode::OK);
}

#[tokio::test]
async fn the_name_of_a_submission_is_its_owners_own() {
    let service = Keyed::start().await;
    let submit = async |key: &str| {
        let request = service.0.client.post(service.0.url("/clouds?analyze=false")).bearer_auth(key);
        let request = request.header("idempotency-key", "monday").body(file(&sphere(100), Format::Ply));
        let response = request.send().await.unwrap();
        assert_eq!(response.status(), StatusCode::CREATED);
        let replayed = response.headers().contains_key("idempotency-replayed");
        let answer: Value = response.json().await.unwrap();
        (answer["cloud"]["id"].as_str().unwrap().to_owned(), replayed)
    };
    let (alpha, beta, gamma) =
        (submit("alpha-key").await, submit("beta-key").await, submit("gamma-key").await);
    assert!(!alpha.1 && !beta.1);
    assert_ne!(alpha.0, beta.0);
    // beta and gamma are keys of one owner
    assert_eq!(gamma, (beta.0, true));
}

#[tokio::test]
async fn a_key_that_is_given_a_name_keeps_what_it_had() {
    let keys =
        |text: &'static str| move |settings: &mut Settings| settings.keys = Some(text.parse().unwrap());
    let service = Keyed(Service::with_settings(keys("alpha-key, lab beta-key")).await);
    let alpha = service.own("alpha-key").await;
    let beta = service.own("beta-key").await;
    // The same content and the same analyses, of which the name can have one cloud only.
    let service = Keyed(service.0.restart_with(keys("lab alpha-key, lab beta-key, lab gamma-key")).await);
    for key in ["alpha-key", "beta-key", "gamma-key"] {
        for job in [&alpha.eigen, &alpha.operator, &beta.eigen] {
            assert_eq!(service.json(key, &format!("/jobs/{job}")).await["state"], "succeeded");
        }
        assert_eq!(service.json(key, "/jobs").await["jobs"].as_array().unwrap().len(), 4);
        assert_eq!(service.json(key, "/clouds").await["clouds"].as_array().unwrap().len(), 1);
        let path = format!("/jobs/{}/bases.npy", alpha.eigen);
        let bases = service.send(key, Method::GET, &path, Vec::new()).await;
        assert_eq!(bases.status(), StatusCode::OK);
    }
    let service = Keyed(service.0.restart_with(keys("alpha-key")).await);
    let gone = service.send("alpha-key", Method::GET, &format!("/jobs/{}", alpha.eigen), Vec::new()).await;
    problem(gone, StatusCode::NOT_FOUND, "not-found").await;
}

#[tokio::test]
async fn a_name_that_was_changed_has_what_it_had() {
    let directory = tempfile::tempdir().unwrap();
    let list = directory.path().join("keys");
    let file = list.clone();
    std::fs::write(&list, "lab alpha-key\nattic beta-key\n").unwrap();
    let service = Keyed(Service::with_settings(|settings| settings.api_keys = Some(file)).await);
    let (_, stored) = service.submit("alpha-key", "analyze=false").await;
    let path = format!("/clouds/{}", stored["cloud"]["id"].as_str().unwrap());
    let status = async |key: &str| service.send(key, Method::GET, &path, Vec::new()).await.status();
    let reread = async |text: &str| {
        std::fs::write(&list, text).unwrap();
        service.0.app.reread_keys().await;
    };
    reread("laboratory alpha-key\nattic beta-key\n").await;
    assert_eq!(status("alpha-key").await, StatusCode::NOT_FOUND, "another name is another owner");
    // who has a key of the former name keeps what it has
    reread("laboratory alpha-key\nlab beta-key\nlaboratory was lab\n").await;
    assert_eq!(status("alpha-key").await, StatusCode::NOT_FOUND, "that list changes nothing");
    reread("laboratory alpha-key\nattic beta-key\nlaboratory was lab\n").await;
    assert_eq!(
        [status("alpha-key").await, status("beta-key").await],
        [StatusCode::OK, StatusCode::NOT_FOUND]
    );
}

#[tokio::test]
async fn keys_are_read_again_while_the_service_runs() {
    let directory = tempfile::tempdir().unwrap();
    let list = directory.path().join("keys");
    let file = list.clone();
    std::fs::write(&list, "alpha-key\n").unwrap();
    let service = Keyed(Service::with_settings(|settings| settings.api_keys = Some(file)).await);
    let (_, stored) = service.submit("alpha-key", "analyze=false").await;
    let path = format!("/clouds/{}", stored["cloud"]["id"].as_str().unwrap());
    let status = async |key: &str| service.send(key, Method::GET, &path, Vec::new()).await.status();

    std::fs::write(&list, "lab alpha-key\nlab beta-key\n").unwrap();
    assert_eq!(status("beta-key").await, StatusCode::UNAUTHORIZED);
    service.0.app.reread_keys().await;
    assert_eq!([status("alpha-key").await, status("beta-key").await], [StatusCode::OK; 2]);
    // What cannot be used changes nothing.
    for text in ["", "one two three\n"] {
        std::fs::write(&list, text).unwrap();
        service.0.app.reread_keys().await;
        assert_eq!(status("beta-key").await, StatusCode::OK);
    }
    std::fs::write(&list, "lab beta-key\n").unwrap();
    service.0.app.reread_keys().await;
    assert_eq!(
        [status("alpha-key").await, status("beta-key").await],
        [StatusCode::UNAUTHORIZED, StatusCode::OK]
    );
}
