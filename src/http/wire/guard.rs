//! Rejects requests from foreign web pages when no keys are set, and requests with an invalid `Host`.
//!
//! A browser sends requests for any page, also to loopback. Without keys nothing else tells them from the user's own:
//! a page may post without asking first, and by a name that resolves to loopback ("DNS rebinding") it may read too.

use std::net::IpAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Uri, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::problem::{Kind, Problem};
use super::retry;

/// Probes, which tell nothing of what is stored: they need no key, may come under any name, and find a place when all are
/// taken.
pub const PROBES: [&str; 2] = ["/livez", "/readyz"];
/// What proxies add to requests.
const FORWARDED: [HeaderName; 4] = [
    header::FORWARDED,
    HeaderName::from_static("x-forwarded-for"),
    HeaderName::from_static("x-forwarded-host"),
    HeaderName::from_static("x-real-ip"),
];
/// Where browsers say how the page is related to the service (<https://www.w3.org/TR/fetch-metadata/>).
const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

/// Marks a request for which the listener has no place: it is refused at once.
#[derive(Debug, Clone, Copy)]
pub struct NoPlace;

/// Names under which the service answers where no key is asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hosts {
    /// The address that is listened on.
    listen: IpAddr,
    /// Further names, in lower case, without ports; `*` is any.
    names: Vec<String>,
}

impl Hosts {
    /// Those of a service that listens on `listen`, and `names` beside them.
    #[must_use]
    pub fn new(listen: IpAddr, names: &[String]) -> Self {
        Self { listen, names: names.iter().map(|name| bare(name).to_ascii_lowercase()).collect() }
    }

    /// Whether a host, without its port, is one of these.
    fn has(&self, host: &str) -> bool {
        let host = bare(host).to_ascii_lowercase();
        let is_named = self.names.iter().any(|name| *name == "*" || *name == host);
        let is_address = host.parse::<IpAddr>().is_ok_and(|ip| {
            let ip = ip.to_canonical();
            // A page cannot be reached under an address and be of another origin: any will do where all are listened on.
            ip.is_loopback() || ip == self.listen.to_canonical() || self.listen.is_unspecified()
        });
        // Browsers resolve these themselves (RFC 6761 §6.3).
        is_named || is_address || host == "localhost" || host.ends_with(".localhost")
    }
}

/// A host without the brackets of an IPv6 address and without the dot at the end of a full name.
fn bare(host: &str) -> &str {
    let host = host.strip_suffix('.').unwrap_or(host);
    host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host)
}

/// What is let in.
#[derive(Debug, Clone)]
pub(crate) struct Guard {
    /// `None` where a key is asked for: browsers send none by themselves.
    hosts: Option<Hosts>,
    /// Origins of pages that may use the service; `*` is any.
    origins: Vec<HeaderValue>,
    warned: Arc<AtomicBool>,
}

impl Guard {
    pub(crate) fn new(hosts: Option<Hosts>, origins: Vec<HeaderValue>) -> Self {
        Self { hosts, origins, warned: Arc::default() }
    }

    /// # Errors
    /// The problem with which the request is refused.
    fn admit(&self, request: &Request) -> Result<(), Problem> {
        if request.extensions().get::<NoPlace>().is_some() {
            let told = "all connections are in use; try again in a moment";
            return Err(Problem::new(Kind::Unavailable, told)
                .with_header(header::RETRY_AFTER, retry::PLACE_SECONDS.to_string()));
        }
        let authority = authority(request)?;
        let Some(hosts) = &self.hosts else { return Ok(()) };
        self.warn_of_proxy(request.headers());
        if PROBES.contains(&request.uri().path()) {
            return Ok(());
        }
        if let Some(authority) = &authority
            && !hosts.has(authority.host())
        {
            return Err(Problem::new(
                Kind::HostNotAllowed,
                format!(
                    "`{}` is not a name of this service: without API keys it answers to localhost and to the address it \
                     listens on; allow further names with --allowed-hosts, or set --api-keys",
                    shown(authority.as_str())
                ),
            ));
        }
        let reads = [Method::GET, Method::HEAD, Method::OPTIONS].contains(request.method());
        if reads || self.is_from_own_page(request.headers(), authority.as_ref()) {
            return Ok(());
        }
        Err(Problem::new(
            Kind::OriginNotAllowed,
            "the request comes from a web page of another origin, which may not change anything here; allow its origin \
             with --cors-origins, or set --api-keys",
        ))
    }

