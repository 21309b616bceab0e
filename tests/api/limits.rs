//! Every limit, crossed; and every limit, told.

use std::collections::BTreeSet;
use std::io::Write;
use std::net::TcpStream;
use std::time::Duration;

use chladni::app::Settings;
use chladni::cloud::reader::Format;
use clap::{Args, Command};
use flate2::Compression;
use flate2::write::GzEncoder;
use reqwest::{Response, StatusCode};
use ruzstd::encoding::{CompressionLevel, compress_to_vec};
use serde_json::Value;

use crate::service::{Service, detail, file, lines, never_finishing, problem, sphere};

/// Settings that bound something, each with its name in `/capabilities`.
const LIMITS: [(&str, &str); 24] = [
    ("body-bytes-max", "body_bytes"),
    ("decoded-bytes-max", "decoded_bytes"),
    ("decoded-ratio-max", "decoded_ratio_max"),
    ("body-seconds", "body_seconds"),
    ("body-rate-min", "body_rate_min_bytes"),
    ("stall-seconds", "stall_seconds"),
    ("header-seconds", "header_seconds"),
    ("connections-max", "connections_max"),
    ("body-memory", "body_memory_bytes"),
    ("points-max", "points_max"),
    ("dimension-max", "dimension_max"),
    ("fields-max", "fields_max"),
    ("faces-max", "faces_max"),
    ("bases-max", "bases_max"),
    ("queue-max", "queue_max"),
    ("queue-max-per-key", "queue_max_per_key"),
    ("stored-bytes-max-per-key", "stored_bytes_max_per_key"),
    ("database-bytes-max", "database_bytes_max"),
    ("job-seconds", "job_seconds"),
    ("jobs-at-once", "jobs_at_once"),
    ("memory-budget", "memory_budget_bytes"),
    ("disk-floor", "disk_floor_bytes"),
    ("keep-jobs-days", "keep_jobs_days"),
    ("keep-clouds-days", "keep_clouds_days"),
];

/// Settings that bound nothing for a client.
const NO_LIMITS: [&str; 10] = [
    "listen",
    "no-listen",
    "database",
    "threads",
    "grace-seconds",
    "api-keys",
    "keys",
    "allow-public",
    "cors-origins",
    "allowed-hosts",
];

#[tokio::test]
async fn every_setting_that_is_a_limit_is_told_with_its_value() {
    let command = Settings::augment_args(Command::new("serve"));
    let flags: BTreeSet<_> = command.get_arguments().filter_map(|argument| argument.get_long()).collect();
    let known: BTreeSet<_> = LIMITS.iter().map(|(flag, _)| *flag).chain(NO_LIMITS).collect();
    assert_eq!(flags, known, "a new setting is a limit, to be told in /capabilities, or it is none");

    // Values that are all different, given as flags.
    let values: Vec<String> = (0..LIMITS.len()).map(|place| (101 + place).to_string()).collect();
    let flags = LIMITS.iter().zip(&values).map(|((flag, _), value)| match *flag {
        "dimension-max" => "--dimension-max=5".to_owned(),
        _ => format!("--{flag}={value}"),
    });
    let matches = command.get_matches_from(std::iter::once("serve".to_owned()).chain(flags));
    let given = <Settings as clap::FromArgMatches>::from_arg_matches(&matches).unwrap();
    let service = Service::with_settings(|settings| {
        let (listen, database) = (settings.listen, settings.database.clone());
        *settings = Settings { listen, database, ..given };
    })
    .await;
    let told = service.json("/capabilities").await["limits"].clone();
    for ((flag, name), value) in LIMITS.iter().zip(&values) {
        let expected = if *flag == "dimension-max" { 5 } else { value.parse::<u64>().unwrap() };
        assert_eq!(told[name], expected, "{flag}");
    }
}

#[tokio::test]
async fn more_coordinates_than_the_limit_are_refused() {
    let service = Service::with_settings(|settings| settings.dimension_max = 2).await;
    let refused = service.post("/clouds?format=xyz&coordinates=3", lines(&[[1.0, 2.0, 3.0]; 9])).await;
    let refused = problem(refused, StatusCode::UNPROCESSABLE_ENTITY, "unusable-cloud").await;
    assert!(detail(&refused).contains('2'), "{refused}");
}

