//! The logs that grow by a row a step.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};

use crate::scene::Scene;
use crate::solve::norms::Norms;
use crate::state::State;
use crate::step::{Clock, StepReport};

/// Cost and error figures of every step, in OUTBOX.
pub const STEPS: &str = "steps.csv";
/// Seconds of every step by room, beside OUTBOX.
pub const TIMER: &str = "TIMER.csv";

/// A CSV file whose first column is the step.
pub struct Table {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Table {
    /// Opens the file to go on after `step`: its rows up to that step are kept, if it has the same header.
    pub fn open(path: &Path, header: &str, step: u64) -> Result<Self, Faults> {
        let old = std::fs::read_to_string(path).unwrap_or_default();
        let mut text = format!("{header}\n");
        if let Some(rows) = old.strip_prefix(&text).map(str::to_owned) {
            let whole = rows.split_inclusive('\n').filter(|row| row.ends_with('\n'));
            let number = |row: &str| row.split(',').next().and_then(|n| n.parse::<u64>().ok());
            text.extend(whole.take_while(|row| number(row).is_some_and(|n| n <= step)));
        }
        atomic::write(path, text.as_bytes())?;
        let file = File::options().append(true).open(path).map_err(|error| Fault::io(path, "written", &error))?;
        Ok(Table { path: path.to_path_buf(), file: BufWriter::new(file) })
    }

    pub fn row(&mut self, row: &str) -> Result<(), Faults> {
        writeln!(self.file, "{row}").map_err(|error| Fault::io(&self.path, "written", &error).into())
    }

    pub fn flush(&mut self) -> Result<(), Faults> {
        self.file.flush().map_err(|error| Fault::io(&self.path, "written", &error).into())
    }
}

macro_rules! columns {
    ($header:ident, $row:ident($($name:ident : $type:ty),*), $($column:ident = $value:expr,)+) => {
        pub fn $header() -> String { [$(stringify!($column)),+].join(",") }
        pub fn $row($($name: $type),*) -> String { [$(cell($value)),+].join(",") }
    };
}

fn cell(value: impl Into<Cell>) -> String {
    match value.into() {
        Cell::Count(n) => n.to_string(),
        Cell::Real(x) if x.is_finite() => format!("{x:e}"),
        Cell::Real(_) => String::new(), // an empty field, as everywhere in this project's tables
    }
}

enum Cell {
    Count(u64),
    Real(f64),
}

impl From<u64> for Cell {
    fn from(n: u64) -> Self {
        Cell::Count(n)
    }
}

impl From<usize> for Cell {
    fn from(n: usize) -> Self {
        Cell::Count(n as u64)
    }
}

impl From<f64> for Cell {
    fn from(x: f64) -> Self {
        Cell::Real(x)
    }
}

columns! {
    norms_header, norms_row(norms: &Norms),
    quad_dv = norms.quad_dv,
    quad_dvr = norms.quad_dvr,
    maxm_dv = norms.maxm_dv,
    maxm_dvr = norms.maxm_dvr,
    mean_dvor = norms.mean_dvor,
}

columns! {
    length_header, length_row(report: &StepReport),
    h = report.h,
}

columns! {
    steps_header, steps_row(scene: &Scene, state: &State, report: &StepReport),
    step = state.step,
    time = state.time,
    contacts_listed = report.contacts_listed,
    contacts_solved = report.contacts_solved,
    contacts_active = report.contacts_active,
    sweeps = report.sweeps,
    residual = report.residual,
    converged = report.converged as u64,
    penetration_largest = report.penetration_largest / scene.mean_radius,
    penetration_mean = report.penetration_mean / scene.mean_radius,
    kinetic_energy = report.kinetic,
    rotational_energy = report.rotational,
    potential_energy = report.potential,
    contact_work = state.ledger.contact_work,
    friction_work = state.ledger.friction_work,
    outside_work = state.ledger.outside_work,
    momentum_drift = report.momentum_drift,
    gravity_error = report.gravity.removed,
    gravity_extrapolation = report.gravity.extrapolation,
    gravity_sampled = report.gravity.sampled.map_or(f64::NAN, |sampled| sampled.rms),
    gravity_sampled_largest = report.gravity.sampled.map_or(f64::NAN, |sampled| sampled.largest),
}

columns! {
    timer_header, timer_row(step: u64, lap: &Clock),
    step = step,
    gravity = lap.gravity.as_secs_f64(),
    detection = lap.detection.as_secs_f64(),
    assembly = lap.assembly.as_secs_f64(),
    solve = lap.solve.as_secs_f64(),
    integration = lap.integration.as_secs_f64(),
    writing = lap.writing.as_secs_f64(),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goes_on_after_a_step_and_drops_what_is_later_or_torn() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        std::fs::write(&path, "step,a\n1,x\n2,y\n3,z\n4,").unwrap();
        let mut table = Table::open(&path, "step,a", 2).unwrap();
        table.row("3,new").unwrap();
        table.flush().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "step,a\n1,x\n2,y\n3,new\n");
        // Another header: another program's file.
        Table::open(&path, "step,b", 2).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "step,b\n");
    }
}
