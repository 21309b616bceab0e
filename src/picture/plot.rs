//! The spectrum as a plot, in SVG: eigenvalues by their number, and where Weyl's law puts them.

use std::f64::consts::PI;
use std::fmt::Write as _;

/// Pixels of the picture, and of what is outside of the axes.
const SIZE: [f64; 2] = [800.0, 500.0];
const LEFT: f64 = 80.0;
const BOTTOM: f64 = 60.0;
const RIGHT: f64 = 24.0;
const TOP: f64 = 48.0;
/// Marks along an axis, about.
const TICKS: f64 = 6.0;

/// What is plotted.
#[derive(Debug, Clone, Copy)]
pub struct Spectrum<'a> {
    /// Eigenvalues in 1/length², ascending; absent ones are left out.
    pub eigenvalues: &'a [Option<f64>],
    /// Index ranges `[first, last]` of eigenvalues that are one within their residuals.
    pub clusters: &'a [[usize; 2]],
    /// Area of the surface in length², for Weyl's law; `None` for what is not a surface.
    pub area: Option<f64>,
    /// Heading.
    pub title: &'a str,
}

/// Draws the plot. Eigenvalues of a cluster are joined; the line is Weyl's law `λ_n ≈ 4πn / area`.
#[must_use]
pub fn plot_spectrum(spectrum: &Spectrum<'_>) -> String {
    let values: Vec<(usize, f64)> = spectrum
        .eigenvalues
        .iter()
        .enumerate()
        .filter_map(|(index, value)| Some((index, (*value).filter(|value| value.is_finite())?)))
        .collect();
    let least = values.iter().map(|&(_, value)| value).fold(0.0, f64::min);
    let most = values.iter().map(|&(_, value)| value).fold(0.0, f64::max);
    let x = Axis::new(0.0, spectrum.eigenvalues.len().saturating_sub(1).max(1) as f64, LEFT, SIZE[0] - RIGHT);
    let y = Axis::new(least, if most > least { most } else { least + 1.0 }, SIZE[1] - BOTTOM, TOP);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         <text x=\"{LEFT}\" y=\"28\" font-size=\"16\">{}</text>\n",
        SIZE[0],
        SIZE[1],
        escaped(spectrum.title)
    );
    grid(&mut svg, &x, &y);
    if let Some(area) = spectrum.area.filter(|area| *area > 0.0) {
        weyl(&mut svg, &x, &y, area);
    }
    for &[first, last] in spectrum.clusters {
        let ends = [first, last].map(|index| values.iter().find(|(i, _)| *i == index));
        if let [Some(a), Some(b)] = ends {
            line(&mut svg, [x.at(a.0 as f64), y.at(a.1)], [x.at(b.0 as f64), y.at(b.1)], "#c1570e", 3.0);
        }
    }
    for (index, value) in values {
        // Writing to a string cannot fail.
        let _ = writeln!(
            svg,
            "<circle cx=\"{:.2}\" cy=\"{:.2}\" r=\"2.5\" fill=\"#1b4f8f\"><title>λ_{index} = {value:.6e}</title></circle>",
            x.at(index as f64),
            y.at(value)
        );
    }
    svg.push_str("</svg>\n");
    svg
}

