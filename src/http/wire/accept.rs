//! Content negotiation: `?format=` first, then `Accept` with its q-values.
//!
//! Ours, since crates for it choose among media types: here a format has several, a name in queries, and an ending.

use axum::http::{HeaderMap, HeaderName, header};

use super::problem::{Kind, Problem};
use crate::cloud::reader::Format;

/// A representation on offer: its name in `?format=`, and its media types, the first of which is answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Offer {
    /// As in `?format=` and in file names.
    pub name: &'static str,
    /// Media types that ask for it.
    pub media_types: &'static [&'static str],
}

const fn cloud(format: Format) -> Offer {
    Offer { name: format.name(), media_types: format.media_types() }
}

/// JSON.
pub(crate) const JSON: Offer = Offer { name: "json", media_types: &["application/json"] };
/// NumPy array file.
pub(crate) const NPY: Offer = cloud(Format::Npy);
/// PLY, the points with further properties.
pub(crate) const PLY: Offer = cloud(Format::Ply);
/// Comma-separated values.
pub(crate) const CSV: Offer = cloud(Format::Csv);
/// Text, a point per line.
pub(crate) const XYZ: Offer = cloud(Format::Xyz);
/// ASPRS LAS.
pub(crate) const LAS: Offer = cloud(Format::Las);
/// LAS compressed by `LASzip`.
pub(crate) const LAZ: Offer = cloud(Format::Laz);
/// Wavefront OBJ.
pub(crate) const OBJ: Offer = cloud(Format::Obj);
/// Object file format of Geomview.
pub(crate) const OFF: Offer = cloud(Format::Off);
/// Triangles of stereolithography.
pub(crate) const STL: Offer = cloud(Format::Stl);
/// Point Cloud Library.
pub(crate) const PCD: Offer = cloud(Format::Pcd);
/// Matrix Market.
pub(crate) const MTX: Offer =
    Offer { name: "mtx", media_types: &["text/x-matrix-market", "application/x-matrix-market"] };
/// Archive of NumPy arrays.
pub(crate) const NPZ: Offer = Offer { name: "npz", media_types: &["application/x-npz", "application/zip"] };
/// A picture.
pub(crate) const PNG: Offer = Offer { name: "png", media_types: &["image/png"] };
/// A page.
pub(crate) const HTML: Offer = Offer { name: "html", media_types: &["text/html"] };
/// A plot.
pub(crate) const SVG: Offer = Offer { name: "svg", media_types: &["image/svg+xml"] };

impl Offer {
    /// The media type of the answer.
    #[must_use]
    pub(crate) fn media_type(&self) -> &'static str {
        self.media_types[0]
    }
}

/// The offer to answer with: the one named, or the one that `Accept` weighs highest; the first on a tie.
///
/// # Errors
/// A problem that lists the offers.
pub(crate) fn choose(named: Option<Offer>, headers: &HeaderMap, offers: &[Offer]) -> Result<Offer, Problem> {
    if let Some(named) = named {
        return Ok(named);
    }
    let accepted = weighted(headers, &header::ACCEPT);
    if accepted.is_empty() {
        return Ok(offers[0]);
    }
    let mut best: Option<(f32, Offer)> = None;
    for offer in offers {
        let weight = offer.media_types.iter().map(|media| weight(&accepted, media)).fold(0.0, f32::max);
        if weight > best.map_or(0.0, |(weight, _)| weight) {
            best = Some((weight, *offer));
        }
    }
    best.map(|(_, offer)| offer).ok_or_else(|| refuse(headers, offers))
}

fn refuse(headers: &HeaderMap, offers: &[Offer]) -> Problem {
    let wishes: Vec<_> =
        headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
    let shown: String = wishes.join(",").chars().take(120).collect();
    let names: Vec<_> =
        offers.iter().map(|offer| format!("{} ({})", offer.name, offer.media_type())).collect();
    Problem::new(
        Kind::NotAcceptable,
        format!("`{shown}` is not offered here; offered are {}", names.join(", ")),
    )
    .with("accepted", offers.iter().map(|offer| offer.name).collect::<Vec<_>>())
}

/// The names in a header's list, in lower case, each with its q-value (RFC 9110 §12.4.2).
pub(crate) fn weighted(headers: &HeaderMap, name: &HeaderName) -> Vec<(String, f32)> {
    let values = headers.get_all(name).iter().filter_map(|value| value.to_str().ok());
    let named = values.flat_map(|value| value.split(',')).map(|entry| {
        let mut parts = entry.split(';').map(str::trim);
        let name = parts.next().unwrap_or_default().to_ascii_lowercase();
        // Names of parameters are the same in either case.
        let q = parts.find_map(|part| part.strip_prefix(['q', 'Q'])?.trim_start().strip_prefix('='));
        (name, q.map_or(1.0, |q| q.trim().parse().unwrap_or(0.0)))
    });
    named.filter(|(name, _)| !name.is_empty()).collect()
}

/// The q-value of `media`, by the most specific range that matches it (RFC 9110 §12.5.1).
fn weight(accepted: &[(String, f32)], media: &str) -> f32 {
    let kind = media.split('/').next().unwrap_or_default();
    let mut found = (0_u8, 0.0);
    for (name, q) in accepted {
        let specificity = match name.as_str() {
            "*/*" => 1,
            name if name.strip_suffix("/*") == Some(kind) => 2,
            name if name == media => 3,
            _ => continue,
        };
        if specificity > found.0 {
            found = (specificity, *q);
        }
    }
    found.1
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    const OFFERS: [Offer; 3] = [JSON, NPY, PLY];

    fn chosen(accept: &'static str) -> Option<&'static str> {
        let headers = HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_static(accept))]);
        choose(None, &headers, &OFFERS).ok().map(|offer| offer.name)
    }

    #[test]
    fn the_first_offer_answers_who_takes_anything() {
        assert_eq!(choose(None, &HeaderMap::new(), &OFFERS).unwrap(), JSON);
        assert_eq!(chosen("*/*"), Some("json"));
    }

    #[test]
    fn the_highest_weight_wins_and_zero_excludes() {
        assert_eq!(chosen("application/json;q=0.5, application/x-npy"), Some("npy"));
        assert_eq!(chosen("model/ply, application/json;q=0.9"), Some("ply"));
        assert_eq!(chosen("*/*, application/json;q=0"), Some("npy"));
        assert_eq!(chosen("model/*"), Some("ply"));
        assert_eq!(chosen("application/json;Q=0.2, application/x-npy;q=0.3"), Some("npy"));
    }

    #[test]
    fn nothing_acceptable_is_refused() {
        assert_eq!(chosen("image/png"), None);
        assert_eq!(chosen("application/json;q=0"), None);
    }

    #[test]
    fn a_name_goes_before_the_header() {
        let headers = HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_static("application/json"))]);
        assert_eq!(choose(Some(NPY), &headers, &OFFERS).unwrap(), NPY);
    }
}
