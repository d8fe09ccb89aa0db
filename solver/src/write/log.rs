//! The logs that grow by a row a step.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};
use cd_formats::tell::tell;

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
    /// Empty fields of columns that an earlier part of the run had and this one has not.
    others: String,
}

impl Table {
    /// Opens the file to go on after `step`, in a run that began after `first`. Its rows up to that step are kept, and given
    /// back; where other options made other columns, fields that a row has not are empty. Tells of rows that are not there.
    pub fn open(path: &Path, header: &str, first: u64, step: u64) -> Result<(Self, Kept), Faults> {
        let old = if path.is_file() { std::fs::read(path).unwrap_or_default() } else { Vec::new() };
        let old = String::from_utf8_lossy(&old);
        let mut lines = old.split_inclusive('\n').filter_map(|line| line.strip_suffix('\n'));
        let known: Vec<&str> = lines.next().filter(|line| line.starts_with("step,")).unwrap_or("").split(',').collect();
        let mut columns: Vec<&str> = header.split(',').collect();
        let own = columns.len();
        columns
            .extend(known.iter().filter(|name| !name.is_empty() && !header.split(',').any(|column| column == **name)));
        let place = |column: &&str| known.iter().position(|name| name == column);
        let places: Vec<Option<usize>> = columns.iter().map(place).collect();
        let (mut text, mut last) = (format!("{}\n", columns.join(",")), first);
        let mut kept = Kept { columns: columns.iter().map(ToString::to_string).collect(), rows: Vec::new() };
        for line in lines {
            let fields: Vec<&str> = line.split(',').collect();
            let number = fields[0].parse::<u64>().ok().filter(|number| (last + 1..=step).contains(number));
            let (Some(number), true) = (number, fields.len() == known.len()) else { break };
            let fields: Vec<&str> = places.iter().map(|place| place.map_or("", |k| fields[k])).collect();
            text += &format!("{}\n", fields.join(","));
            kept.rows.push(fields.iter().map(|field| field.parse().unwrap_or(f64::NAN)).collect());
            last = number;
        }
        if last < step {
            let path = path.display();
            tell(format_args!("cd-solve: {path}: no rows of steps {} to {step}, which are behind this run", last + 1));
        }
        atomic::write(path, text.as_bytes())?;
        let file = File::options().append(true).open(path).map_err(|error| Fault::io(path, "written", &error))?;
        let others = ",".repeat(columns.len() - own);
        Ok((Table { path: path.to_path_buf(), file: BufWriter::new(file), others }, kept))
    }

    pub fn row(&mut self, row: &str) -> Result<(), Faults> {
        writeln!(self.file, "{row}{}", self.others).map_err(|error| Fault::io(&self.path, "written", &error).into())
    }

    /// Lets others see the rows.
    pub fn show(&mut self) -> Result<(), Faults> {
        self.file.flush().map_err(|error| Fault::io(&self.path, "written", &error).into())
    }

    /// Brings the rows to the disk, so that no snapshot is there without those before it.
    pub fn flush(&mut self) -> Result<(), Faults> {
        self.show()?;
        self.file.get_ref().sync_data().map_err(|error| Fault::io(&self.path, "written", &error).into())
    }
}

/// Rows of a table that an earlier part of the run has written.
pub struct Kept {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Kept {
    /// The numbers of a column, NaN for empty fields; all NaN without such a column.
    pub fn column(&self, name: &str) -> impl Iterator<Item = f64> {
        let place = self.columns.iter().position(|column| column == name);
        self.rows.iter().map(move |row| place.map_or(f64::NAN, |k| row[k]))
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
    bonds_header, bonds_row(state: &State),
    bonds = state.bonds(),
}

columns! {
    missed_header, missed_row(scene: &Scene, report: &StepReport),
    narrow_error = report.missed.map_or(f64::NAN, |missed| missed.mean / scene.mean_radius),
    narrow_error_largest = report.missed.map_or(f64::NAN, |missed| missed.largest / scene.mean_radius),
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
    gravity_removed = report.gravity.removed,
    gravity_extrapolation = report.gravity.extrapolation,
    gravity_sampled = report.gravity.sampled.map_or(f64::NAN, |sampled| sampled.rms),
    gravity_sampled_largest = report.gravity.sampled.map_or(f64::NAN, |sampled| sampled.largest),
    gravity_sampled_virial = report.gravity.sampled.map_or(f64::NAN, |sampled| sampled.virial),
    virial = report.virial,
    flight_error = report.flight,
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
        let (mut table, kept) = Table::open(&path, "step,a", 0, 2).unwrap();
        assert_eq!(kept.column("step").collect::<Vec<_>>(), [1.0, 2.0]);
        assert!(kept.column("a").chain(kept.column("b")).all(f64::is_nan));
        table.row("3,new").unwrap();
        table.flush().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "step,a\n1,x\n2,y\n3,new\n");
    }

    #[test]
    fn other_columns_leave_those_that_were_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        std::fs::write(&path, "step,a,h\n1,x,0.5\n2,y,0.5\n").unwrap();
        let (mut table, kept) = Table::open(&path, "step,a,norm", 0, 2).unwrap();
        assert_eq!(kept.column("h").collect::<Vec<_>>(), [0.5, 0.5]);
        table.row("3,z,7").unwrap();
        table.flush().unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(text, "step,a,norm,h\n1,x,,0.5\n2,y,,0.5\n3,z,7,\n");
        // What is no table of steps, and a row that is none.
        for (old, rows) in [("name,b\n1,x\n", ""), ("step,a\n1,x\noh\n2,y\n", "1,x\n"), ("", "")] {
            std::fs::write(&path, old).unwrap();
            Table::open(&path, "step,a", 0, 2).unwrap();
            assert_eq!(std::fs::read_to_string(&path).unwrap(), format!("step,a\n{rows}"));
        }
    }
}