    /// Whether no page sent the request, or one of this service or of an origin that is let in. Of a header that is there
    /// more than once, as something between may make it, every value counts.
    fn is_from_own_page(&self, headers: &HeaderMap, own: Option<&Authority>) -> bool {
        let let_in = |origin: &HeaderValue| {
            self.origins.iter().any(|known| known == "*" || known == origin)
                || own.is_some_and(|own| is_origin_of(origin, own))
        };
        if headers.contains_key(header::ORIGIN) {
            return headers.get_all(header::ORIGIN).iter().all(let_in);
        }
        // Browsers send the origin with all changes; this is for those that hide it.
        let any = self.origins.iter().any(|known| known == "*");
        headers.get_all(FETCH_SITE).iter().all(|site| any || site == "same-origin" || site == "none")
    }

    /// A proxy before a service without keys lets everybody in; the log says so once.
    fn warn_of_proxy(&self, headers: &HeaderMap) {
        let forwarded = FORWARDED.iter().any(|name| headers.contains_key(name));
        if forwarded && !self.warned.swap(true, Ordering::Relaxed) {
            tracing::warn!(
                "requests come through a proxy and no API keys are set: whoever reaches the proxy can read, change and \
                 delete everything; set --api-keys"
            );
        }
    }
}

/// Lets requests pass that may.
pub(crate) async fn admit(State(guard): State<Guard>, request: Request, next: Next) -> Response {
    match guard.admit(&request) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

/// The host that a request is for, as its target or its `Host` tells (RFC 9112 §3.2).
///
/// # Errors
/// `Host` is missing, there twice, or no host.
fn authority(request: &Request) -> Result<Option<Authority>, Problem> {
    let malformed = |told: String| Problem::new(Kind::MalformedRequest, told);
    let mut hosts = request.headers().get_all(header::HOST).iter();
    let (host, another) = (hosts.next(), hosts.next());
    if another.is_some() {
        return Err(malformed("the request has more than one Host header".to_owned()));
    }
    let named = host.map(|host| {
        let text = host.to_str().unwrap_or_default();
        let parsed = text.parse::<Authority>().ok().filter(|parsed| !parsed.as_str().contains('@'));
        parsed.ok_or_else(|| {
            malformed(format!("`{}` is not a host", shown(&String::from_utf8_lossy(host.as_bytes()))))
        })
    });
    let named = named.transpose()?;
    if named.is_none() && request.version() >= Version::HTTP_11 {
        return Err(malformed("the request has no Host header".to_owned()));
    }
    // A target with a host counts in place of the header.
    Ok(request.uri().authority().cloned().or(named))
}

/// Whether `origin`, as browsers send it, is the scheme and authority under which the request came.
fn is_origin_of(origin: &HeaderValue, own: &Authority) -> bool {
    let Some(origin) = origin.to_str().ok().and_then(|text| text.parse::<Uri>().ok()) else { return false };
    let (Some(scheme), Some(authority)) = (origin.scheme_str(), origin.authority()) else { return false };
    // TLS may end before the service: its scheme is that of the page.
    let default = if scheme == "https" { 443 } else { 80 };
    let port = |authority: &Authority| authority.port_u16().unwrap_or(default);
    authority.host().eq_ignore_ascii_case(own.host()) && port(authority) == port(own)
}

fn shown(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).take(80).collect()
}

#[cfg(test)]
mod tests {
    use axum::body::Body;

    use super::*;

