//! A table of figures: the paper's, ours, their ratio, and whether ours is within its bound.

use std::fmt::{Display, Write};

/// What a figure has to satisfy.
#[derive(Debug, Clone, Copy)]
pub(super) enum Bound {
    /// At most this.
    AtMost(f64),
    /// At least this.
    AtLeast(f64),
    /// At most this many times the paper's figure.
    TimesPaper(f64),
    /// Shown for comparison only: a baseline that neither side claims.
    Shown,
}

#[derive(Debug)]
struct Row {
    what: String,
    paper: Option<f64>,
    ours: f64,
    bound: Bound,
}

impl Row {
    fn is_met(&self) -> bool {
        match self.bound {
            Bound::AtMost(limit) => self.ours <= limit,
            Bound::AtLeast(limit) => self.ours >= limit,
            Bound::TimesPaper(factor) => self.paper.is_none_or(|paper| self.ours <= factor * paper),
            Bound::Shown => true,
        }
    }

    fn verdict(&self) -> String {
        let verdict = if self.is_met() { "pass" } else { "**fail**" };
        match self.bound {
            Bound::AtMost(limit) => format!("{verdict} (≤ {limit})"),
            Bound::AtLeast(limit) => format!("{verdict} (≥ {limit})"),
            Bound::TimesPaper(factor) => format!("{verdict} (≤ {factor} × paper)"),
            Bound::Shown => "shown".to_owned(),
        }
    }
}

/// One table or figure.
#[derive(Debug)]
pub(super) struct Table {
    title: String,
    parameters: String,
    rows: Vec<Row>,
    remarks: Vec<String>,
    name: &'static str,
    seconds: f64,
}

impl Table {
    /// An empty table; `parameters` says which t, δ and samples were taken, and by which rule.
    pub(super) fn new(title: impl Into<String>, parameters: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            parameters: parameters.into(),
            rows: Vec::new(),
            remarks: Vec::new(),
            name: "",
            seconds: 0.0,
        }
    }

    /// In place of a table that could not be computed: one figure, which is none and outside of its bound.
    pub(super) fn missing(name: &str, why: &dyn Display) -> Self {
        let mut table = Self::new(name, format!("Not computed: {why}."));
        table.row("all figures", None, f64::NAN, Bound::AtMost(0.0));
        table
    }

    /// Adds a figure.
    pub(super) fn row(
        &mut self,
        what: impl Into<String>,
        paper: impl Into<Option<f64>>,
        ours: f64,
        bound: Bound,
    ) {
        self.rows.push(Row { what: what.into(), paper: paper.into(), ours, bound });
    }

    /// Adds a remark below the table.
    pub(super) fn remark(&mut self, text: impl Into<String>) {
        self.remarks.push(text.into());
    }

    pub(super) fn finish(&mut self, name: &'static str, seconds: f64) {
        self.name = name;
        self.seconds = seconds;
    }

    /// Figures outside their bounds.
    pub(super) fn missed(&self) -> usize {
        self.rows.iter().filter(|row| !row.is_met()).count()
    }

    /// The table as Markdown.
    pub(super) fn markdown(&self) -> String {
        let mut text =
            format!("## {} (`{}`, {:.0} s)\n\n{}\n\n", self.title, self.name, self.seconds, self.parameters);
        text.push_str("| | paper | ours | ours/paper | |\n|---|---|---|---|---|\n");
        for row in &self.rows {
            let paper = row.paper.map_or_else(|| "–".to_owned(), number);
            let ratio = row.paper.map_or_else(|| "–".to_owned(), |paper| format!("{:.2}", row.ours / paper));
            // writing to a string cannot fail
            let _ = writeln!(
                text,
                "| {} | {paper} | {} | {ratio} | {} |",
                row.what,
                number(row.ours),
                row.verdict()
            );
        }
        for remark in &self.remarks {
            let _ = write!(text, "\n{remark}\n");
        }
        text
    }
}

/// Four significant digits.
fn number(x: f64) -> String {
    let digits = if x == 0.0 { 0 } else { (3.0 - x.abs().log10().floor()).clamp(0.0, 12.0) as usize };
    if x != 0.0 && x.abs() < 1e-4 { format!("{x:.2e}") } else { format!("{x:.digits$}") }
}

/// All tables, with a summary at the head.
pub(super) fn report(tables: &[Table], full: bool) -> String {
    let figures: usize = tables.iter().map(|table| table.rows.len()).sum();
    let missed: usize = tables.iter().map(Table::missed).sum();
    let command = format!("cargo run --release -- reproduce{} -o FILE", if full { " --full" } else { "" });
    let mut text = format!(
        "# The papers' tables and figures, reproduced\n\nWritten by `{command}`. {figures} figures, {missed} outside \
         their bounds.\n\n\
         PBMHB is Point-Based Manifold Harmonics (Liu, Prabhakaran, Guo), PCD is Constructing Laplace Operator from \
         Point Clouds in R^d (Belkin, Sun, Wang), MESH is Discrete Laplace Operator on Meshed Surfaces (Belkin, Sun, \
         Wang). Errors are normalized as in the papers: E2 = |U − Û|₂/|U|₂, E∞ likewise. Samples are drawn with fixed \
         seeds; the papers' own samples are not published, so that figures agree in size, not in digits.\n\n"
    );
    for table in tables {
        text.push_str(&table.markdown());
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_outside_its_bound_is_counted_and_shown() {
        let mut table = Table::new("T", "parameters");
        table.row("good", 2.0, 2.1, Bound::TimesPaper(1.1));
        table.row("bad", 2.0, 2.3, Bound::TimesPaper(1.1));
        table.row("shown", None, 1e9, Bound::Shown);
        assert_eq!(table.missed(), 1);
        let text = table.markdown();
        assert!(text.contains("| bad | 2.000 | 2.300 | 1.15 | **fail** (≤ 1.1 × paper) |"), "{text}");
        assert!(report(&[table], true).contains("3 figures, 1 outside their bounds"));
    }

    #[test]
    fn a_table_that_could_not_be_computed_counts_as_a_figure_outside_its_bound() {
        let table = Table::missing("T", &"no eigenvalues");
        assert_eq!(table.missed(), 1);
        assert!(table.markdown().contains("Not computed: no eigenvalues."));
    }

    #[test]
    fn figures_have_four_significant_digits() {
        for (x, text) in
            [(0.0, "0"), (0.012_345, "0.01235"), (123.456, "123.5"), (-2.0, "-2.000"), (1.5e-5, "1.50e-5")]
        {
            assert_eq!(number(x), text);
        }
    }
}
