//! The uploaded file: taken from the body within limits, its format determined from the request or the content.

use axum::body::{Body, Bytes};
use axum::extract::multipart::MultipartError;
use axum::extract::{FromRequest, Multipart, Request};
use axum::http::header;
use futures_util::FutureExt;

use super::body::{IncomingBody, Received};
use super::memory::{Arrival, Reservation};
use super::problem::{Kind, Problem};
use super::service::Service;
use crate::cloud::reader::{self, Format};

/// Answer to an upload without a byte.
const EMPTY: &str = "the body is empty; send the file as the body, as in `curl -T scan.ply`";

/// Answer to a file that `curl -d` has sent.
const LINE_ENDS: &str = "the body has no line ends, as `curl -d @FILE` sends files; send it by `curl -T FILE` or \
    `curl --data-binary @FILE`";

/// Media types that say nothing about the format: defaults of HTTP clients.
const UNSPECIFIC: [&str; 9] = [
    "application/octet-stream",
    FORM,
    "text/plain",
    // The content decides the format of a packed file.
    "application/gzip",
    "application/x-gzip",
    "application/zip",
    "application/x-zip-compressed",
    "application/x-compressed",
    "application/x-npz",
];
/// What `curl -d` says that a file is.
const FORM: &str = "application/x-www-form-urlencoded";

/// A file as it arrived.
#[derive(Debug)]
pub(crate) struct Upload {
    /// Its bytes.
    pub bytes: Bytes,
    /// What it is called, if the client said.
    pub file_name: Option<String>,
    /// Format that its media type stands for, if it stands for one.
    declared: Option<Format>,
}

impl Upload {
    /// The file that a body is, or the first file part of a multipart body; beside it the memory for what it is parsed
    /// into.
    ///
    /// # Errors
    /// A problem: malformed, empty, of a media type that is not supported, or no memory for it.
    pub(crate) async fn receive(
        service: &Service,
        body: IncomingBody,
    ) -> Result<(Self, Reservation), Problem> {
        let media_type = body.parts().headers.get(header::CONTENT_TYPE);
        let media_type = media_type.map(|value| value.to_str().unwrap_or("?").to_owned());
        let essence = media_type.as_deref().map(essence);
        let has_parts = essence.as_deref() == Some("multipart/form-data");
        // Refused before a byte is read.
        let declared = if has_parts { None } else { declared_format(essence.as_deref())? };
        let Received { bytes, mut reservation } = body.receive(u64::MAX).await?;
        let upload = match media_type {
            Some(media_type) if has_parts => {
                service.pools.reading.run(move || Self::from_multipart(bytes, &media_type)).await??
            }
            _ => Self { bytes, file_name: None, declared },
        };
        if upload.bytes.is_empty() {
            return Err(Problem::new(Kind::MalformedRequest, EMPTY));
        }
        let may_lack_line_ends = essence.as_deref() == Some(FORM);
        let looked_at = upload.bytes.clone();
        let unpacked = service.pools.reading.run(move || {
            let lacks_line_ends = may_lack_line_ends && memchr::memchr2(b'\n', b'\r', &looked_at).is_none();
            if lacks_line_ends {
                return Err(Problem::new(Kind::MalformedRequest, LINE_ENDS));
            }
            Ok(reader::unpacked_bytes(&looked_at))
        });
        let unpacked = unpacked.await??;
        reservation.grow(Arrival { bytes: unpacked as u64, left: Some(0), is_slow: false }).await?;
        reservation.arrived(unpacked.max(upload.bytes.len()) as u64);
        Ok((upload, reservation))
    }

    /// All of a multipart body is there: nothing in it is waited for.
    fn from_multipart(bytes: Bytes, media_type: &str) -> Result<Self, Problem> {
        Self::first_file(bytes, media_type).now_or_never().unwrap_or_else(|| Err(cut_off()))
    }

