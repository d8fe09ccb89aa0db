//! Files of the probes: a row every few steps, in the folder POSTPRO next to OUTBOX.

use std::path::{Path, PathBuf};

use cd_formats::error::Faults;
use cd_formats::probe::{Probe, ProbeQuantity, RegionMeans};

use super::appended::AppendedFile;
use super::log::{ColumnKind, LogCell, LogColumn, LogTable, RowSchedule};
use super::postpro;
use crate::scene::Scene;
use crate::state::State;

/// Path of the file of a probe.
fn probe_path(case: &Path, probe: &Probe) -> PathBuf {
    case.join(postpro::FOLDER).join(format!("probe-{}.csv", probe.name))
}

/// Paths of the files of all probes of a scene.
pub fn paths(case: &Path, scene: &Scene) -> Vec<PathBuf> {
    scene.options.probes.iter().map(|probe| probe_path(case, probe)).collect()
}

/// Open files of all probes, each with the schedule of its rows.
pub struct ProbeFiles(Vec<(LogTable, RowSchedule)>);

impl ProbeFiles {
    /// Opens the files for a run that continues from `state`: rows up to its step are kept.
    pub fn open(case: &Path, scene: &Scene, state: &State) -> Result<Self, Faults> {
        let options = &scene.options;
        let open = |probe: &Probe| {
            // Forces and means over regions are means over the steps of a row, flows sums; other quantities are taken at its
            // last step.
            let kind = match probe.quantity {
                ProbeQuantity::Force { .. } | ProbeQuantity::Pressure { .. } | ProbeQuantity::Region { .. } => {
                    ColumnKind::Mean
                }
                ProbeQuantity::Motion { .. } | ProbeQuantity::Energy { .. } => ColumnKind::Last,
                ProbeQuantity::Crossing { .. } | ProbeQuantity::Removed { .. } | ProbeQuantity::Entered { .. } => {
                    ColumnKind::Sum
                }
            };
            let mut columns: Vec<LogColumn> =
                vec![("step", ColumnKind::Last), ("time", ColumnKind::Last), (STEP_LENGTH, ColumnKind::Sum)];
            columns.extend(probe.quantity.columns().iter().map(|name| (*name, kind)));
            let schedule = RowSchedule { log_every: probe.every, output_every: options.output_every };
            let steps = [scene.start.step, state.step];
            let table = LogTable::open(&probe_path(case, probe), &columns, steps, schedule, |_| ())?;
            let table = match probe.quantity {
                ProbeQuantity::Region { .. } => table.with_completion(complete_region_row),
                _ => table,
            };
            Ok((table, schedule))
        };
        Ok(ProbeFiles(options.probes.iter().map(open).collect::<Result<_, Faults>>()?))
    }

    /// Adds the values of the probes after a step, by probe and column.
    pub fn add_step(&mut self, state: &State, values: &[Vec<f64>]) -> Result<(), Faults> {
        for ((file, schedule), values) in self.0.iter_mut().zip(values) {
            let mut cells: Vec<LogCell> = vec![state.step.into(), state.time.into(), state.h.into()];
            cells.extend(values.iter().map(|&x| LogCell::from(x)));
            file.add_step(cells, *schedule, |_| ())?;
        }
        Ok(())
    }

    /// Writes the rows of the last steps of the run, which are not due.
    pub fn finish_rows(&mut self) -> Result<(), Faults> {
        self.0.iter_mut().try_for_each(|(file, _)| file.finish_rows(|_| ()))
    }

    /// All tables, in the order of the probes.
    pub fn tables(&self) -> impl Iterator<Item = &LogTable> {
        self.0.iter().map(|(table, _)| table)
    }

    /// All tables, in the order of the probes, to change them.
    pub fn tables_mut(&mut self) -> impl Iterator<Item = &mut LogTable> {
        self.0.iter_mut().map(|(table, _)| table)
    }

    /// All files, in the order of the probes.
    pub fn files(&self) -> impl Iterator<Item = &AppendedFile> {
        self.tables().map(LogTable::file)
    }

    /// Writes the rows so far, so that other programs can read them.
    pub fn flush_to_file(&mut self) -> Result<(), Faults> {
        self.0.iter_mut().try_for_each(|(file, _)| file.flush_to_file())
    }

    /// Writes the rows so far and waits until they are on the disk.
    pub fn sync_to_disk(&mut self) -> Result<(), Faults> {
        self.0.iter_mut().try_for_each(|(file, _)| file.sync_to_disk())
    }
}

/// Computes the columns of a region that follow from its others.
fn complete_region_row(cells: &mut [LogCell]) {
    let (_, own) = cells.split_at_mut(STEP_COLUMNS);
    let mut values: Vec<f64> = own.iter().map(|cell| cell.to_f64()).collect();
    RegionMeans::complete_columns(&mut values);
    own.iter_mut().zip(values).for_each(|(cell, value)| *cell = value.into());
}

/// Number of columns before those of the quantity: `step`, `time` and `h`.
const STEP_COLUMNS: usize = 3;
/// Column of the length of the steps of a row, s.
const STEP_LENGTH: &str = "h";
