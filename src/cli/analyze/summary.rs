//! What was computed, in a few lines.

use std::path::PathBuf;

use super::run::Ran;

/// Eigenvalues that are shown.
const SHOWN: usize = 10;

/// Prints counts, times, the first eigenvalues, warnings and files.
#[allow(clippy::print_stdout)] // the summary is the command's output
pub(super) fn print(ran: &Ran, files: &[PathBuf]) {
    let report = &ran.analysis.report;
    println!("rows       {}", report.rows);
    println!("points     {}", report.points_used);
    if report.duplicates + report.nonfinite > 0 {
        println!("dropped    {} duplicates, {} non-finite", report.duplicates, report.nonfinite);
    }
    println!("epsilon    {:.6e}", report.sampling.epsilon);
    if let Some(kernel) = &report.heat_kernel {
        println!("t          {:.6e}", kernel.t);
        println!("delta      {:.6e}", kernel.delta);
    }
    if let Some(spectrum) = &report.spectrum {
        let shown = |value: &Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.6}"));
        let first: Vec<_> = spectrum.eigenvalues.iter().take(SHOWN).map(shown).collect();
        println!("eigenvalues ({})  {}", spectrum.eigenvalues.len(), first.join("  "));
    }
    for (phase, seconds) in &ran.seconds {
        println!("{:<14} {seconds:>8.2} s", phase.name());
    }
    let total: f64 = ran.seconds.iter().map(|(_, seconds)| seconds).sum();
    println!("{:<14} {total:>8.2} s", "total");
    for warning in &report.warnings {
        println!("warning    {warning}");
    }
    for file in files {
        println!("wrote      {}", file.display());
    }
}
