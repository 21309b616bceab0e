//! What the log tells, and what it keeps to itself.

use std::path::Path;

use reqwest::StatusCode;
use serde_json::Value;

use crate::process::{Process, sphere};

const KEY: &str = "correct-horse-battery";
const WRONG: &str = "wrong-staple-zebra";
const CONTENT: &str = "marker777";
const NAME: &str = "secret-statue-of-the-client";

#[tokio::test(flavor = "multi_thread")]
async fn a_log_in_json_joins_requests_and_jobs_and_shows_no_key_no_path_and_no_content() {
    let directory = tempfile::tempdir().unwrap();
    let environment = [("CHLADNI_KEYS", KEY), ("CHLADNI_LOG", "debug"), ("CHLADNI_LOG_FORMAT", "json")];
    let mut process = Process::with(&directory.path().join("hidden.db"), &[], &environment);
    let url = |path: &str| format!("{}{path}", process.address);
    let client = &process.client;

    let upload = client.put(url(&format!("/clouds/{NAME}.npy?bases=3&operator=voronoi"))).body(sphere(60));
    let submitted = upload.bearer_auth(KEY).header("x-request-id", "join-me").send().await.unwrap();
    assert_eq!(submitted.status(), StatusCode::ACCEPTED);
    let job = submitted.json::<Value>().await.unwrap()["job"]["id"].as_str().unwrap().to_owned();
    let ended = client.get(url(&format!("/jobs/{job}?wait=60"))).bearer_auth(KEY).send().await.unwrap();
    assert_eq!(ended.json::<Value>().await.unwrap()["state"], "succeeded");
    // Everything that could end up in a message: content, names, queries, paths, keys.
    let malformed = format!("0 0 0\n1 {CONTENT} 0\n");
    for (path, body) in [
        (format!("/clouds/{NAME}.xyz"), malformed.clone()),
        (format!("/clouds?format={NAME}"), malformed.clone()),
        (format!("/clouds?{NAME}=1"), malformed.clone()),
        (format!("/{NAME}"), malformed),
    ] {
        let refused = client.put(url(&path)).body(body).bearer_auth(KEY).send().await.unwrap();
        assert!(refused.status().is_client_error(), "{path}");
    }
    let refused = client.get(url("/clouds")).bearer_auth(WRONG).send().await.unwrap();
    assert_eq!(refused.status(), StatusCode::UNAUTHORIZED);
    process.kill();

    let log = std::fs::read_to_string(&process.log).unwrap();
    let database = directory.path().to_str().unwrap();
    for hidden in [KEY, WRONG, CONTENT, NAME, database] {
        assert!(!log.contains(hidden), "`{hidden}` is in the log:\n{log}");
    }
    let events: Vec<Value> = log.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let told = |message: &str| {
        events.iter().filter(|event| event["message"] == message).cloned().collect::<Vec<_>>()
    };
    let queued = told("job queued");
    assert_eq!(queued.len(), 1);
    assert_eq!(queued[0]["span"]["id"], "join-me", "{}", queued[0]);
    assert_eq!(queued[0]["job"], job.as_str());
    assert_eq!((&queued[0]["operator"], &queued[0]["kind"]), (&"voronoi".into(), &"eigen".into()));
    assert_eq!((&queued[0]["bases"], &queued[0]["points"]), (&3.into(), &60.into()));
    assert!(queued[0]["owner"].as_str().unwrap().starts_with("key "), "a key without a name");
    assert!(told("job ends").iter().any(|event| event["job"] == job.as_str()
        && event["state"] == "succeeded"
        && event["owner"] == queued[0]["owner"]
        && event["seconds"].is_f64()));
    assert!(told("job begins").iter().any(|event| event["owner"] == queued[0]["owner"]));
    assert!(
        told("answered").iter().any(|event| event["id"] == "join-me" && event["route"] == "/clouds/{id}")
    );
}

/// Names of owners in the log that have no key, at every start that said so.
fn unreachable(log: &Path) -> Vec<String> {
    let log = std::fs::read_to_string(log).unwrap();
    let events = log.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let told = events.filter(|event| {
        event["message"].as_str().is_some_and(|message| message.contains("chladni keys rename OLD NEW"))
    });
    told.map(|event| event["owners"].as_str().unwrap().to_owned()).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_start_names_whose_data_has_no_key() {
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("renamed.db");
    let start = |keys: &str| {
        let environment = [("CHLADNI_KEYS", keys), ("CHLADNI_LOG_FORMAT", "json")];
        Process::with(&database, &[], &environment)
    };
    for key in ["lab correct-horse-battery", "attic purple-monkey-dishwasher"] {
        let mut process = start(key);
        let upload = process.client.post(format!("{}/clouds?analyze=false", process.address));
        let upload = upload.bearer_auth(key.split(' ').nth(1).unwrap()).body(sphere(60));
        assert_eq!(upload.send().await.unwrap().status(), StatusCode::CREATED);
        process.kill();
    }
    let log = database.with_extension("log");
    assert_eq!(unreachable(&log), ["lab"], "the second start finds what the first one stored");
    for (keys, told) in [
        ("laboratory correct-horse-battery", Some("attic, lab")),
        ("lab correct-horse-battery, attic purple-monkey-dishwasher", None),
        ("laboratory correct-horse-battery, laboratory was lab", Some("attic")),
        ("laboratory correct-horse-battery, laboratory was attic", None),
    ] {
        let before = unreachable(&log).len();
        start(keys).kill();
        assert_eq!(unreachable(&log)[before..].first().map(String::as_str), told, "{keys}");
    }
}