fn grid(svg: &mut String, x: &Axis, y: &Axis) {
    for tick in x.ticks(1.0) {
        let at = x.at(tick);
        line(svg, [at, y.from], [at, y.to], "#e4e4e4", 1.0);
        let _ = writeln!(
            svg,
            "<text x=\"{at:.2}\" y=\"{:.2}\" text-anchor=\"middle\">{tick}</text>",
            y.from + 20.0
        );
    }
    for tick in y.ticks(0.0) {
        let at = y.at(tick);
        line(svg, [x.from, at], [x.to, at], "#e4e4e4", 1.0);
        let _ = writeln!(
            svg,
            "<text x=\"{:.2}\" y=\"{:.2}\" text-anchor=\"end\">{}</text>",
            x.from - 8.0,
            at + 4.0,
            number(tick)
        );
    }
    line(svg, [x.from, y.from], [x.to, y.from], "#404040", 1.0);
    line(svg, [x.from, y.from], [x.from, y.to], "#404040", 1.0);
    let middle = 0.5 * (x.from + x.to);
    let _ = writeln!(svg, "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">mode</text>", SIZE[1] - 16.0);
    let middle = 0.5 * (y.from + y.to);
    let _ = writeln!(
        svg,
        "<text x=\"18\" y=\"{middle}\" text-anchor=\"middle\" transform=\"rotate(-90 18 {middle})\">λ in 1/length²</text>"
    );
}

fn weyl(svg: &mut String, x: &Axis, y: &Axis, area: f64) {
    let slope = 4.0 * PI / area;
    let end = (y.high / slope).min(x.high);
    line(svg, [x.at(0.0), y.at(0.0)], [x.at(end), y.at(end * slope)], "#8a8a8a", 1.5);
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"28\" text-anchor=\"end\" fill=\"#606060\">line: Weyl's law, λ = 4πn/area</text>",
        SIZE[0] - RIGHT
    );
}

fn line(svg: &mut String, from: [f64; 2], to: [f64; 2], color: &str, width: f64) {
    let _ = writeln!(
        svg,
        "<line x1=\"{:.2}\" y1=\"{:.2}\" x2=\"{:.2}\" y2=\"{:.2}\" stroke=\"{color}\" stroke-width=\"{width}\"/>",
        from[0], from[1], to[0], to[1]
    );
}

/// A range of numbers and the pixels of its ends.
struct Axis {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Axis {
    fn new(low: f64, high: f64, from: f64, to: f64) -> Self {
        Self { low, high, from, to }
    }

    fn at(&self, value: f64) -> f64 {
        self.from + (value - self.low) / (self.high - self.low) * (self.to - self.from)
    }

    /// Round numbers 1, 2 or 5 times a power of ten apart, and at least `least`.
    fn ticks(&self, least: f64) -> Vec<f64> {
        let rough = (self.high - self.low) / TICKS;
        let power = 10_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(|step| *step >= rough);
        let step = step.unwrap_or(rough).max(least);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step * (1.0 + 1e-12)).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

/// A number with no more digits than it needs, powers of ten for the very large and small.
fn number(value: f64) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) {
        let text = format!("{value:.6}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        format!("{value:.1e}")
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(eigenvalues: &[Option<f64>], clusters: &[[usize; 2]]) -> String {
        plot_spectrum(&Spectrum { eigenvalues, clusters, area: Some(4.0 * PI), title: "a < b & c" })
    }

    #[test]
    fn every_eigenvalue_has_a_dot_and_every_cluster_a_line() {
        let sphere = [0.0, 2.0, 2.0, 2.0, 6.0].map(Some);
        let with_clusters = plot(&sphere, &[[1, 3]]);
        assert_eq!(with_clusters.matches("<circle").count(), 5);
        let lines = |svg: &str| svg.matches("<line").count();
        assert_eq!(lines(&with_clusters), lines(&plot(&sphere, &[])) + 1);
        assert!(with_clusters.contains("a &lt; b &amp; c"));
    }

    #[test]
    fn the_plot_is_well_formed_xml() {
        for values in [&[][..], &[Some(0.0)], &[None, Some(f64::NAN)], &[Some(-1e-9), Some(0.0), Some(1e9)]] {
            let svg = plot(values, &[[0, 1]]);
            assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }

    #[test]
    fn ticks_are_round_numbers_within_the_axis() {
        assert_eq!(Axis::new(0.0, 49.0, 0.0, 1.0).ticks(1.0), [0.0, 10.0, 20.0, 30.0, 40.0]);
        assert_eq!(Axis::new(0.0, 3.0, 0.0, 1.0).ticks(1.0), [0.0, 1.0, 2.0, 3.0]);
        assert_eq!((number(0.5), number(20.0), number(2e-7)), ("0.5".into(), "20".into(), "2.0e-7".into()));
    }
}
