//! Which compression a client wants its answer in.

use axum::http::{HeaderMap, header};

use crate::arguments::words;

words! {
    /// A compression of answers, as `Content-Encoding` says it.
    pub(crate) enum Compression {
        /// RFC 8878.
        Zstd,
        /// RFC 1952.
        Gzip,
    }
}

impl Compression {
    /// The one that the client likes best, zstd of equals; `None` where it prefers the bytes as they are, or says nothing
    /// (RFC 9110 §12.5.3).
    pub(crate) fn accepted(headers: &HeaderMap) -> Option<Self> {
        let values = headers.get_all(header::ACCEPT_ENCODING);
        let accepted: Vec<(String, f32)> = values
            .iter()
            .filter_map(|value| value.to_str().ok())
            .flat_map(|value| value.split(','))
            .map(weighted)
            .collect();
        let weight = |names: &[&str]| {
            let named = accepted.iter().find(|(name, _)| names.contains(&name.as_str()));
            named.or_else(|| accepted.iter().find(|(name, _)| name == "*")).map(|(_, weight)| *weight)
        };
        let identity = accepted.iter().find(|(name, _)| name == "identity").map_or(0.0, |(_, q)| *q);
        let (zstd, gzip) = (weight(&["zstd"]).unwrap_or(0.0), weight(&["gzip", "x-gzip"]).unwrap_or(0.0));
        let (best, choice) = if gzip > zstd { (gzip, Self::Gzip) } else { (zstd, Self::Zstd) };
        (best > 0.0 && best >= identity).then_some(choice)
    }
}

/// The name of a coding, and its weight.
fn weighted(coding: &str) -> (String, f32) {
    let mut parts = coding.split(';').map(str::trim);
    let name = parts.next().unwrap_or_default().to_ascii_lowercase();
    let weight = parts.find_map(|part| part.strip_prefix(['q', 'Q'])?.trim_start().strip_prefix('='));
    (name, weight.map_or(1.0, |weight| weight.trim().parse().unwrap_or(0.0)))
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn accepted(value: &'static str) -> Option<Compression> {
        let headers = HeaderMap::from_iter([(header::ACCEPT_ENCODING, HeaderValue::from_static(value))]);
        Compression::accepted(&headers)
    }

    #[test]
    fn the_client_chooses_and_zstd_goes_before_gzip_among_equals() {
        use Compression::{Gzip, Zstd};
        assert_eq!(accepted("gzip, deflate, br, zstd"), Some(Zstd));
        assert_eq!(accepted("gzip;q=1.0, zstd;q=0.5"), Some(Gzip));
        assert_eq!(accepted("x-gzip"), Some(Gzip));
        assert_eq!(accepted("*"), Some(Zstd));
        assert_eq!(accepted("*, zstd;q=0"), Some(Gzip));
        assert_eq!(accepted("GZIP; Q = 0.5"), Some(Gzip));
        assert_eq!(accepted("identity, gzip;q=0.5"), None);
        assert_eq!(accepted("gzip;q=0, br"), None);
        assert_eq!(accepted(""), None);
        assert_eq!(Compression::accepted(&HeaderMap::new()), None);
    }
}
