//! Rows of the database as records.

use uuid::Uuid;

use super::arrays::{Checksum, text_checksum};
pub(super) use super::columns::{from_word, hex, integer, json, to_json, word};
use super::connection::{Connection, Row};
use super::line::place;
use super::records::{CloudRecord, JobRecord};
use super::{CHUNK_POINTS, JobFailure, JobState, Owner, StoreError};
use crate::analysis::{JobKind, Parameters};
use crate::progress::Phase;

/// Columns and tables from which [`job_record`] reads, with an expression for the report, to be followed by a condition
/// on `j`. `before` counts jobs of the same owner; [`super::line::place`] makes a place in the whole queue of it.
macro_rules! select_jobs {
    ($report:literal, $checksum:literal) => {
        concat!(
            "SELECT j.id, j.owner, j.cloud_id, j.created, j.kind, j.parameters, j.state, j.phase, j.progress, j.phase_seconds, \
             j.memory, j.chunk_points, j.attempt, j.cancel_requested, j.started, j.finished, j.failure, c.points, c.name AS cloud_name, ",
            $checksum,
            " AS report_checksum, ",
            $report,
            " AS report, CASE j.state WHEN 'queued' THEN \
             (SELECT count(*) FROM jobs q WHERE q.state = 'queued' AND q.owner = j.owner AND q.id < j.id) END AS before \
             FROM jobs j JOIN clouds c ON c.id = j.cloud_id "
        )
    };
    () => {
        $crate::store::rows::select_jobs!("j.report", "j.report_checksum")
    };
}
pub(super) use select_jobs;

pub(super) async fn job_with_id(connection: &mut Connection, id: Uuid) -> Result<JobRecord, StoreError> {
    let row = connection.query(concat!(select_jobs!(), "WHERE j.id = $1")).bind(id).fetch_optional().await?;
    let mut job = readable_job(&row.ok_or(StoreError::NotFound)?)?;
    place(connection, std::slice::from_mut(&mut job)).await?;
    Ok(job)
}

/// The job in a row; one that cannot be read, as after a return to an older version, is shown as failed.
pub(super) fn readable_job(row: &Row) -> Result<JobRecord, StoreError> {
    match job_record(row) {
        Err(StoreError::Damaged(cause)) => unreadable_job(row, &cause),
        other => other,
    }
}

/// What the owner of a job is told whose row cannot be read.
pub(super) fn unreadable(cause: &str) -> JobFailure {
    JobFailure {
        code: "internal".to_owned(),
        detail: format!(
            "the record of the job cannot be read, it is damaged or of another version of the service: {cause}"
        ),
    }
}

fn unreadable_job(row: &Row, cause: &str) -> Result<JobRecord, StoreError> {
    Ok(JobRecord {
        id: row.try_get("id")?,
        owner: Owner::named(row.try_get("owner")?),
        cloud_id: row.try_get("cloud_id")?,
        cloud_name: row.try_get("cloud_name")?,
        points: count(row, "points")?,
        kind: from_word(row.try_get("kind")?).unwrap_or(JobKind::Eigen),
        state: JobState::Failed,
        phase: None,
        progress: 0.0,
        memory: 0,
        chunk_points: CHUNK_POINTS,
        attempt: count(row, "attempt").unwrap_or(0) as u32,
        cancel_requested: flag(row, "cancel_requested")?,
        queue_position: None,
        created: row.try_get("created")?,
        started: row.try_get("started")?,
        finished: row.try_get("finished")?,
        phase_seconds: Vec::new(),
        parameters: Parameters::default(),
        report: None,
        failure: Some(unreadable(cause)),
    })
}

pub(super) async fn cloud_with_id(connection: &mut Connection, id: Uuid) -> Result<CloudRecord, StoreError> {
    let row = connection.query("SELECT * FROM clouds WHERE id = $1").bind(id).fetch_optional().await?;
    cloud_record(&row.ok_or(StoreError::NotFound)?)
}

