//! The uploaded file: taken from the body within limits, its format told from what came with it.

use axum::body::Bytes;
use axum::extract::multipart::MultipartError;
use axum::extract::{FromRequest, Multipart, Request};
use axum::http::header;
use futures_util::{Stream, StreamExt, TryStreamExt};

use super::problem::{Kind, Problem};
use crate::cloud::reader::Format;

/// What is told of an upload without a byte.
const EMPTY: &str = "the body is empty; send the file as the body, as in `curl -T scan.ply`";

/// Media types that say nothing about the format: what clients send when they were not told.
const UNSPECIFIC: [&str; 3] = ["application/octet-stream", "application/x-www-form-urlencoded", "text/plain"];

/// A file as it arrived.
#[derive(Debug)]
pub(crate) struct Upload {
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// What it is called, if the client said.
    pub file_name: Option<String>,
    /// Format that its media type stands for, if it stands for one.
    declared: Option<Format>,
}

impl Upload {
    /// Takes the file from the body, or from the first file part of a multipart body.
    ///
    /// # Errors
    /// A problem: malformed, empty, of a media type that is not supported.
    pub(crate) async fn receive(request: Request) -> Result<Self, Problem> {
        let media_type = request.headers().get(header::CONTENT_TYPE);
        let media_type = media_type.map(|value| value.to_str().unwrap_or("?").to_owned());
        if media_type.as_deref().is_some_and(|media_type| essence(media_type) == "multipart/form-data") {
            return Self::from_multipart(request).await;
        }
        let declared = declared_format(media_type.as_deref())?;
        let bytes = collect(EMPTY, request.into_body().into_data_stream().map_err(interrupted)).await?;
        Ok(Self { bytes, file_name: None, declared })
    }

    async fn from_multipart(request: Request) -> Result<Self, Problem> {
        let mut parts = Multipart::from_request(request, &()).await.map_err(|rejection| {
            Problem::new(
                Kind::MalformedRequest,
                format!("the multipart body cannot be read: {}", rejection.body_text()),
            )
        })?;
        while let Some(part) = parts.next_field().await.map_err(malformed)? {
            let Some(file_name) = part.file_name().map(str::to_owned) else { continue };
            let declared = declared_format(part.content_type())?;
            let bytes = collect(EMPTY, part.map_err(malformed)).await?;
            return Ok(Self { bytes, file_name: Some(file_name), declared });
        }
        Err(Problem::new(
            Kind::MalformedRequest,
            "the multipart body has no file part; send one as in `curl -F file=@scan.ply`",
        ))
    }

    /// The format: `named`, else from the media type, else from the file name, else from the bytes.
    ///
    /// # Errors
    /// A problem that names the formats.
    pub(crate) fn format(&self, named: Option<Format>) -> Result<Format, Problem> {
        let ending = self.file_name.as_deref().and_then(|name| name.rsplit_once('.'));
        named
            .or(self.declared)
            .or_else(|| ending.and_then(|(_, ending)| Format::from_extension(ending)))
            .or_else(|| Format::sniff(&self.bytes))
            .ok_or_else(|| unsupported("the format cannot be told from the file"))
    }
}

/// The whole body, whatever it is.
///
/// # Errors
/// A problem: cut off, empty.
pub(crate) async fn body(request: Request) -> Result<Vec<u8>, Problem> {
    collect(
        "the body is empty; send JSON or an npy file, as in `curl --data-binary @values.npy`",
        request.into_body().into_data_stream().map_err(interrupted),
    )
    .await
}

/// Gathers chunks, which `super::body` keeps within the limits. A body in one chunk is not copied.
async fn collect(
    empty: &str,
    mut chunks: impl Stream<Item = Result<Bytes, Problem>> + Unpin,
) -> Result<Vec<u8>, Problem> {
    let mut bytes = chunks.next().await.transpose()?.map(Vec::from).unwrap_or_default();
    while let Some(chunk) = chunks.next().await {
        bytes.extend_from_slice(&chunk?);
    }
    if bytes.is_empty() {
        return Err(Problem::new(Kind::MalformedRequest, empty));
    }
    Ok(bytes)
}

#[allow(clippy::needless_pass_by_value)] // the shape of `map_err`
fn malformed(error: MultipartError) -> Problem {
    Problem::new(Kind::MalformedRequest, format!("the multipart body cannot be read: {}", error.body_text()))
}

#[allow(clippy::needless_pass_by_value)] // the shape of `map_err`
fn interrupted(_: axum::Error) -> Problem {
    Problem::new(Kind::Interrupted, "the body ended before all of it had come")
}

/// What the media type of a file says of its format: nothing, a format, or something unsupported.
fn declared_format(media_type: Option<&str>) -> Result<Option<Format>, Problem> {
    let Some(media_type) = media_type.map(essence) else { return Ok(None) };
    if UNSPECIFIC.contains(&media_type.as_str()) {
        return Ok(None);
    }
    let known = Format::from_media_type(&media_type);
    known.map(Some).ok_or_else(|| unsupported(&format!("the media type `{media_type}` is not supported")))
}

fn essence(media_type: &str) -> String {
    media_type.split(';').next().unwrap_or_default().trim().to_ascii_lowercase()
}

fn unsupported(reason: &str) -> Problem {
    let names: Vec<_> = Format::ALL.iter().map(|format| format.name()).collect();
    Problem::new(
        Kind::UnsupportedFormat,
        format!("{reason}; accepted are {}, told by ?format= or by Content-Type", names.join(", ")),
    )
    .with("accepted", names)
}
