//! Clouds and parameters that are refused, and what is said about them.

use std::io::{Read, Write};
use std::net::TcpStream;

use chladni::cloud::reader::Format;
use reqwest::StatusCode;
use serde_json::Value;

use crate::service::{Service, detail, file, lines, problem, sphere, sphere_and};

async fn refusal(path: &str, body: Vec<u8>, status: StatusCode, kind: &str) -> Value {
    let service = Service::start().await;
    problem(service.post(path, body).await, status, kind).await
}

#[tokio::test]
async fn an_unknown_format_is_refused_with_those_that_are_accepted() {
    let refused =
        refusal("/clouds", b"<html>".to_vec(), StatusCode::UNSUPPORTED_MEDIA_TYPE, "unsupported-format")
            .await;
    for format in Format::ALL {
        assert!(detail(&refused).contains(format.name()), "{refused}");
    }
}

#[tokio::test]
async fn an_unknown_media_type_is_refused_by_its_name() {
    let service = Service::start().await;
    let request = service.client.post(service.url("/clouds")).header("content-type", "image/png").body("x");
    let refused =
        problem(request.send().await.unwrap(), StatusCode::UNSUPPORTED_MEDIA_TYPE, "unsupported-format")
            .await;
    assert!(detail(&refused).contains("image/png"), "{refused}");
}

#[tokio::test]
async fn an_empty_body_is_refused() {
    let refused = refusal("/clouds", Vec::new(), StatusCode::BAD_REQUEST, "malformed-request").await;
    assert!(detail(&refused).contains("empty"), "{refused}");
}

#[tokio::test]
async fn a_file_that_has_lost_its_line_ends_on_the_way_is_refused_whatever_is_left_of_it() {
    let service = Service::start().await;
    let ply = String::from_utf8_lossy(&file(&sphere(50), Format::Ply)).replace(['\n', '\r'], "");
    for body in ["0 0 11 0 21 1 3".to_owned(), "x,y,z0,0,11,0,2".to_owned(), ply] {
        let request = service.client.post(service.url("/clouds?analyze=false"));
        let request = request.header("content-type", "application/x-www-form-urlencoded").body(body);
        let refused =
            problem(request.send().await.unwrap(), StatusCode::BAD_REQUEST, "malformed-request").await;
        assert!(detail(&refused).contains("--data-binary"), "{refused}");
    }
    let request = service.client.post(service.url("/clouds?analyze=false"));
    let whole = request.header("content-type", "application/x-www-form-urlencoded").body("0 0 1\n1 0 2\n");
    assert_eq!(whole.send().await.unwrap().status(), StatusCode::CREATED);
}

#[tokio::test]
async fn a_form_without_a_file_is_refused() {
    let service = Service::start().await;
    let form = reqwest::multipart::Form::new().text("comment", "hello");
    let response = service.client.post(service.url("/clouds")).multipart(form).send().await.unwrap();
    let refused = problem(response, StatusCode::BAD_REQUEST, "malformed-request").await;
    assert!(detail(&refused).contains("no file part"), "{refused}");
}

#[tokio::test]
async fn a_truncated_file_is_refused_with_the_byte_it_ends_at() {
    let mut ply = file(&sphere(100), Format::Ply);
    ply.truncate(ply.len() - 10);
    let refused = refusal("/clouds", ply, StatusCode::BAD_REQUEST, "malformed-file").await;
    assert!(detail(&refused).contains("byte"), "{refused}");
}

#[tokio::test]
async fn a_malformed_line_is_refused_with_its_number() {
    let refused = refusal(
        "/clouds?format=xyz",
        b"0 0 0\n1 0 0\n0 one 0\n".to_vec(),
        StatusCode::BAD_REQUEST,
        "malformed-file",
    )
    .await;
    assert!(detail(&refused).contains("line 3"), "{refused}");
}

#[tokio::test]
async fn a_non_finite_row_is_refused_with_its_number() {
    let body = sphere_and(100, &[[f64::NAN, 0.0, 0.0]]);
    let refused = refusal("/clouds", body, StatusCode::UNPROCESSABLE_ENTITY, "unusable-cloud").await;
    assert!(detail(&refused).contains("100") && detail(&refused).contains("nonfinite=drop"), "{refused}");
}

#[tokio::test]
async fn a_non_finite_row_is_kept_without_a_result_when_the_caller_says_so() {
    let service = Service::that_never_finishes().await;
    let submission = service.accept("nonfinite=drop&bases=5", sphere_and(100, &[[f64::NAN, 0.0, 0.0]])).await;
    assert_eq!(submission["cloud"]["nonfinite"], 1);
    assert_eq!(submission["cloud"]["points"], 101);
    assert_eq!(submission["cloud"]["points_used"], 100);
}

