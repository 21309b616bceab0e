//! The viewer in a browser: its page, its files, and what a browser without scripts shows in its place.

use std::collections::HashMap;
use std::fmt::Write as _;

use axum::extract::{Path, Query};
use axum::http::{HeaderName, Uri, header};
use axum::response::{IntoResponse, Response};
use uuid::Uuid;

use crate::http::wire::problem::{Kind, Problem};
use crate::http::wire::service::Shared;
use crate::picture::Up;
use crate::store::{JobRecord, JobState, Owner};
use crate::viewer;

/// The page loads its own files and nothing else, runs no text, and stands in no other page.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' blob: data:; \
    worker-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'; require-trusted-types-for 'script'";
/// File addresses contain a digest, so their content never changes.
const FOR_EVER: &str = "public, max-age=31536000, immutable";
/// Jobs that the page without scripts lists.
const JOBS_LISTED: u32 = 30;
/// Degrees that its links turn and tilt by.
const TURN: f64 = 30.0;
const TILT: f64 = 15.0;

/// Headers of everything that a browser shows as part of the page.
const GUARDS: [(HeaderName, &str); 3] = [
    (header::CONTENT_SECURITY_POLICY, POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
];

/// The page. `owner` is whose jobs are shown to a browser without scripts; `None` where a key is asked for, which such a
/// browser cannot send.
pub(super) async fn page(service: &Shared, owner: Option<&Owner>, uri: &Uri) -> Result<Response, Problem> {
    let without_scripts = match owner {
        Some(owner) => pictures(service, owner, uri).await?,
        None => "<p>This page needs scripts: the service requires a key, which only scripts can send.</p>"
            .to_owned(),
    };
    let page = viewer::CURRENT.page(&format!("<noscript>{without_scripts}</noscript>"));
    let headers = [(header::CONTENT_TYPE, "text/html; charset=utf-8"), (header::CACHE_CONTROL, "no-cache")];
    Ok((headers, GUARDS, page).into_response())
}

/// A file of the page.
pub(crate) async fn file(Path((digest, name)): Path<(String, String)>) -> Result<Response, Problem> {
    let asset = viewer::CURRENT.asset(&digest, &name).ok_or_else(|| {
        Problem::new(
            Kind::NotFound,
            "the page has no such file; it may be one of another version: load the page again",
        )
    })?;
    let headers = [(header::CONTENT_TYPE, asset.media_type), (header::CACHE_CONTROL, FOR_EVER)];
    Ok((headers, GUARDS, asset.text.as_str()).into_response())
}

/// A view as the query has it, by the names that the page's own addresses use.
#[derive(Debug, Clone, Copy, PartialEq)]
struct View {
    job: Uuid,
    basis: usize,
    azimuth: f64,
    elevation: f64,
    up: Up,
}

impl View {
    /// What cannot be understood has its default; `None` without a job.
    fn read(uri: &Uri) -> Option<Self> {
        let Query(given) = Query::<HashMap<String, String>>::try_from_uri(uri).ok()?;
        let number = |name: &str, usual: f64, most: f64| {
            let value = given.get(name).and_then(|text| text.parse::<f64>().ok()).filter(|x| x.is_finite());
            value.unwrap_or(usual).clamp(-most, most)
        };
        Some(Self {
            job: given.get("job")?.parse().ok()?,
            basis: given.get("basis").and_then(|text| text.parse().ok()).unwrap_or(1),
            azimuth: number("azimuth", -60.0, 360.0),
            elevation: number("elevation", 20.0, 90.0),
            up: given.get("up").and_then(|name| name.parse().ok()).unwrap_or_default(),
        })
    }

    fn looked(&self) -> String {
        let up = format!("{:?}", self.up).to_ascii_lowercase();
        format!("azimuth={}&amp;elevation={}&amp;up={up}", self.azimuth, self.elevation)
    }

    fn link(&self, words: &str) -> String {
        format!("<a href=\"/?job={}&amp;basis={}&amp;{}\">{words}</a>", self.job, self.basis, self.looked())
    }
}

/// Pictures by the service with links to the views beside them; without a job, the last ones.
async fn pictures(service: &Shared, owner: &Owner, uri: &Uri) -> Result<String, Problem> {
    if let Some(view) = View::read(uri)
        && service.store.owns(owner, view.job).await?
        && let Ok(job) = service.store.job(view.job).await
    {
        return Ok(picture(view, &job));
    }
    let last = service.store.jobs(owner, Some(JobState::Succeeded), None, None, JOBS_LISTED).await?.items;
    let mut html = String::from(
        "<h2>Without scripts</h2><p>Pictures by the service, and plain links. Upload with curl.</p><ul>",
    );
    for job in &last {
        // Writing to a string cannot fail.
        let _ = write!(html, "<li><a href=\"/?job={0}\">job {0}</a>", job.id);
    }
    Ok(html + "</ul>")
}

fn picture(view: View, job: &JobRecord) -> String {
    let bases = job
        .report
        .as_ref()
        .and_then(|report| report.spectrum.as_ref())
        .map_or(0, |spectrum| spectrum.eigenvalues.len());
    if bases == 0 {
        return format!("<h2>Job {}</h2><p>It is {} and has no modes to show.</p>", job.id, job.state.name());
    }
    let view = View { basis: view.basis.min(bases - 1), ..view };
    let beside = [
        (View { azimuth: (view.azimuth - TURN + 180.0).rem_euclid(360.0) - 180.0, ..view }, "turn left"),
        (View { azimuth: (view.azimuth + TURN + 180.0).rem_euclid(360.0) - 180.0, ..view }, "turn right"),
        (View { elevation: (view.elevation + TILT).min(90.0), ..view }, "from above"),
        (View { elevation: (view.elevation - TILT).max(-90.0), ..view }, "from below"),
        (View { basis: view.basis.saturating_sub(1), ..view }, "previous mode"),
        (View { basis: (view.basis + 1).min(bases - 1), ..view }, "next mode"),
    ];
    let links: Vec<String> = beside.iter().map(|(view, words)| view.link(words)).collect();
    format!(
        "<h2>Mode {basis} of job {job}</h2><p><img src=\"/jobs/{job}/bases/{basis}/image.png?{}\" width=\"800\" height=\"600\" \
         alt=\"The cloud, colored by mode {basis}\"><p>{}<p><a href=\"/jobs/{job}/spectrum?format=svg\">spectrum</a> · <a href=\"/\">all jobs</a>",
        view.looked(),
        links.join(" · "),
        basis = view.basis,
        job = view.job,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_view_is_read_from_the_query_and_what_it_cannot_mean_has_its_default() {
        let job = Uuid::now_v7();
        let read = |query: &str| View::read(&format!("/?{query}").parse().unwrap());
        let view = read(&format!("job={job}&basis=7&azimuth=-400&elevation=x&up=y")).unwrap();
        assert_eq!(view, View { job, basis: 7, azimuth: -360.0, elevation: 20.0, up: Up::Y });
        assert_eq!(read("job=%3Cscript%3E"), None);
        assert_eq!(read(""), None);
    }
}
