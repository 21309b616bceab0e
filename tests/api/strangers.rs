//! Web pages of strangers, and names that are not the service's.

use std::io::{Read, Write};
use std::net::TcpStream;

use chladni::cloud::reader::Format;
use reqwest::{Method, StatusCode};

use crate::service::{Service, detail, file, problem, sphere};

/// The status line of the answer to a request that is sent as it stands.
fn raw(service: &Service, request: &str) -> String {
    let mut stream = TcpStream::connect(service.app.address()).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

#[tokio::test(flavor = "multi_thread")]
async fn a_name_that_is_not_the_services_is_not_answered_to() {
    let service =
        Service::with_settings(|settings| settings.allowed_hosts = vec!["scans.example".into()]).await;
    let port = service.app.address().port();
    let status = async |host: &str, path: &str| {
        service.client.get(service.url(path)).header("host", host).send().await.unwrap()
    };
    for host in [format!("localhost:{port}"), "scans.example".into(), "127.0.0.1".into()] {
        assert_eq!(status(&host, "/clouds").await.status(), StatusCode::OK, "{host}");
    }
    for host in ["evil.example", "evil.example:8080", "localhost.evil.example"] {
        let refused =
            problem(status(host, "/clouds").await, StatusCode::MISDIRECTED_REQUEST, "host-not-allowed").await;
        assert!(detail(&refused).contains("--allowed-hosts"), "{refused}");
        assert_eq!(status(host, "/livez").await.status(), StatusCode::OK);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_request_names_one_host() {
    let service = Service::start().await;
    for hosts in ["", "Host: localhost\r\nHost: localhost\r\n", "Host: a b\r\n"] {
        let answer = raw(&service, &format!("GET /clouds HTTP/1.1\r\n{hosts}Connection: close\r\n\r\n"));
        assert!(answer.starts_with("HTTP/1.1 400 "), "{hosts}: {answer}");
        assert!(answer.contains("application/problem+json") && answer.contains("nosniff"), "{answer}");
    }
}

#[tokio::test]
async fn a_page_of_another_origin_changes_nothing_unless_it_is_let_in() {
    let page = "https://viewer.example";
    let service =
        Service::with_settings(|settings| settings.cors_origins = vec![page.parse().unwrap()]).await;
    let upload = async |name: &'static str, value: &str| {
        let request = service.client.post(service.url("/clouds?analyze=false")).header(name, value);
        request.body(file(&sphere(60), Format::Ply)).send().await.unwrap()
    };
    let own = format!("http://{}", service.app.address());
    for (name, value) in [("origin", page), ("origin", own.as_str()), ("sec-fetch-site", "same-origin")] {
        assert!(upload(name, value).await.status().is_success(), "{name}: {value}");
    }
    for (name, value) in
        [("origin", "http://evil.example"), ("origin", "null"), ("sec-fetch-site", "cross-site")]
    {
        problem(upload(name, value).await, StatusCode::FORBIDDEN, "origin-not-allowed").await;
    }
    let cloud = service.json("/clouds").await["clouds"][0]["id"].as_str().unwrap().to_owned();
    let delete = service.client.request(Method::DELETE, service.url(&format!("/clouds/{cloud}")));
    let refused = delete.header("origin", "http://evil.example").send().await.unwrap();
    problem(refused, StatusCode::FORBIDDEN, "origin-not-allowed").await;
    let read = service.client.get(service.url("/clouds")).header("origin", "http://evil.example");
    assert_eq!(read.send().await.unwrap().status(), StatusCode::OK, "browsers keep the answer from the page");
}

#[tokio::test]
async fn with_keys_every_name_and_origin_may_come() {
    let service = Service::with_settings(|settings| settings.keys = Some("alpha-key".parse().unwrap())).await;
    let request = service.client.post(service.url("/clouds?analyze=false")).bearer_auth("alpha-key");
    let request = request.header("host", "scans.example").header("origin", "https://any.example");
    assert!(request.body(file(&sphere(60), Format::Ply)).send().await.unwrap().status().is_success());
}

#[tokio::test]
async fn no_answer_is_to_be_guessed_at() {
    let service = Service::start().await;
    for path in ["/", "/docs", "/openapi.yaml", "/clouds", "/livez", "/nothing", "/jobs/%ff", "/metrics"] {
        let answer = service.get(path).await;
        assert_eq!(answer.headers()["x-content-type-options"], "nosniff", "{path}");
    }
    for path in ["/jobs/%ff", "/clouds/%ff", "/jobs/%ff/bases", "/jobs/%ff/spectrum.csv"] {
        problem(service.get(path).await, StatusCode::BAD_REQUEST, "malformed-request").await;
    }
}
