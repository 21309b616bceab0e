//! Paths and methods that there are, for those who ask for others.

use axum::http::Method;
use serde_json::Value;

/// Edits that make a misspelt word of a known one, at most; in words of four letters and fewer, one.
const EDITS_MAX: usize = 2;
/// Suggestions that are made, at most.
const SUGGESTED: usize = 12;

/// Beginnings that other services have.
const PREFIXES: [&str; 4] = ["api", "rest", "v1", "v2"];
/// What other services call what there is here, in lower case.
const ELSEWHERE: [(&[&str], &[&str]); 5] = [
    (&["health", "healthz", "healthcheck", "ping", "status"], &["/livez", "/readyz"]),
    (&["liveness"], &["/livez"]),
    (&["readiness"], &["/readyz"]),
    (&["openapi", "swagger.json", "swagger.yaml", "openapi.yml"], &["/openapi.json", "/openapi.yaml"]),
    (&["", "swagger", "swagger-ui", "redoc", "api-docs", "help"], &["/docs", "/openapi.json"]),
];

/// Every path of the interface, and its methods.
#[derive(Debug)]
pub(crate) struct Paths(Vec<Template>);

/// A path whose parts in braces stand for anything.
#[derive(Debug)]
struct Template {
    parts: Vec<String>,
    methods: Vec<String>,
}

impl Paths {
    /// Those of an OpenAPI document.
    pub(crate) fn of(document: &Value) -> Self {
        let paths = document["paths"].as_object().into_iter().flatten();
        let template = |(path, item): (&String, &Value)| {
            let keys = item.as_object().into_iter().flat_map(serde_json::Map::keys);
            let methods = keys.map(|key| key.to_ascii_uppercase()).filter(|name| is_method(name));
            Template { parts: parts(path).map(str::to_owned).collect(), methods: methods.collect() }
        };
        Self(paths.map(template).collect())
    }

    /// Methods of a path; `HEAD` wherever there is `GET`.
    pub(crate) fn methods(&self, path: &str) -> Vec<&str> {
        let parts: Vec<&str> = parts(path).collect();
        let mut methods: Vec<&str> = self
            .0
            .iter()
            .filter(|template| template.distance(&parts) == Some(0))
            .flat_map(|template| template.methods.iter().map(String::as_str))
            .collect();
        if methods.contains(&"GET") {
            methods.push("HEAD");
        }
        methods.sort_unstable();
        methods.dedup();
        methods
    }

    /// What may have been meant by a path that there is not: what other services would have there, those that differ by a
    /// slip, else those below and above it.
    pub(crate) fn near(&self, path: &str) -> Vec<String> {
        let parts: Vec<&str> = parts(path).collect();
        if parts.is_empty() {
            return Vec::new();
        }
        let parts: Vec<&str> =
            parts.into_iter().skip_while(|part| PREFIXES.contains(&part.to_lowercase().as_str())).collect();
        let known =
            ELSEWHERE.iter().find(|(names, _)| names.contains(&parts.join("/").to_lowercase().as_str()));
        if let Some((_, own)) = known {
            return own.iter().map(|&path| path.to_owned()).collect();
        }
        let mut slips: Vec<_> = self
            .0
            .iter()
            .filter_map(|template| Some((template.distance(&parts)?, template.filled(&parts))))
            .collect();
        slips.sort();
        if let Some(&(least, _)) = slips.first() {
            let nearest = slips.into_iter().take_while(|(distance, _)| *distance == least);
            return nearest.map(|(_, path)| path).take(SUGGESTED).collect();
        }
        let below = self.0.iter().filter(|template| {
            template.parts.get(..parts.len()).is_some_and(|start| distance(start, &parts) == Some(0))
        });
        let mut found: Vec<String> = below.map(|template| template.filled(&parts)).collect();
        // Longer than all there are: what is at its start, beside what is there.
        let above = parts.get(..2).filter(|_| found.is_empty());
        if let Some(start) = above {
            let beside = self.0.iter().filter(|template| {
                template.parts.get(..2).is_some_and(|first| distance(first, start) == Some(0))
            });
            found = beside.map(|template| template.filled(start)).collect();
        }
        found.truncate(SUGGESTED);
        found
    }
}