    fn guard(listen: &str, names: &[&str], origins: &[&'static str]) -> Guard {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        let origins = origins.iter().map(|origin| HeaderValue::from_static(origin)).collect();
        Guard::new(Some(Hosts::new(listen.parse().unwrap(), &names)), origins)
    }

    /// `Ok` or the kind of the problem.
    fn admitted(guard: &Guard, method: &str, target: &str, headers: &[(&str, &str)]) -> Result<(), Kind> {
        let mut request = Request::builder().method(method).uri(target);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        guard.admit(&request.body(Body::empty()).unwrap()).map_err(|problem| problem.kind())
    }

    #[test]
    fn only_own_names_are_answered_to() {
        let loopback = guard("127.0.0.1", &["scans.lan"], &[]);
        let reads = |host: &str| admitted(&loopback, "GET", "/jobs", &[("host", host)]);
        for host in
            ["localhost", "localhost:8080", "LOCALHOST.", "a.localhost:1", "127.0.0.1:9000", "127.9.9.9"]
        {
            assert_eq!(reads(host), Ok(()), "{host}");
        }
        for host in ["[::1]:8080", "[::ffff:127.0.0.1]", "scans.lan", "Scans.Lan:80"] {
            assert_eq!(reads(host), Ok(()), "{host}");
        }
        for host in
            ["evil.example", "localhost.evil.example", "evil-localhost", "10.0.0.1", "0.0.0.0", "[fe80::1]"]
        {
            assert_eq!(reads(host), Err(Kind::HostNotAllowed), "{host}");
        }
        assert_eq!(admitted(&loopback, "GET", "/livez", &[("host", "10.1.2.3")]), Ok(()));
        let everywhere = guard("0.0.0.0", &[], &[]);
        assert_eq!(admitted(&everywhere, "GET", "/", &[("host", "10.0.0.1:8080")]), Ok(()));
        assert_eq!(admitted(&everywhere, "GET", "/", &[("host", "evil.example")]), Err(Kind::HostNotAllowed));
        let one = guard("10.0.0.1", &["*"], &[]);
        assert_eq!(admitted(&one, "GET", "/", &[("host", "any.example")]), Ok(()));
    }

    #[test]
    fn the_host_is_named_once() {
        let guard = guard("127.0.0.1", &[], &[]);
        let refused = Err(Kind::MalformedRequest);
        assert_eq!(admitted(&guard, "GET", "/", &[]), refused);
        assert_eq!(admitted(&guard, "GET", "/", &[("host", "localhost"), ("host", "localhost")]), refused);
        for host in ["", "a b", "me@localhost", "localhost/x"] {
            assert_eq!(admitted(&guard, "GET", "/", &[("host", host)]), refused, "{host}");
        }
        let absolute = admitted(&guard, "GET", "http://evil.example/", &[("host", "localhost")]);
        assert_eq!(absolute, Err(Kind::HostNotAllowed), "the target counts");
        let keyed = Guard::new(None, Vec::new());
        assert_eq!(admitted(&keyed, "GET", "/", &[("host", "evil.example")]), Ok(()));
        assert_eq!(admitted(&keyed, "GET", "/", &[]), refused, "with keys too");
    }

    #[test]
    fn pages_of_others_change_nothing() {
        let guard = guard("127.0.0.1", &[], &["https://viewer.example"]);
        let host = ("host", "localhost:8080");
        let changes =
            |headers: &[(&str, &str)]| admitted(&guard, "POST", "/clouds", &[&[host][..], headers].concat());
        for headers in [
            &[][..],
            &[("origin", "http://localhost:8080")],
            &[("origin", "https://viewer.example"), ("sec-fetch-site", "cross-site")],
            &[("sec-fetch-site", "none")],
            &[("sec-fetch-site", "same-origin")],
            &[("origin", "http://localhost:8080"), ("origin", "https://viewer.example")],
        ] {
            assert_eq!(changes(headers), Ok(()), "{headers:?}");
        }
        for headers in [
            &[("origin", "http://evil.example")][..],
            &[("origin", "null")],
            &[("origin", "http://localhost:3000"), ("sec-fetch-site", "same-site")],
            &[("origin", "https://viewer.example.evil.example")],
            &[("origin", "")],
            &[("sec-fetch-site", "cross-site")],
            &[("sec-fetch-site", "same-site")],
            &[("origin", "http://localhost:8080"), ("origin", "http://evil.example")],
            &[("sec-fetch-site", "none"), ("sec-fetch-site", "cross-site")],
        ] {
            assert_eq!(changes(headers), Err(Kind::OriginNotAllowed), "{headers:?}");
        }
        let evil = [host, ("origin", "http://evil.example")];
        for method in ["DELETE", "PUT", "PATCH"] {
            assert_eq!(admitted(&guard, method, "/jobs/1", &evil), Err(Kind::OriginNotAllowed));
        }
        for method in ["GET", "HEAD", "OPTIONS"] {
            assert_eq!(admitted(&guard, method, "/jobs", &evil), Ok(()), "{method}");
        }
    }
}