#[tokio::test]
async fn clouds_that_carry_no_surface_are_refused() {
    let three = lines(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let line: Vec<_> = (0..50).map(|i| [f64::from(i), 2.0 * f64::from(i), 0.0]).collect();
    for body in [three, lines(&line), lines(&[[1.0, 2.0, 3.0]; 50])] {
        refusal("/clouds?bases=2", body, StatusCode::UNPROCESSABLE_ENTITY, "unusable-cloud").await;
    }
}

#[tokio::test]
async fn more_bases_than_points_are_refused() {
    let body = file(&sphere(50), Format::Ply);
    let refused =
        refusal("/clouds?bases=51", body, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
    assert_eq!(refused["parameter"], "bases");
}

#[tokio::test]
async fn an_unknown_parameter_is_refused_with_the_nearest_known() {
    let refused =
        refusal("/clouds?basis=5", b"x".to_vec(), StatusCode::UNPROCESSABLE_ENTITY, "unknown-parameter")
            .await;
    assert_eq!(refused["nearest"], "bases");
    assert!(detail(&refused).contains("did you mean `bases`?"));
}

#[tokio::test]
async fn a_value_that_is_not_accepted_is_refused_with_those_that_are() {
    for (query, name, accepted) in [
        ("bases=0", "bases", "whole number from 1"),
        ("bases=1001", "bases", "1000"),
        ("bases=ten", "bases", "whole number"),
        ("operator=laplace", "operator", "pb-mhb, voronoi, pcd"),
        ("kind=both", "kind", "eigen, operator"),
        ("tol=-1", "tolerance", "1e-12 to 1e-1"),
        ("t=0", "t", "above 0"),
        ("paper=perhaps", "paper", "true or false"),
        ("format=gif", "format", "ply, obj"),
        ("nonfinite=keep", "nonfinite", "reject, drop"),
        ("coordinates=9", "coordinates", "1 to 8"),
        ("dimension=4", "dimension", "1 to 3"),
    ] {
        let refused = refusal(
            &format!("/clouds?{query}"),
            b"x".to_vec(),
            StatusCode::UNPROCESSABLE_ENTITY,
            "invalid-parameter",
        )
        .await;
        assert_eq!(refused["parameter"], name, "{query}");
        assert!(detail(&refused).contains(accepted), "{query}: {refused}");
    }
}

#[tokio::test]
async fn parameters_that_exclude_each_other_are_refused() {
    let refused = refusal(
        "/clouds?t=1&t_factor=2",
        b"x".to_vec(),
        StatusCode::UNPROCESSABLE_ENTITY,
        "invalid-parameter",
    )
    .await;
    assert!(detail(&refused).contains("t_factor"), "{refused}");
}

#[tokio::test]
async fn a_body_over_the_limit_is_refused_announced_or_not() {
    let service = Service::with_settings(|settings| settings.body_bytes_max = 1000).await;
    let announced = service.post("/clouds", vec![b'1'; 1001]).await;
    let refused = problem(announced, StatusCode::PAYLOAD_TOO_LARGE, "too-large").await;
    assert_eq!(refused["limit"], 1000);
    let chunks = futures_util::stream::iter((0..20).map(|_| Ok::<_, std::io::Error>(vec![b'1'; 100])));
    let streamed = service.post("/clouds", reqwest::Body::wrap_stream(chunks)).await;
    problem(streamed, StatusCode::PAYLOAD_TOO_LARGE, "too-large").await;
}

#[tokio::test]
async fn more_points_than_the_limit_are_refused() {
    let service = Service::with_settings(|settings| settings.points_max = 99).await;
    let response = service.post("/clouds", file(&sphere(100), Format::Ply)).await;
    let refused = problem(response, StatusCode::PAYLOAD_TOO_LARGE, "too-large").await;
    assert!(detail(&refused).contains("99"), "{refused}");
}

#[tokio::test]
async fn an_early_refusal_reaches_a_client_that_is_still_sending() {
    let service = Service::start().await;
    let address = service.app.address();
    let answer = tokio::task::spawn_blocking(move || {
        let mut stream = TcpStream::connect(address).unwrap();
        let megabytes = 20;
        let head = format!(
            "PUT /clouds?basis=1 HTTP/1.1\r\nHost: localhost\r\nContent-Length: {}\r\n\r\n",
            megabytes << 20
        );
        stream.write_all(head.as_bytes()).unwrap();
        for _ in 0..megabytes {
            stream.write_all(&vec![b'1'; 1 << 20]).unwrap();
        }
        let mut answer = [0; 12];
        stream.read_exact(&mut answer).unwrap();
        String::from_utf8(answer.to_vec()).unwrap()
    });
    assert_eq!(answer.await.unwrap(), "HTTP/1.1 422");
}

#[tokio::test]
async fn an_upload_that_stalls_is_given_up() {
    let service = Service::with_settings(|settings| settings.stall_seconds = 0).await;
    let never = futures_util::stream::pending::<Result<Vec<u8>, std::io::Error>>();
    let response = service.post("/clouds", reqwest::Body::wrap_stream(never)).await;
    problem(response, StatusCode::REQUEST_TIMEOUT, "request-timeout").await;
}

#[tokio::test]
async fn a_full_queue_is_told_with_a_time_to_try_again() {
    let service =
        Service::start_with(|settings| settings.queue_max = 1, crate::service::never_finishing()).await;
    let running: Value = submitted(&service, 1).await.json().await.unwrap();
    service.running(running["job"]["id"].as_str().unwrap()).await;
    assert_eq!(submitted(&service, 2).await.status(), StatusCode::ACCEPTED);
    let refused = submitted(&service, 3).await;
    assert!(refused.headers().contains_key("retry-after"));
    problem(refused, StatusCode::TOO_MANY_REQUESTS, "queue-full").await;
}

async fn submitted(service: &Service, bases: usize) -> reqwest::Response {
    service.post(&format!("/clouds?bases={bases}"), file(&sphere(100), Format::Ply)).await
}
