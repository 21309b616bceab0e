//! What the demo prints: the spectrum, how far to trust it, and what to try next.

use std::fmt::{self, Write};
use std::net::SocketAddr;

use serde_json::Value;

use super::DemoError;
use crate::cli::client::Client;

/// Largest entry of `HᵀBH − I`, from the bases and masses that the service hands out.
///
/// # Errors
/// [`DemoError::Answer`] when they have not the right shape.
pub(crate) async fn orthogonality(
    client: &mut Client,
    id: &str,
    points: usize,
    bases: usize,
) -> Result<f64, DemoError> {
    let answer = |reason: String| DemoError::Answer(reason);
    let file = client.get(&format!("/jobs/{id}/bases?format=npy")).await?;
    let array = npyz::NpyFile::new(&file[..])?;
    if array.shape() != [points as u64, bases as u64] {
        return Err(answer(format!("bases of shape {:?} instead of ({points}, {bases})", array.shape())));
    }
    let values = array.into_vec::<f64>()?;
    let text = client.get(&format!("/jobs/{id}/operator?format=mtx&matrix=b")).await?;
    let mass =
        diagonal(&String::from_utf8_lossy(&text), points).ok_or_else(|| answer("masses".to_owned()))?;
    let mut gram = vec![0.0; bases * bases];
    for (row, mass) in values.chunks(bases).zip(&mass).filter(|(_, mass)| **mass > 0.0) {
        for (i, left) in row.iter().enumerate() {
            for (sum, right) in gram[i * bases..].iter_mut().zip(row) {
                *sum += mass * left * right;
            }
        }
    }
    let identity = |i: usize| if i.is_multiple_of(bases + 1) { 1.0 } else { 0.0 };
    Ok(gram.iter().enumerate().map(|(i, x)| (x - identity(i)).abs()).fold(0.0, f64::max))
}

/// The diagonal of a matrix in Matrix Market format; rows without an entry have 0.
fn diagonal(text: &str, rows: usize) -> Option<Vec<f64>> {
    let mut diagonal = vec![0.0; rows];
    for line in text.lines().filter(|line| !line.starts_with('%')).skip(1) {
        let mut words = line.split_ascii_whitespace();
        let row: usize = words.next()?.parse().ok()?;
        *diagonal.get_mut(row.checked_sub(1)?)? = words.nth(1)?.parse().ok()?;
    }
    Some(diagonal)
}

/// What was found.
pub(crate) fn text(job: &Value, spectrum: &Value, orthogonality: f64) -> String {
    let mut text = String::new();
    // Strings take everything.
    let _ = write_spectrum(&mut text, spectrum);
    let _ = write_certificates(&mut text, job, spectrum, orthogonality);
    text
}

fn write_spectrum(text: &mut String, spectrum: &Value) -> fmt::Result {
    writeln!(text, "\n    i      eigenvalue λ           raw μ    residual    wavelength 2π/√λ")?;
    let number = |list: &str, i: usize| spectrum[list][i].as_f64().unwrap_or(f64::NAN);
    for i in 0..spectrum["eigenvalues"].as_array().map_or(0, Vec::len) {
        let (eigenvalue, raw) = (number("eigenvalues", i), number("raw_eigenvalues", i));
        let wavelength =
            if i == 0 { f64::INFINITY } else { std::f64::consts::TAU / eigenvalue.max(0.0).sqrt() };
        writeln!(
            text,
            "{i:5} {eigenvalue:17.9} {raw:15.9} {:11.1e} {wavelength:19.6}",
            number("residuals", i)
        )?;
    }
    Ok(())
}

fn write_certificates(text: &mut String, job: &Value, spectrum: &Value, orthogonality: f64) -> fmt::Result {
    writeln!(text, "\nHow far to trust it:")?;
    writeln!(
        text,
        "  bases are orthonormal up to {orthogonality:.1e} (largest entry of HᵀBH − I, from the bases as served)"
    )?;
    let certificates = &spectrum["certificates"];
    if let Some(residual) = certificates["residual"].as_f64() {
        writeln!(text, "  eigenpairs hold up to {residual:.1e} (largest relative residual)")?;
    }
    match certificates["missed"].as_u64() {
        Some(0) => writeln!(text, "  no eigenvalue was missed: all below the last one were counted")?,
        Some(missed) => writeln!(text, "  {missed} eigenvalues were missed")?,
        None => writeln!(text, "  whether an eigenvalue was missed could not be told")?,
    }
    writeln!(text, "\nWhat it says of the shape:")?;
    if let Some(components) = spectrum["components"].as_u64() {
        let parts = if components == 1 { "it is in one piece" } else { "it is in pieces" };
        writeln!(text, "  {parts}: {components} of the eigenvalues are 0")?;
    }
    if let Some(area) = spectrum["area"]["cells"].as_f64() {
        writeln!(
            text,
            "  its area is {area:.4}, the sum of the cells around the points, in squared units of the cloud"
        )?;
    }
    let clusters = spectrum["clusters"].as_array().map_or(0, Vec::len);
    if clusters > 0 {
        writeln!(
            text,
            "  {clusters} groups of eigenvalues coincide: within a group the bases may be turned, as symmetry allows"
        )?;
    }
    writeln!(text)?;
    if let Some(seconds) = job["phase_seconds"].as_object() {
        let phases =
            seconds.iter().map(|(phase, s)| format!("{phase} {:.2} s", s.as_f64().unwrap_or(f64::NAN)));
        writeln!(text, "Time: {}.", phases.collect::<Vec<_>>().join(", "))?;
    }
    for warning in job["warnings"].as_array().into_iter().flatten() {
        writeln!(text, "Warning: {}", warning.as_str().unwrap_or_default())?;
    }
    Ok(())
}

/// What to ask the service that stays.
pub(crate) fn next(address: SocketAddr, job: &Value) -> String {
    let (cloud, job) = (&job["cloud_id"], &job["id"]);
    let (cloud, job) = (cloud.as_str().unwrap_or_default(), job.as_str().unwrap_or_default());
    let lines = [
        format!("curl http://{address}/jobs/{job}"),
        format!("curl http://{address}/jobs/{job}/spectrum.csv"),
        format!("curl -O http://{address}/jobs/{job}/bases.ply     # opens in CloudCompare and MeshLab"),
        format!("curl -O http://{address}/jobs/{job}/bases.npy     # numpy.load('bases.npy')"),
        format!(
            "curl -d '{{\"operator\": \"voronoi\", \"bases\": 50}}' http://{address}/clouds/{cloud}/jobs"
        ),
        format!("curl -T your-scan.ply 'http://{address}/clouds?bases=50'"),
        format!("curl http://{address}/capabilities"),
    ];
    format!("\nTry next:\n  {}", lines.join("\n  "))
}

/// How to do the same with a service of one's own: that of the demo ends now.
pub(crate) fn how_to_serve() -> String {
    let lines = [
        "chladni serve                                                      # http://127.0.0.1:8080",
        "curl -T your-scan.ply 'http://127.0.0.1:8080/clouds?bases=50'      # answers with links to its job",
        "chladni analyze your-scan.ply -k 50 -o results                     # or without a service",
    ];
    format!("\nTry next, with a service of your own:\n  {}", lines.join("\n  "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_diagonal_is_read_with_its_gaps() {
        let text = "%%MatrixMarket matrix coordinate real symmetric\n3 3 2\n1 1 5e-1\n3 3 2e0\n";
        assert_eq!(diagonal(text, 3), Some(vec![0.5, 0.0, 2.0]));
        assert_eq!(diagonal("%%\n1 1 1\n2 2 1e0\n", 1), None);
    }
}