    async fn first_file(bytes: Bytes, media_type: &str) -> Result<Self, Problem> {
        let request = Request::builder().header(header::CONTENT_TYPE, media_type).body(Body::from(bytes));
        let request = request.map_err(|error| Problem::internal(&error))?;
        let mut parts = Multipart::from_request(request, &()).await.map_err(|rejection| {
            Problem::new(
                Kind::MalformedRequest,
                format!("the multipart body cannot be read: {}", rejection.body_text()),
            )
        })?;
        while let Some(part) = parts.next_field().await.map_err(malformed)? {
            let Some(file_name) = part.file_name().map(str::to_owned) else { continue };
            let declared = declared_format(part.content_type().map(essence).as_deref())?;
            let bytes = part.bytes().await.map_err(malformed)?;
            return Ok(Self { bytes, file_name: Some(file_name), declared });
        }
        Err(Problem::new(
            Kind::MalformedRequest,
            "the multipart body has no file part; send one as in `curl -F file=@scan.ply`",
        ))
    }

    /// The format: `named`, else from the media type, else from the file name, else from the bytes. May unpack a compressed
    /// file: not for the threads that serve requests.
    ///
    /// # Errors
    /// A problem that names the formats.
    pub(crate) fn format(&self, named: Option<Format>) -> Result<Format, Problem> {
        named
            .or(self.declared)
            .or_else(|| Format::of_file(self.file_name.as_deref(), &self.bytes))
            .ok_or_else(|| match reader::foreign(&self.bytes) {
                Some(error) => unsupported(&error.to_string()),
                None => unsupported("the format cannot be determined"),
            })
    }
}

#[allow(clippy::needless_pass_by_value)] // the shape of `map_err`
fn malformed(error: MultipartError) -> Problem {
    Problem::new(Kind::MalformedRequest, format!("the multipart body cannot be read: {}", error.body_text()))
}

fn cut_off() -> Problem {
    Problem::new(Kind::MalformedRequest, "the multipart body ended before its last boundary")
}

/// What the media type of a file says of its format: nothing, a format, or something unsupported.
fn declared_format(essence: Option<&str>) -> Result<Option<Format>, Problem> {
    let Some(media_type) = essence.filter(|essence| !UNSPECIFIC.contains(essence)) else { return Ok(None) };
    let known = Format::from_media_type(media_type);
    known.map(Some).ok_or_else(|| unsupported(&format!("the media type `{media_type}` is not supported")))
}

fn essence(media_type: &str) -> String {
    media_type.split(';').next().unwrap_or_default().trim().to_ascii_lowercase()
}

fn unsupported(reason: &str) -> Problem {
    let names = Format::ALL.map(Format::name);
    Problem::new(
        Kind::UnsupportedFormat,
        format!("{reason}; accepted are {}; name one by ?format= or by Content-Type", names.join(", ")),
    )
    .with("accepted", names.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn form(file: &str) -> Bytes {
        format!(
            "--b\r\nContent-Disposition: form-data; name=\"comment\"\r\n\r\nhello\r\n\
             --b\r\nContent-Disposition: form-data; name=\"file\"; filename=\"scan.xyz\"\r\n\r\n{file}\r\n--b--\r\n"
        )
        .into()
    }

    #[test]
    fn the_first_file_of_a_form_is_taken_whatever_its_size() {
        for lines in [1, 10, 100_000] {
            let file = "1 2 3\n".repeat(lines);
            let upload = Upload::from_multipart(form(&file), "multipart/form-data; boundary=b").unwrap();
            assert_eq!(upload.bytes, file);
            assert_eq!(upload.file_name.as_deref(), Some("scan.xyz"));
        }
    }

    #[test]
    fn a_form_that_ends_anywhere_else_is_malformed() {
        let whole = form("1 2 3\n");
        // Without the line end behind it, the last boundary is still one.
        for end in 0..whole.len() - 4 {
            let refused = Upload::from_multipart(whole.slice(..end), "multipart/form-data; boundary=b");
            assert_eq!(refused.unwrap_err().kind(), Kind::MalformedRequest, "{end} bytes");
        }
    }
}
