//! Values of settings as people write them: addresses, sizes, origins.

use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs};
use std::str::FromStr;

use axum::http::{HeaderValue, Uri};
use bytesize::ByteSize;

/// More than any machine has use for; each takes memory.
const THREADS_MAX: usize = 1024;

/// An address to listen on: `127.0.0.1:8080`, `[::1]:8080`, `localhost:8080`; a port alone, `8080` or `:8080`, is one of
/// loopback.
///
/// # Errors
/// What is wrong with it, in words.
pub fn address(text: &str) -> Result<SocketAddr, String> {
    let text = text.trim();
    if let Ok(address) = text.parse() {
        return Ok(address);
    }
    let digits = text.strip_prefix(':').unwrap_or(text);
    if let Ok(port) = digits.parse::<u16>() {
        return Ok((Ipv4Addr::LOCALHOST, port).into());
    }
    let named = text.rsplit_once(':').filter(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok());
    if named.is_none() {
        return Err("not an address; 127.0.0.1:8080, localhost:8080 and 8080 are".to_owned());
    }
    let addresses: Vec<SocketAddr> =
        text.to_socket_addrs().map_err(|error| format!("the name cannot be resolved: {error}"))?.collect();
    let first = addresses.iter().find(|address| address.is_ipv4()).or(addresses.first());
    first.copied().ok_or_else(|| "the name has no address".to_owned())
}

/// A number of bytes: `1073741824`, `1G` or `1GB` (powers of 1000), `1GiB` or `1 GiB` (powers of 1024).
///
/// # Errors
/// What is wrong with it, in words.
pub fn bytes(text: &str) -> Result<u64, String> {
    let refuse = || "not a size; 1073741824, 500MB, 8G and 1GiB are".to_owned();
    let size = ByteSize::from_str(text.trim()).map_err(|_| refuse())?;
    Ok(size.as_u64())
}

/// A number of threads or of jobs at one time, 0 to 1,024.
///
/// # Errors
/// What is wrong with it, in words.
pub fn threads(text: &str) -> Result<usize, String> {
    text.trim()
        .parse()
        .ok()
        .filter(|count| *count <= THREADS_MAX)
        .ok_or_else(|| format!("expected a whole number from 0 to {THREADS_MAX}"))
}

/// An origin as browsers send it: scheme, host and port, without a path; or `*`.
///
/// # Errors
/// What is wrong with it, in words.
pub(super) fn origin(text: &str) -> Result<HeaderValue, String> {
    let refuse =
        || format!("`{text}` is not an origin; use scheme://host, such as https://viewer.example, or *");
    let is_origin = text == "*"
        || text.parse::<Uri>().is_ok_and(|uri| {
            let parts = (uri.scheme_str(), uri.authority());
            let (Some(scheme @ ("http" | "https")), Some(authority)) = parts else { return false };
            text.eq_ignore_ascii_case(&format!("{scheme}://{authority}")) && !authority.as_str().contains('@')
        });
    HeaderValue::from_str(text).ok().filter(|_| is_origin).ok_or_else(refuse)
}

/// A name under which the service may be asked for, without scheme and port; or `*`.
///
/// # Errors
/// What is wrong with it, in words.
pub(super) fn host(text: &str) -> Result<String, String> {
    let refuse = || {
        format!("`{text}` is not a host name; use one such as scans.example, without scheme and port, or *")
    };
    let is_host = !text.is_empty()
        && (text == "*" || text.chars().all(|c| c.is_ascii_alphanumeric() || ".-_:[]".contains(c)))
        && (text.matches(':').count() != 1);
    if is_host { Ok(text.to_owned()) } else { Err(refuse()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_may_be_a_name_or_a_port() {
        for (text, expected) in [
            ("127.0.0.1:8080", "127.0.0.1:8080"),
            ("0.0.0.0:80", "0.0.0.0:80"),
            ("[::1]:9", "[::1]:9"),
            ("8080", "127.0.0.1:8080"),
            (":8080", "127.0.0.1:8080"),
            (" 0 ", "127.0.0.1:0"),
        ] {
            assert_eq!(address(text), Ok(expected.parse().unwrap()), "{text}");
        }
        let local = address("localhost:8080").unwrap();
        assert!(local.ip().is_loopback() && local.port() == 8080, "{local}");
        for text in ["", "localhost", "a:b", "localhost:99999", ":", "http://localhost:80"] {
            assert!(address(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_size_may_have_a_unit() {
        for (text, expected) in [
            ("0", 0),
            ("1073741824", 1 << 30),
            ("1G", 1_000_000_000),
            ("8GB", 8_000_000_000),
            ("1 GiB", 1 << 30),
            ("1.5gib", 3 << 29),
            ("64k", 64_000),
            ("2MiB", 2 << 20),
        ] {
            assert_eq!(bytes(text), Ok(expected), "{text}");
        }
        for text in ["", "G", "-1", "1 X", "one", "1e9", "NaN"] {
            assert!(bytes(text).is_err(), "{text}");
        }
    }

    #[test]
    fn an_origin_has_a_scheme_and_a_host_and_no_path() {
        for accepted in ["*", "http://localhost:3000", "https://viewer.example", "http://[::1]:8080"] {
            assert!(origin(accepted).is_ok(), "{accepted}");
        }
        for refused in [
            "",
            "viewer.example",
            "https://",
            "https://viewer.example/",
            "https://a b",
            "ftp://a",
            "https://me@a",
        ] {
            assert!(origin(refused).is_err(), "{refused}");
        }
    }

    #[test]
    fn a_host_has_no_scheme_and_no_port() {
        for accepted in ["*", "scans.example", "scans", "10.0.0.1", "::1", "[::1]"] {
            assert!(host(accepted).is_ok(), "{accepted}");
        }
        for refused in ["", "http://scans.example", "scans.example:80", "a b", "a/b", "**"] {
            assert!(host(refused).is_err(), "{refused}");
        }
    }
}
