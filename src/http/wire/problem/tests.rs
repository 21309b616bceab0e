//! Problems: their names, and what they keep to themselves.

use std::collections::HashSet;

use super::*;

#[test]
fn every_kind_has_its_own_name_and_an_error_status() {
    let names: HashSet<_> = Kind::ALL.iter().map(|kind| kind.name()).collect();
    assert_eq!(names.len(), Kind::ALL.len());
    for kind in Kind::ALL {
        assert!(kind.status().is_client_error() || kind.status().is_server_error(), "{}", kind.name());
    }
}

#[test]
fn the_text_of_a_database_error_stays_inside() {
    let problem = Problem::from(StoreError::Database("disk I/O error at /secret".into()));
    assert_eq!(problem.kind(), Kind::Internal);
    assert!(!serde_json::to_string(&problem.document(None, None)).unwrap().contains("secret"));
}

#[test]
fn members_stand_beside_the_standard_ones() {
    let problem = Problem::new(Kind::NotFinished, "wait").with("state", "running");
    let json = serde_json::to_value(problem.document(Some("/x".into()), Some("id".into()))).unwrap();
    assert_eq!(json["type"], "/problems/not-finished");
    assert_eq!(json["status"], 409);
    assert_eq!(json["state"], "running");
    assert_eq!(json["request_id"], "id");
}
