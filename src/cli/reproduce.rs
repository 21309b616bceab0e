//! `chladni reproduce`: the papers' tables and figures again, with the papers' figures beside ours.

mod measure;
mod mesh;
mod pcd;
mod pcd_areas;
mod point_based;
mod point_based_bases;
mod point_based_features;
mod point_based_rims;
mod point_based_times;
mod samples;
mod table;

use std::path::PathBuf;
use std::time::Instant;

use clap::builder::{PossibleValuesParser, TypedValueParser};

use self::table::{Table, report};
use super::reporting::print;
use super::{Failure, output};

/// Reproduce the tables and figures of the papers and compare.
#[derive(Debug, clap::Args)]
pub(crate) struct ReproduceArgs {
    /// Tables to reproduce; all when none is named
    #[arg(value_parser = names())]
    tables: Vec<&'static Experiment>,

    /// All sizes of the papers instead of those that take seconds
    #[arg(long)]
    full: bool,

    /// Write the report, as Markdown, into a file too
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// How much of a table is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Extent {
    /// The columns that take seconds.
    Quick,
    /// All columns.
    Full,
}

impl Extent {
    /// The leading `quick` of `all`, or all.
    fn of<T>(self, all: &[T], quick: usize) -> &[T] {
        match self {
            Self::Quick => &all[..quick.min(all.len())],
            Self::Full => all,
        }
    }
}

/// One table or figure of a paper.
#[derive(Debug, Clone)]
pub(crate) struct Experiment {
    name: &'static str,
    run: fn(Extent) -> Result<Table, Failure>,
}

/// All of them, in the papers' order.
const EXPERIMENTS: &[Experiment] = &[
    Experiment { name: "pbmhb-table-1", run: point_based_times::table_1 },
    Experiment { name: "pbmhb-table-2", run: point_based_bases::table_2 },
    Experiment { name: "pbmhb-figure-3", run: point_based::figure_3 },
    Experiment { name: "pbmhb-figure-5", run: point_based::figure_5 },
    Experiment { name: "pbmhb-figure-7", run: point_based_bases::figure_7 },
    Experiment { name: "pbmhb-figure-8", run: point_based_bases::figure_8 },
    Experiment { name: "pbmhb-figure-10", run: point_based_features::figure_10 },
    Experiment { name: "pbmhb-figure-12", run: point_based_rims::figure_12 },
    Experiment { name: "pbmhb-figure-13", run: point_based_rims::figure_13 },
    Experiment { name: "pcd-table-2", run: pcd::table_2 },
    Experiment { name: "pcd-table-3", run: pcd::table_3 },
    Experiment { name: "pcd-table-4", run: pcd::table_4 },
    Experiment { name: "pcd-table-5", run: pcd_areas::table_5 },
    Experiment { name: "mesh-table-1", run: mesh::table_1 },
    Experiment { name: "mesh-table-2", run: mesh::table_2 },
    Experiment { name: "mesh-table-3", run: mesh::table_3 },
    Experiment { name: "mesh-table-4", run: mesh::table_4 },
];

fn names() -> impl TypedValueParser<Value = &'static Experiment> {
    let find = |name: String| EXPERIMENTS.iter().find(|experiment| experiment.name == name);
    PossibleValuesParser::new(EXPERIMENTS.iter().map(|experiment| experiment.name))
        .try_map(move |name| find(name).ok_or("not a table"))
}

/// Runs the experiments, prints each as it ends; fails when a figure is outside its bound.
pub(crate) fn run(args: &ReproduceArgs) -> Result<(), Failure> {
    let extent = if args.full { Extent::Full } else { Extent::Quick };
    let wanted: Vec<&Experiment> =
        if args.tables.is_empty() { EXPERIMENTS.iter().collect() } else { args.tables.clone() };
    let mut tables = Vec::new();
    for experiment in wanted {
        let began = Instant::now();
        // one that cannot be computed takes no other with it
        let mut table =
            (experiment.run)(extent).unwrap_or_else(|failure| Table::missing(experiment.name, &failure));
        table.finish(experiment.name, began.elapsed().as_secs_f64());
        print(table.markdown())?;
        tables.push(table);
        // after each: an hour's figures are not lost with the last table
        if let Some(path) = &args.output {
            output::write_file(path, |out| {
                std::io::Write::write_all(out, report(&tables, args.full).as_bytes())
            })?;
        }
    }
    let missed: usize = tables.iter().map(Table::missed).sum();
    if missed > 0 {
        return Err(Failure::Other(format!("{missed} figures are outside their bounds")));
    }
    Ok(())
}
