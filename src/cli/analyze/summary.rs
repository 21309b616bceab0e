//! What was computed, in a few lines or as JSON.

use std::fmt::Write;
use std::path::PathBuf;

use serde_json::{Value, json};

use super::Reporting;
use super::run::Ran;

/// Eigenvalues that are shown.
const SHOWN: usize = 10;
/// Significant digits of numbers that are shown.
const DIGITS: i32 = 6;

/// Prints counts, times, the first eigenvalues, warnings and files.
pub(super) fn print(ran: &Ran, files: &[PathBuf], reporting: Reporting) {
    if reporting.json {
        reporting.say(&object(ran, files).to_string());
    } else if reporting.quiet {
        reporting.warn(&ran.analysis.report.warnings);
    } else {
        reporting.say(text(ran, files).trim_end());
    }
}

fn text(ran: &Ran, files: &[PathBuf]) -> String {
    let report = &ran.analysis.report;
    let mut text = String::new();
    let mut line = |name: &str, value: String| {
        // Strings take everything.
        let _ = writeln!(text, "{name:<10} {value}");
    };
    line("rows", report.rows.to_string());
    line("points", report.points_used.to_string());
    if report.duplicates + report.nonfinite > 0 {
        line("dropped", format!("{} duplicates, {} non-finite", report.duplicates, report.nonfinite));
    }
    line("epsilon", significant(report.sampling.epsilon));
    if let Some(kernel) = &report.heat_kernel {
        line("t", significant(kernel.t));
        line("delta", significant(kernel.delta));
    }
    if let Some(spectrum) = &report.spectrum {
        let shown = |value: &Option<f64>| value.map_or_else(|| "-".to_owned(), significant);
        let first: Vec<_> = spectrum.eigenvalues.iter().take(SHOWN).map(shown).collect();
        line(&format!("eigenvalues ({})", spectrum.eigenvalues.len()), first.join("  "));
        if let Some(solved) = spectrum.solved_points.filter(|&solved| solved < report.points_used) {
            line("solved", format!("on {solved} points, then extended to all"));
        }
    }
    for (name, seconds) in times(ran) {
        line(&format!("{name:<14}"), format!("{seconds:>8.2} s"));
    }
    for warning in &report.warnings {
        line("warning", warning.clone());
    }
    for file in files {
        line("wrote", file.display().to_string());
    }
    text
}

fn object(ran: &Ran, files: &[PathBuf]) -> Value {
    let report = &ran.analysis.report;
    let seconds: serde_json::Map<String, Value> =
        times(ran).into_iter().map(|(name, seconds)| (name.to_owned(), json!(seconds))).collect();
    let files: Vec<String> = files.iter().map(|file| file.display().to_string()).collect();
    json!({
        "rows": report.rows,
        "points": report.points_used,
        "duplicates": report.duplicates,
        "nonfinite": report.nonfinite,
        "epsilon": report.sampling.epsilon,
        "t": report.heat_kernel.as_ref().map(|kernel| kernel.t),
        "delta": report.heat_kernel.as_ref().map(|kernel| kernel.delta),
        "eigenvalues": report.spectrum.as_ref().map(|spectrum| &spectrum.eigenvalues),
        "solved_points": report.spectrum.as_ref().and_then(|spectrum| spectrum.solved_points),
        "seconds": seconds,
        "warnings": report.warnings,
        "files": files,
    })
}

/// Seconds by phase, and in total.
fn times(ran: &Ran) -> Vec<(&'static str, f64)> {
    let total = ran.seconds.iter().map(|(_, seconds)| seconds).sum();
    ran.seconds.iter().map(|(phase, seconds)| (phase.name(), *seconds)).chain([("total", total)]).collect()
}

/// A number with its significant digits, in whatever unit the cloud is.
fn significant(value: f64) -> String {
    let exponent = if value == 0.0 { 0.0 } else { value.abs().log10().floor() };
    if !exponent.is_finite() {
        return value.to_string();
    }
    let exponent = exponent as i32;
    if (-4..DIGITS).contains(&exponent) {
        format!("{value:.*}", usize::try_from(DIGITS - 1 - exponent).unwrap_or(0))
    } else {
        format!("{value:.*e}", (DIGITS - 1) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::significant;

    #[test]
    fn numbers_keep_their_digits_in_every_unit() {
        for (value, shown) in [
            (2.000_721_4, "2.00072"),
            (0.000_123_456_78, "0.000123457"),
            (0.000_002_000_7, "2.00070e-6"),
            (123_456.78, "123457"),
            (2_000_721.4, "2.00072e6"),
            (-12.566_37, "-12.5664"),
            (0.0, "0.00000"),
        ] {
            assert_eq!(significant(value), shown);
        }
    }
}
