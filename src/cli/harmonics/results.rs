//! A directory that `chladni analyze` filled, read back.

use std::path::{Path, PathBuf};

use chladni::analysis::Report;
use chladni::cloud::reader::{Format, Limits, ReadOptions, read, read_columns};
use chladni::cloud::writer::{
    Column, PlyEncoding, PlyHeader, encode_faces, encode_rows, ply_columns, ply_properties,
};
use chladni::cloud::{NonFinite, PointCloud, ScalarType};
use chladni::harmonics::{Block, Modes};
use rayon::prelude::*;

use super::{Failure, output};
use crate::cli::input;
use crate::cli::source::{SOURCE, Source};

/// Rows that are worked on together.
const BLOCK_ROWS: usize = 8192;

/// Report, masses and bases of an analysis.
pub(super) struct Results {
    directory: PathBuf,
    pub(super) report: Report,
    pub(super) modes: Modes,
    pub(super) mass: Vec<f64>,
    bases: Vec<Vec<f64>>,
}

impl Results {
    /// Reads the directory.
    pub(super) fn read(directory: &Path) -> Result<Self, Failure> {
        let report = report(directory)?;
        let Some(spectrum) = &report.spectrum else {
            let shown = directory.display();
            return Err(Failure::Input(format!(
                "{shown} holds an operator without bases; analyze the cloud with --kind eigen"
            )));
        };
        let modes = Modes::of(spectrum);
        let mass = array(directory, "mass.npy")?.swap_remove(0);
        let bases = array(directory, "bases.npy")?;
        let fits = bases.len() == modes.len() && mass.len() == report.rows;
        if !fits || bases.iter().any(|basis| basis.len() != report.rows) {
            let shown = directory.display();
            return Err(Failure::Input(format!("{shown}: bases, masses and report are not of one analysis")));
        }
        Ok(Self { directory: directory.to_owned(), report, modes, mass, bases })
    }

    /// The cloud that was analyzed: `bases.ply` without the bases, which are its last fields, with what `source.json` has of it.
    pub(super) fn cloud(&self) -> Result<PointCloud, Failure> {
        let path = self.directory.join("bases.ply");
        let bytes = file(&path)?;
        let options =
            ReadOptions { policy: NonFinite::Drop, limits: Limits::OF_THE_MACHINE, ..ReadOptions::default() };
        let refused = |error: &dyn std::fmt::Display| Failure::Input(format!("{}: {error}", path.display()));
        let cloud = read(&bytes, Format::Ply, &options).map_err(|error| refused(&error))?;
        let own = cloud.fields().len().saturating_sub(self.modes.len());
        if cloud.len() != self.report.rows || cloud.dimension() != self.report.ambient_dimension.max(3) {
            return Err(refused(&"the cloud is not the one that was analyzed"));
        }
        let fields = cloud.fields()[..own].to_vec();
        let cloud = cloud.with_fields(fields).map_err(Failure::other)?;
        match self.source()? {
            Some(source) => source.added_to(cloud).map_err(|error| refused(&error)),
            None => Ok(cloud),
        }
    }

    /// What the cloud's file said beside it, if it said anything.
    fn source(&self) -> Result<Option<Source>, Failure> {
        let path = self.directory.join(SOURCE);
        if !path.exists() {
            return Ok(None);
        }
        let refused = |error| Failure::Input(format!("{}: {error}", path.display()));
        serde_json::from_slice(&file(&path)?).map(Some).map_err(refused)
    }

    /// What `work` makes of every block of rows, in their order.
    pub(super) fn map<T: Send>(&self, work: impl Fn(&Block<&[f64]>) -> T + Sync) -> Vec<T> {
        let starts: Vec<usize> = (0..self.mass.len()).step_by(BLOCK_ROWS).collect();
        let block = |&first: &usize| {
            let rows = first..(first + BLOCK_ROWS).min(self.mass.len());
            Block { first, columns: self.bases.iter().map(|basis| &basis[rows.clone()]).collect() }
        };
        starts.par_iter().map(|first| work(&block(first))).collect()
    }

    /// Columns of all rows, from those that `work` makes of every block.
    pub(super) fn columns(&self, work: impl Fn(&Block<&[f64]>) -> Vec<Vec<f64>> + Sync) -> Vec<Vec<f64>> {
        let mut blocks = self.map(work).into_iter();
        let mut columns = blocks.next().unwrap_or_default();
        for block in blocks {
            for (column, values) in columns.iter_mut().zip(block) {
                column.extend(values);
            }
        }
        columns
    }

    /// The bases, one by one.
    pub(super) fn bases(&self) -> &[Vec<f64>] {
        &self.bases
    }

    /// Writes the points and faces with a property per column.
    pub(super) fn write_ply(
        &self,
        names: &[String],
        columns: &[Vec<f64>],
        path: &Path,
    ) -> Result<(), Failure> {
        let cloud = self.cloud()?;
        let (encoding, kind) = (PlyEncoding::Binary, ScalarType::Float32);
        let mut properties = ply_properties(&cloud);
        properties.truncate(cloud.dimension());
        properties.extend(names.iter().map(|name| (name.clone(), kind)));
        let header = PlyHeader { encoding, points: cloud.len(), properties, faces: cloud.faces().len() };
        let mut encoded = ply_columns(&cloud, 0);
        encoded.truncate(cloud.dimension());
        encoded.extend(columns.iter().map(|values| Column { values, stride: 1, kind }));
        output::write_file(path, |out| {
            use std::io::Write;
            out.write_all(&header.to_bytes())?;
            out.write_all(&encode_rows(&encoded, cloud.len()))?;
            out.write_all(&encode_faces(cloud.faces(), encoding))
        })
    }
}

/// The report of an analysis.
pub(super) fn report(directory: &Path) -> Result<Report, Failure> {
    check_directory(directory)?;
    let path = directory.join("report.json");
    serde_json::from_slice(&file(&path)?)
        .map_err(|error| Failure::Input(format!("{}: {error}", path.display())))
}

/// Whether there is a directory that an analysis has filled.
fn check_directory(directory: &Path) -> Result<(), Failure> {
    let shown = directory.display();
    let why = if directory.is_file() {
        format!("{shown} is a file; expected a directory that `chladni analyze {shown} -o DIR` fills")
    } else if !directory.exists() {
        format!("there is no directory {shown}; `chladni analyze CLOUD -o {shown}` fills one")
    } else if !directory.join("report.json").exists() {
        format!("{shown} has no report.json; `chladni analyze CLOUD -o {shown}` writes one")
    } else {
        return Ok(());
    };
    Err(Failure::Input(why))
}

/// The columns of one of the arrays.
fn array(directory: &Path, name: &str) -> Result<Vec<Vec<f64>>, Failure> {
    columns(&directory.join(name))
}

/// The columns of an array file.
pub(super) fn columns(path: &Path) -> Result<Vec<Vec<f64>>, Failure> {
    read_columns(&file(path)?).map_err(|error| Failure::Input(format!("{}: {error}", path.display())))
}

pub(super) fn file(path: &Path) -> Result<Vec<u8>, Failure> {
    input::bytes(path)
}
