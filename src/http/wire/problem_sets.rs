//! Problems that requests of one kind may meet, declared once for the OpenAPI document.

use std::collections::BTreeMap;

use utoipa::IntoResponses;
use utoipa::openapi::response::ResponseBuilder;
use utoipa::openapi::{ContentBuilder, Ref, RefOr, Response, Schema};

use super::problem;

/// Declares sets of problems: for each status, when it is answered.
macro_rules! problem_sets {
    ($( $(#[$meta:meta])* $set:ident { $( $status:literal: $when:literal, )+ } )+) => { $(
        $(#[$meta])*
        pub(crate) struct $set;

        impl IntoResponses for $set {
            fn responses() -> BTreeMap<String, RefOr<Response>> {
                [ $( ($status.to_string(), described($when)) ),+ ].into()
            }
        }
    )+ };
}

problem_sets! {
    /// Of a query.
    QueryProblem {
        422: "A parameter is not accepted.",
    }

    /// Of what a path with the id of a cloud leads to.
    CloudProblems {
        404: "No such cloud.",
        422: "A parameter is not accepted.",
    }

    /// Of what a path with the id of a job leads to.
    JobProblems {
        404: "No such job.",
        422: "A parameter is not accepted.",
    }

    /// Of answers with bodies that take memory.
    AnswerProblems {
        406: "None of the formats is acceptable, or JSON would be too large.",
        503: "Not enough memory is free for the answer.",
    }

    /// Of a request for a part of an answer.
    RangeProblem {
        416: "The range is outside the result.",
    }

    /// Of a request for a job's result.
    ResultProblems {
        404: "No such job.",
        406: "None of the formats is acceptable, or JSON would be too large.",
        409: "The job has no such result yet, or will not have one.",
        422: "A parameter is not accepted.",
        503: "Not enough memory is free for the answer.",
    }

    /// Of a body of numbers.
    BodyProblems {
        400: "The body holds no numbers.",
        413: "The body is too large.",
    }

    /// Of an upload.
    UploadProblems {
        400: "Body or file malformed.",
        408: "The body stopped arriving.",
        413: "Over a limit.",
        415: "Format unknown.",
        422: "A parameter is not accepted, or the cloud cannot carry the analysis.",
        429: "The queue is full.",
    }

    /// Of a job's submission as JSON.
    SubmissionProblems {
        400: "The body is not valid JSON.",
        413: "The body is too large.",
        429: "The queue is full.",
    }
}

fn described(when: &str) -> RefOr<Response> {
    let schema = RefOr::<Schema>::Ref(Ref::from_schema_name("Problem"));
    let content = ContentBuilder::new().schema(Some(schema)).build();
    RefOr::T(ResponseBuilder::new().description(when).content(problem::MEDIA_TYPE, content).build())
}