impl Template {
    /// Edits between this and a path of as many parts; `None` when it is another path.
    fn distance(&self, parts: &[&str]) -> Option<usize> {
        (self.parts.len() == parts.len()).then(|| distance(&self.parts, parts)).flatten()
    }

    /// The path with the given parts in place of its first braces.
    fn filled(&self, given: &[&str]) -> String {
        let fill = |(at, part): (usize, &String)| match given.get(at) {
            Some(given) if part.contains('{') => format!("/{given}"),
            _ => format!("/{part}"),
        };
        self.parts.iter().enumerate().map(fill).collect()
    }
}

fn distance(template: &[String], parts: &[&str]) -> Option<usize> {
    let edits = |(known, given): (&String, &&str)| {
        if known.contains('{') {
            return Some(0);
        }
        let edits = strsim::levenshtein(known, &given.to_lowercase());
        let edits_max = if known.len() <= 4 { 1 } else { EDITS_MAX };
        (edits <= edits_max).then_some(edits)
    };
    template.iter().zip(parts).map(edits).sum()
}

fn parts(path: &str) -> impl Iterator<Item = &str> {
    path.split('/').filter(|part| !part.is_empty())
}

fn is_method(name: &str) -> bool {
    [Method::GET, Method::PUT, Method::POST, Method::DELETE, Method::PATCH]
        .iter()
        .any(|method| method == name)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn paths() -> Paths {
        Paths::of(&json!({ "paths": {
            "/": { "get": {} },
            "/docs": { "get": {} },
            "/clouds": { "get": {}, "post": {}, "put": {} },
            "/clouds/{id}": { "get": {}, "delete": {}, "parameters": [] },
            "/jobs/{id}": { "get": {}, "delete": {} },
            "/jobs/{id}/cancel": { "post": {} },
            "/jobs/{id}/bases": { "get": {} },
            "/jobs/{id}/bases/{basis}/image.png": { "get": {} },
        } }))
    }

    #[test]
    fn a_slip_is_mended() {
        let near = |path: &str| paths().near(path);
        assert_eq!(near("/job/17"), ["/jobs/17"]);
        assert_eq!(near("/jobs/17/"), ["/jobs/17"]);
        assert_eq!(near("/docs/"), ["/docs"]);
        assert_eq!(near("//docs"), ["/docs"]);
        assert_eq!(near("/jobs/17/basis"), ["/jobs/17/bases"]);
        assert_eq!(near("/jobs/17/cancle"), ["/jobs/17/cancel"]);
        assert_eq!(near("/Jobs/17"), ["/jobs/17"]);
        assert_eq!(near("/API/V1/jobs/17"), ["/jobs/17"]);
    }

    #[test]
    fn what_other_services_have_is_named_as_it_is_called_here() {
        let near = |path: &str| paths().near(path);
        for path in ["/healthz", "/health", "/api/health", "/Health/"] {
            assert_eq!(near(path), ["/livez", "/readyz"], "{path}");
        }
        for path in ["/api", "/v1/", "/swagger", "/api/v1/redoc"] {
            assert_eq!(near(path), ["/docs", "/openapi.json"], "{path}");
        }
        assert_eq!(near("/openapi"), ["/openapi.json", "/openapi.yaml"]);
        assert_eq!(near("/api/v1/clouds"), ["/clouds"]);
        assert_eq!(near("/v1/jobs/17/basis"), ["/jobs/17/bases"]);
    }

    #[test]
    fn what_is_below_or_beside_is_named() {
        let near = |path: &str| paths().near(path);
        assert_eq!(near("/jobs/17/bases/4"), ["/jobs/17/bases/4/image.png"]);
        let beside = near("/jobs/17/nothing/4/5/6");
        assert!(
            beside.contains(&"/jobs/17/cancel".to_owned()) && !beside.contains(&"/docs".to_owned()),
            "{beside:?}"
        );
        assert!(near("/elsewhere").is_empty() && near("/").is_empty());
    }

    #[test]
    fn methods_are_those_of_the_path() {
        assert_eq!(paths().methods("/clouds"), ["GET", "HEAD", "POST", "PUT"]);
        assert_eq!(paths().methods("/jobs/17/cancel"), ["POST"]);
        assert!(paths().methods("/elsewhere").is_empty());
    }
}
