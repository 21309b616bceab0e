//! What the bases are for, on bases that the library computes: identities, the papers' experiments, invariants.

mod features;
mod filters;
mod shapes;
mod transform;

use chladni::analysis::{Analysis, Parameters};
use chladni::cloud::PointCloud;
use chladni::harmonics::{Block, Function, Modes, Transfer, Transformed, filtered, transform as mht};

use crate::eigen;

/// An eigenbasis with everything that goes with it.
struct Basis {
    analysis: Analysis,
    modes: Modes,
    mass: Vec<f64>,
    columns: Vec<Vec<f64>>,
}

impl Basis {
    fn of(cloud: &PointCloud, parameters: &Parameters) -> Self {
        let analysis = eigen(cloud, parameters);
        Self {
            modes: Modes::of(analysis.report.spectrum.as_ref().unwrap()),
            mass: analysis.mass(),
            columns: (0..analysis.bases()).map(|j| analysis.basis(j)).collect(),
            analysis,
        }
    }

    /// All rows in blocks of `rows` rows.
    fn blocks(&self, rows: usize) -> Vec<Block<&[f64]>> {
        let n = self.mass.len();
        (0..n)
            .step_by(rows)
            .map(|first| Block {
                first,
                columns: self.columns.iter().map(|c| &c[first..(first + rows).min(n)]).collect(),
            })
            .collect()
    }

    fn transform(&self, functions: &[Function]) -> Vec<Transformed> {
        let values: Vec<&[f64]> = functions.iter().map(|f| f.values.as_slice()).collect();
        let partials: Vec<_> =
            self.blocks(777).iter().map(|block| mht::partial(block, &self.mass, &values)).collect();
        mht::total(&partials)
    }

    fn synthesize(&self, coefficients: &[f64]) -> Vec<f64> {
        let blocks = self.blocks(500);
        blocks.iter().flat_map(|block| mht::synthesize(block, &[coefficients]).remove(0)).collect()
    }

    /// The cloud's coordinates, filtered, one column per axis.
    fn filtered(&self, cloud: &PointCloud, transfer: &Transfer) -> Vec<Vec<f64>> {
        let functions = filtered::Target::Coordinates.functions(cloud, &self.mass).unwrap();
        let found = self.transform(&functions);
        filtered::rows(&self.blocks(usize::MAX / 2)[0], &functions, &found, transfer)
    }
}

fn function(values: Vec<f64>) -> Function {
    Function::new("f".to_owned(), values)
}