#[tokio::test]
async fn more_bases_than_the_limit_are_refused() {
    let service = Service::with_settings(|settings| settings.bases_max = 7).await;
    let refused = service.post("/clouds?bases=8", file(&sphere(100), Format::Ply)).await;
    let refused = problem(refused, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
    assert!(detail(&refused).contains('7'), "{refused}");
    service.succeed("bases=7", file(&sphere(100), Format::Ply)).await;
    // Whatever is wrong with the number, the range that is told is this service's.
    let stored: Value =
        service.post("/clouds?analyze=false", file(&sphere(100), Format::Ply)).await.json().await.unwrap();
    let jobs = format!("/clouds/{}/jobs", stored["cloud"]["id"].as_str().unwrap());
    for bases in ["0", "-3", "abc", "1e3", "8", "5000"] {
        let query = service.post(&format!("/clouds?bases={bases}"), lines(&[])).await;
        let json = service.post(&jobs, format!("{{\"bases\": \"{bases}\"}}")).await;
        for refused in [query, json] {
            let refused = problem(refused, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
            assert!(detail(&refused).contains("from 1 to 7,"), "{refused}");
        }
    }
    // Nobody asked for more.
    let few = service.accept("operator=voronoi", file(&sphere(100), Format::Ply)).await;
    assert_eq!(few["job"]["parameters"]["bases"], 7);
}

#[tokio::test]
async fn more_fields_and_more_faces_than_the_limit_are_refused() {
    let service = Service::with_settings(|settings| (settings.fields_max, settings.faces_max) = (1, 0)).await;
    let fields = service.post("/clouds?format=xyz", b"1 2 3 4 5\n".repeat(9)).await;
    problem(fields, StatusCode::PAYLOAD_TOO_LARGE, "too-large").await;
    let faces = b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n".to_vec();
    problem(service.post("/clouds", faces).await, StatusCode::PAYLOAD_TOO_LARGE, "too-large").await;
}

#[tokio::test]
async fn a_job_over_the_memory_budget_is_refused_with_need_and_budget() {
    let service = Service::with_settings(|settings| settings.memory_budget = 200_000).await;
    let refused = service.post("/clouds?bases=5", file(&sphere(100), Format::Ply)).await;
    let refused = problem(refused, StatusCode::UNPROCESSABLE_ENTITY, "over-budget").await;
    assert_eq!(refused["budget"], 200_000);
    assert!(refused["need"].as_u64().unwrap() > 200_000, "{refused}");
    assert!(service.json("/clouds").await["clouds"].as_array().unwrap().is_empty(), "nothing is left of it");
    let stored = service.post("/clouds?analyze=false", file(&sphere(100), Format::Ply)).await;
    let stored: Value = stored.json().await.unwrap();
    let jobs = format!("/clouds/{}/jobs", stored["cloud"]["id"].as_str().unwrap());
    let refused = service.post(&jobs, "{\"bases\": 5}").await;
    problem(refused, StatusCode::UNPROCESSABLE_ENTITY, "over-budget").await;
}

#[tokio::test]
async fn a_disk_that_is_too_full_takes_nothing_and_gives_what_it_has() {
    let service = Service::with_settings(|settings| settings.disk_floor = u64::MAX).await;
    let refused = service.post("/clouds?analyze=false", file(&sphere(100), Format::Ply)).await;
    problem(refused, StatusCode::INSUFFICIENT_STORAGE, "storage-full").await;
    assert_eq!(service.get("/clouds").await.status(), StatusCode::OK);
}

#[tokio::test]
async fn a_body_that_the_service_has_no_memory_for_is_refused_with_the_largest_it_has() {
    let service = Service::with_settings(|settings| settings.body_memory = 1 << 20).await;
    let refused = service.post("/clouds?format=xyz", b"1 2 3\n".repeat(50_000)).await;
    let refused = problem(refused, StatusCode::PAYLOAD_TOO_LARGE, "too-large").await;
    assert_eq!(refused["limit"], (1 << 20) / 5);
    let accepted = service.post("/clouds?analyze=false", file(&sphere(100), Format::Ply)).await;
    assert_eq!(accepted.status(), StatusCode::CREATED);
}

/// A client that announces a body, sends `sent` of it, and then nothing until it is dropped.
fn slow_client(service: &Service, path: &str, announced: usize, sent: &[u8]) -> TcpStream {
    let mut stream = TcpStream::connect(service.app.address()).unwrap();
    let head = format!("POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {announced}\r\n\r\n");
    stream.write_all(&[head.as_bytes(), sent].concat()).unwrap();
    stream
}

/// Waits until the service has received so many bytes.
async fn received(service: &Service, bytes: usize) {
    loop {
        let metrics = service.get("/metrics").await.text().await.unwrap();
        let line =
            metrics.lines().find(|line| line.starts_with("chladni_http_received_bytes_total")).unwrap();
        if line.split(' ').nth(1).unwrap().parse::<f64>().unwrap() >= bytes as f64 {
            return;
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_body_that_finds_no_memory_free_is_told_when_to_try_again() {
    // Room for 2 MB; a client that has sent 1.5 MB goes on byte by byte.
    let service = Service::with_settings(|settings| {
        (settings.body_memory, settings.stall_seconds, settings.body_rate_min) = (10 << 20, 2, 0);
    })
    .await;
    let sent = b"1 2 3\n".repeat(250_000);
    let mut slow = slow_client(&service, "/clouds?format=xyz", 2_000_000, &sent);
    let slow = std::thread::spawn(move || {
        while slow.write_all(b"1").is_ok() {
            std::thread::sleep(Duration::from_millis(200));
        }
    });
    received(&service, sent.len()).await;
    let answer = service.post("/clouds?format=xyz&analyze=false", b"4 5 6\n".repeat(250_000)).await;
    assert!(answer.headers().contains_key("retry-after"));
    problem(answer, StatusCode::SERVICE_UNAVAILABLE, "unavailable").await;
    let small = service.post("/clouds?format=xyz&analyze=false", b"4 5 6\n".repeat(20_000)).await;
    assert_eq!(small.status(), StatusCode::CREATED, "small bodies have room of their own");
    service.app.shutdown().await;
    slow.join().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn what_clients_announce_takes_no_memory() {
    let service = Service::with_settings(|settings| settings.body_memory = 64 << 20).await;
    let paths = ["/clouds?format=xyz", "/clouds", "/clouds?analyze=false"];
    let slow: Vec<_> = (0..200).map(|i| slow_client(&service, paths[i % 3], 10 << 20, b"1 2 3\n")).collect();
    received(&service, 6 * slow.len()).await;
    let metrics = service.get("/metrics").await.text().await.unwrap();
    let taken = metrics.lines().find(|line| line.starts_with("chladni_body_memory_bytes")).unwrap();
    assert!(taken.split(' ').nth(1).unwrap().parse::<f64>().unwrap() < 6e6, "{taken}");
    let mut slowest = Duration::ZERO;
    for number in 0..20 {
        let began = std::time::Instant::now();
        let body = format!("{number} 2 3\n").repeat(20_000);
        let answer = service.post("/clouds?format=xyz&analyze=false", body).await;
        assert_eq!(answer.status(), StatusCode::CREATED);
        slowest = slowest.max(began.elapsed());
    }
    println!("slowest of 20 uploads of 120 kB beside {} clients that stall: {slowest:?}", slow.len());
    // A second on a machine that does nothing else; for want of memory it would be the thirty of the stall.
    assert!(slowest < Duration::from_secs(5));
    let large = service.post("/clouds?format=xyz&analyze=false", b"4 5 6\n".repeat(1_000_000)).await;
    assert_eq!(large.status(), StatusCode::CREATED);
}

#[tokio::test]
async fn a_body_that_is_slower_than_the_least_rate_is_given_up() {
    let service = Service::with_settings(|settings| {
        (settings.stall_seconds, settings.body_rate_min) = (1, 10_000);
    })
    .await;
    let trickle = |bytes: usize| {
        let pieces = futures_util::stream::unfold(0, move |piece| async move {
            tokio::time::sleep(Duration::from_millis(100)).await;
            (piece < 30).then(|| (Ok::<_, std::io::Error>(b"1 2 3\n".repeat(bytes / 6)), piece + 1))
        });
        reqwest::Body::wrap_stream(pieces)
    };
    let refused = service.post("/clouds?format=xyz", trickle(300)).await;
    let refused = problem(refused, StatusCode::REQUEST_TIMEOUT, "request-timeout").await;
    assert!(detail(&refused).contains("less than 10000 bytes per second"), "{refused}");
    let accepted = service.post("/clouds?format=xyz&analyze=false", trickle(6000)).await;
    assert_eq!(accepted.status(), StatusCode::CREATED);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_slow_body_holds_nothing_of_what_its_answer_takes() {
    let service = Service::with_settings(|settings| settings.body_memory = 1 << 20).await;
    let eigen = service.succeed("bases=20", file(&sphere(2000), Format::Ply)).await;
    let operator = service.succeed("kind=operator", file(&sphere(2000), Format::Ply)).await;
    let paths = [
        format!("/jobs/{eigen}/synthesis"),
        format!("/jobs/{eigen}/coefficients"),
        format!("/jobs/{eigen}/filtered"),
        format!("/jobs/{operator}/laplacian"),
    ];
    let slow: Vec<_> = (0..40).map(|i| slow_client(&service, &paths[i % 4], 2000, b"[1, ")).collect();
    let before = file(&sphere(2000), Format::Ply).len() * 2;
    received(&service, before + 4 * slow.len()).await;
    for path in [format!("/jobs/{eigen}/filtered"), format!("/jobs/{eigen}/coefficients")] {
        assert_eq!(service.get(&path).await.status(), StatusCode::OK, "{path}");
    }
}

#[tokio::test]
async fn a_part_of_a_file_is_refused_with_what_to_do() {
    let service = Service::start().await;
    let body = file(&sphere(100), Format::Ply);
    let range = format!("bytes 100-{}/{}", body.len() - 1, body.len());
    let request = service.client.put(service.url("/clouds")).header("content-range", range);
    let refused = request.body(body[100..].to_vec()).send().await.unwrap();
    let refused = problem(refused, StatusCode::BAD_REQUEST, "malformed-request").await;
    assert!(detail(&refused).contains("without -C"), "{refused}");
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn zstd(bytes: &[u8]) -> Vec<u8> {
    compress_to_vec(bytes, CompressionLevel::Fastest)
}

async fn send_encoded(service: &Service, path: &str, encoding: &str, body: Vec<u8>) -> Response {
    let request = service.client.post(service.url(path)).header("content-encoding", encoding);
    request.body(body).send().await.unwrap()
}

#[tokio::test]
async fn compressed_bodies_are_the_same_as_plain_ones_everywhere() {
    let service = Service::start().await;
    let cloud = file(&sphere(100), Format::Xyz);
    let plain: Value = service.post("/clouds?analyze=false", cloud.clone()).await.json().await.unwrap();
    for (encoding, compressed) in [("gzip", gzip(&cloud)), ("zstd", zstd(&cloud))] {
        let sent = send_encoded(&service, "/clouds?analyze=false", encoding, compressed).await;
        let sent: Value = sent.json().await.unwrap();
        assert_eq!(sent["cloud"]["id"], plain["cloud"]["id"], "{encoding}");
    }
    let jobs = format!("/clouds/{}/jobs", plain["cloud"]["id"].as_str().unwrap());
    let sent = send_encoded(&service, &jobs, "gzip", gzip(b"{\"bases\": 3}")).await;
    assert_eq!(sent.status(), StatusCode::ACCEPTED);
    assert_eq!(sent.json::<Value>().await.unwrap()["job"]["parameters"]["bases"], 3);
}

#[tokio::test]
async fn an_encoding_that_is_not_known_is_refused_with_those_that_are() {
    let service = Service::start().await;
    let refused = send_encoded(&service, "/clouds", "br", b"x".to_vec()).await;
    assert_eq!(refused.headers()["accept-encoding"], "gzip, zstd");
    problem(refused, StatusCode::UNSUPPORTED_MEDIA_TYPE, "unsupported-encoding").await;
}

#[tokio::test]
async fn a_body_that_decompresses_beyond_the_limits_is_refused() {
    let service = Service::with_settings(|settings| settings.decoded_bytes_max = 10_000).await;
    let cloud = file(&sphere(500), Format::Xyz);
    for (encoding, compressed) in [("gzip", gzip(&cloud)), ("zstd", zstd(&cloud))] {
        let refused = send_encoded(&service, "/clouds", encoding, compressed).await;
        let refused = problem(refused, StatusCode::PAYLOAD_TOO_LARGE, "too-large").await;
        assert_eq!(refused["limit"], 10_000);
    }
    let service = Service::with_settings(|settings| settings.decoded_ratio_max = 10).await;
    let bomb = vec![b'0'; 20 << 20];
    for (encoding, compressed) in [("gzip", gzip(&bomb)), ("zstd", zstd(&bomb))] {
        let refused = send_encoded(&service, "/clouds?format=xyz", encoding, compressed).await;
        let refused = problem(refused, StatusCode::PAYLOAD_TOO_LARGE, "too-large").await;
        assert!(detail(&refused).contains("10 times"), "{refused}");
    }
}

#[tokio::test]
async fn a_body_that_is_not_what_its_encoding_says_is_refused() {
    let service = Service::start().await;
    for encoding in ["gzip", "zstd"] {
        let refused = send_encoded(&service, "/clouds", encoding, b"0 0 0\n".to_vec()).await;
        problem(refused, StatusCode::BAD_REQUEST, "malformed-request").await;
    }
}

#[tokio::test]
async fn a_body_that_trickles_is_given_up_after_its_time() {
    let service = Service::with_settings(|settings| settings.body_seconds = 1).await;
    let trickle = futures_util::stream::unfold((), |()| async {
        tokio::time::sleep(Duration::from_millis(50)).await;
        Some((Ok::<_, std::io::Error>(b"1 2 3\n".to_vec()), ()))
    });
    let refused = service.post("/clouds", reqwest::Body::wrap_stream(trickle)).await;
    let refused = problem(refused, StatusCode::REQUEST_TIMEOUT, "request-timeout").await;
    assert!(detail(&refused).contains("longer than 1 second"), "{refused}");
}

/// The head of an upload whose body never comes.
fn stuck(service: &Service) -> TcpStream {
    let mut stream = TcpStream::connect(service.app.address()).unwrap();
    let head = "PUT /clouds HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\n1 2 3\n";
    stream.write_all(head.as_bytes()).unwrap();
    stream
}

#[tokio::test]
async fn probes_are_answered_beyond_the_cap_and_other_requests_wait() {
    let service = Service::with_settings(|settings| settings.connections_max = 2).await;
    let holding = [stuck(&service), stuck(&service)];
    for path in ["/livez", "/readyz", "/metrics", "/livez"] {
        let probe = reqwest::Client::new().get(service.url(path)).timeout(Duration::from_secs(20));
        assert_eq!(probe.send().await.unwrap().status(), StatusCode::OK, "{path}");
    }
    let mut other = Box::pin(service.client.get(service.url("/clouds")).send());
    let early = tokio::time::timeout(Duration::from_millis(300), &mut other).await;
    assert!(early.is_err(), "answered beside the others: {early:?}");
    drop(holding);
    assert_eq!(other.await.unwrap().status(), StatusCode::OK);
}

#[tokio::test]
async fn bodies_that_trickle_and_connections_without_requests_give_their_places_up() {
    let service = Service::with_settings(|settings| settings.connections_max = 3).await;
    let address = service.app.address();
    // One without a request, one with half a head, one whose body comes byte by byte.
    let idle = TcpStream::connect(address).unwrap();
    let mut half = TcpStream::connect(address).unwrap();
    half.write_all(b"GET /livez HTTP/1.1\r\n").unwrap();
    let mut trickling = stuck(&service);
    let trickle = std::thread::spawn(move || {
        while trickling.write_all(b"1").is_ok() {
            std::thread::sleep(Duration::from_millis(100));
        }
    });
    for _ in 0..4 {
        let request = reqwest::Client::new().get(service.url("/clouds")).timeout(Duration::from_mins(1));
        // A new connection each time, all held open.
        assert_eq!(request.send().await.unwrap().status(), StatusCode::OK);
        std::mem::forget(stuck(&service));
    }
    drop((idle, half));
    trickle.join().unwrap();
}

#[tokio::test]
async fn a_client_that_takes_no_answer_is_closed() {
    let service = Service::with_settings(|settings| {
        (settings.connections_max, settings.stall_seconds) = (1, 1);
    })
    .await;
    // More than the sockets of both sides hold.
    let points: Vec<[f64; 3]> = (0..400_000).map(|i| [f64::from(i) / 3.0, 0.1, 0.2]).collect();
    let mut npy =
        b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f8', 'fortran_order': False, 'shape': (400000, 3), }".to_vec();
    npy.resize(127, b' ');
    npy.push(b'\n');
    npy.extend(points.iter().flatten().flat_map(|x| x.to_le_bytes()));
    let stored: Value = service.post("/clouds?analyze=false", npy).await.json().await.unwrap();
    let path = stored["links"]["points"].as_str().unwrap().to_owned();
    let service = Service { client: reqwest::Client::new(), ..service };
    let mut deaf = TcpStream::connect(service.app.address()).unwrap();
    deaf.write_all(format!("GET {path}?format=json HTTP/1.1\r\nHost: localhost\r\n\r\n").as_bytes()).unwrap();
    let answered = service.client.get(service.url("/clouds")).timeout(Duration::from_mins(1)).send();
    assert_eq!(answered.await.unwrap().status(), StatusCode::OK, "the only place is free again");
    drop(deaf);
}

#[tokio::test]
async fn as_many_jobs_run_at_once_as_the_setting_says() {
    let service = Service::start_with(|settings| settings.jobs_at_once = 2, never_finishing()).await;
    for points in [100, 101, 102] {
        service.accept("bases=2", file(&sphere(points), Format::Ply)).await;
    }
    let running = async || service.json("/jobs?state=running").await["jobs"].as_array().unwrap().len();
    while running().await < 2 {}
    assert_eq!(service.json("/jobs?state=queued").await["jobs"].as_array().unwrap().len(), 1);
}