pub(super) fn cloud_record(row: &Row) -> Result<CloudRecord, StoreError> {
    let record = CloudRecord {
        id: row.try_get("id")?,
        owner: Owner::named(row.try_get("owner")?),
        name: row.try_get("name")?,
        created: row.try_get("created")?,
        digest: hex(row.try_get("digest")?),
        points: count(row, "points")?,
        dimension: count(row, "dimension")? as usize,
        nonfinite: count(row, "nonfinite")?,
        duplicates: count(row, "duplicates")?,
        examined: row.try_get::<Option<&str>, _>("examined")?.map(json).transpose()?,
        bounding_box: json(row.try_get("bounding_box")?)?,
        coordinate_type: from_word(row.try_get("coordinate_type")?)?,
        grids: row.try_get::<Option<&str>, _>("grids")?.map(json).transpose()?,
        origin: row.try_get::<Option<&str>, _>("origin")?.map(json).transpose()?.unwrap_or_default(),
        fields: json(row.try_get("fields")?)?,
        faces: count(row, "faces")?,
    };
    let checksum: Option<&[u8]> = row.try_get("checksum")?;
    if checksum.is_some_and(|checksum| cloud_checksum(&record).map_or(true, |own| own.as_slice() != checksum))
    {
        return Err(StoreError::Damaged(format!(
            "the description of cloud {} does not match its checksum",
            record.id
        )));
    }
    Ok(record)
}

/// Checksum of everything that describes a cloud and is not one of its arrays.
pub(super) fn cloud_checksum(cloud: &CloudRecord) -> Result<Checksum, StoreError> {
    let counts = [cloud.points, cloud.dimension as u64, cloud.nonfinite, cloud.duplicates, cloud.faces];
    Ok(text_checksum(&[
        &cloud.digest,
        &to_json(&counts)?,
        &to_json(&cloud.bounding_box)?,
        &to_json(&(cloud.coordinate_type, cloud.grids, &cloud.fields))?,
    ]))
}

pub(super) fn job_record(row: &Row) -> Result<JobRecord, StoreError> {
    let state: JobState = from_word(row.try_get("state")?)?;
    let phase: Option<&str> = row.try_get("phase")?;
    let phase: Option<Phase> = phase.map(from_word).transpose()?;
    let before: Option<i64> = row.try_get("before")?;
    let report: Option<&str> = row.try_get("report")?;
    check_report(row, report)?;
    let failure: Option<&str> = row.try_get("failure")?;
    Ok(JobRecord {
        id: row.try_get("id")?,
        owner: Owner::named(row.try_get("owner")?),
        cloud_id: row.try_get("cloud_id")?,
        cloud_name: row.try_get("cloud_name")?,
        points: count(row, "points")?,
        kind: from_word(row.try_get("kind")?)?,
        state,
        phase,
        progress: row.try_get("progress")?,
        memory: count(row, "memory")?,
        chunk_points: count(row, "chunk_points")? as usize,
        attempt: count(row, "attempt")? as u32,
        cancel_requested: flag(row, "cancel_requested")?,
        queue_position: before.map(|jobs| jobs as u64),
        created: row.try_get("created")?,
        started: row.try_get("started")?,
        finished: row.try_get("finished")?,
        phase_seconds: json(row.try_get("phase_seconds")?)?,
        parameters: json(row.try_get("parameters")?)?,
        report: report.map(json).transpose()?,
        failure: failure.map(json).transpose()?,
    })
}

/// Refuses a report whose text is not the one that was stored. Listings select a part of it, without the checksum.
fn check_report(row: &Row, report: Option<&str>) -> Result<(), StoreError> {
    let checksum: Option<&[u8]> = row.try_get("report_checksum")?;
    match (checksum, report) {
        (Some(checksum), Some(report)) if text_checksum(&[report]).as_slice() != checksum => {
            Err(StoreError::Damaged("the report does not match its checksum".to_owned()))
        }
        _ => Ok(()),
    }
}

/// A column that says yes, as 1, or no, as 0.
pub(super) fn flag(row: &Row, column: &'static str) -> Result<bool, StoreError> {
    Ok(row.try_get::<i64, _>(column)? != 0)
}

/// A column that counts something.
pub(super) fn count(row: &Row, column: &'static str) -> Result<u64, StoreError> {
    let number: i64 = row.try_get(column)?;
    u64::try_from(number).map_err(|_| StoreError::Damaged(format!("`{column}` is {number}")))
}
