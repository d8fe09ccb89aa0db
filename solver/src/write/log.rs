//! Logs: CSV files with a row per step or per group of steps, `steps.csv` in OUTBOX and `TIMER.csv` next to it, and their
//! columns. The files of probes are logs, too.

use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use cd_formats::atomic::{self, path_exists};
use cd_formats::error::{Fault, Faults};

use super::appended::AppendedFile;
use crate::scene::Scene;
use crate::solve::lmgc90_criteria::Lmgc90Norms;
use crate::state::State;
use crate::step::{StageTimes, StepReport};

/// File in OUTBOX with cost and error figures of every step.
pub const STEPS_FILE: &str = "steps.csv";
/// File next to OUTBOX with the seconds of every step by stage.
pub const TIMER_FILE: &str = "TIMER.csv";

/// Rule by which a row combines the figures of its steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnKind {
    /// Figure of the last step.
    Last,
    /// Last known figure; for figures that few steps have.
    Known,
    /// Sum over the steps of the row.
    Sum,
    /// Largest figure of the steps of the row.
    Largest,
    /// Mean over the steps of the row, weighted by their lengths in the column before, `h`, whose kind is `Sum`.
    Mean,
}

/// Name and kind of a column.
pub type LogColumn = (&'static str, ColumnKind);

/// Figure of one or several steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LogCell {
    Count(u64),
    Real(f64),
}

impl LogCell {
    /// Value as a number.
    pub fn to_f64(self) -> f64 {
        match self {
            LogCell::Count(n) => n as f64,
            LogCell::Real(x) => x,
        }
    }

    /// Returns the shortest decimals that read back as the same number; empty if not finite, as in all tables of this
    /// project.
    fn to_text(self) -> String {
        match self {
            LogCell::Count(n) => n.to_string(),
            LogCell::Real(x) if x.is_finite() => format!("{x:e}"),
            LogCell::Real(_) => String::new(),
        }
    }

    fn from_text(text: &str) -> Self {
        text.parse().map_or_else(|_| LogCell::Real(text.parse().unwrap_or(f64::NAN)), LogCell::Count)
    }

    /// Makes a real number as long as sums of many, which have rounding errors.
    pub fn add_rounding(&mut self) {
        if let LogCell::Real(x) = self {
            // A seventh has digits without end.
            *x /= 7.0;
        }
    }

    /// Combines the figure with the figure of a later step, which has this share of the length of both.
    fn add(&mut self, kind: ColumnKind, later: LogCell, share: f64) {
        *self = match (kind, *self, later) {
            (ColumnKind::Last, _, later) => later,
            (ColumnKind::Known, known, LogCell::Real(x)) if x.is_nan() => known,
            (ColumnKind::Known, _, later) => later,
            (ColumnKind::Sum, LogCell::Count(a), LogCell::Count(b)) => LogCell::Count(a + b),
            (ColumnKind::Sum, a, b) => LogCell::Real(a.to_f64() + b.to_f64()),
            (ColumnKind::Mean, a, b) => LogCell::Real(a.to_f64() + (b.to_f64() - a.to_f64()) * share),
            (ColumnKind::Largest, LogCell::Count(a), LogCell::Count(b)) => LogCell::Count(a.max(b)),
            (ColumnKind::Largest, a, b) => LogCell::Real(a.to_f64().max(b.to_f64())),
        };
    }
}

/// CSV file whose first column is the step.
pub struct LogTable {
    file: AppendedFile,
    columns: Vec<LogColumn>,
    /// Empty fields for columns that an earlier part of the run had and this one does not.
    trailing_fields: String,
    /// Figures of the steps since the last row.
    pending: Option<Vec<LogCell>>,
    /// Step of the last row.
    last_row: u64,
    /// Computes the figures of a row that follow from its others, if there are such.
    completion: Option<RowCompletion>,
    /// Message about missing rows, if any are.
    missing_rows_note: Option<String>,
    /// File with the row that was removed when the table was opened, until the next snapshot.
    removed_row: Option<PathBuf>,
}

/// Computes the figures of a row that follow from its others.
pub type RowCompletion = fn(&mut [LogCell]);

/// Figures of a row by name.
pub struct LogRow<'a> {
    names: &'a [&'a str],
    cells: &'a [LogCell],
}

impl LogRow<'_> {
    /// Returns the figure; NaN for an empty field or an unknown column.
    pub fn get(&self, name: &str) -> f64 {
        let index = self.names.iter().position(|column| *column == name);
        index.map_or(f64::NAN, |k| self.cells[k].to_f64())
    }
}

/// Schedule of rows.
#[derive(Debug, Clone, Copy)]
pub struct RowSchedule {
    /// Steps between two rows, and between two snapshots; each snapshot has a row.
    pub log_every: u64,
    pub output_every: u64,
}

impl RowSchedule {
    /// Whether a row is due after `step`, if the previous row was after `last`.
    fn is_due_after(&self, step: u64, last: u64) -> bool {
        step / self.log_every > last / self.log_every || step.is_multiple_of(self.output_every)
    }
}

impl LogTable {
    /// Opens the file to continue after step `resume_step`, in a run that began after step `first_step`. Rows up to
    /// `resume_step` are kept and passed to `record`; columns that a row does not have, because of other options, are empty.
    /// If the last row was not due and was only written because the run ended, it is removed: the following steps belong to
    /// it. Until the next snapshot, see [`Self::forget_removed_row`], it is in a file of its own, from which a run that is
    /// resumed once more takes it. Rows that are missing have a note, see [`Self::missing_rows_note`].
    ///
    /// Errors: the file cannot be read or written, or has a line before `resume_step` that is no row.
    pub fn open(
        path: &Path,
        columns: &[LogColumn],
        [first_step, resume_step]: [u64; 2],
        schedule: RowSchedule,
        mut record: impl FnMut(&LogRow),
    ) -> Result<Self, Faults> {
        let removed_row = removed_row_path(path);
        let mut old = LogReader::open(path, [first_step, resume_step])?;
        let mut names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
        let own_count = names.len();
        let old_names = old.names.clone();
        let is_other = |name: &&str| !name.is_empty() && !columns.iter().any(|(own_name, _)| own_name == name);
        names.extend(old_names.iter().map(String::as_str).filter(is_other));
        let old_indices: Vec<Option<usize>> =
            names.iter().map(|column| old_names.iter().position(|name| name == column)).collect();
        let (mut last_row, mut previous_row) = (first_step, first_step);
        let mut pending: Option<(String, Vec<LogCell>)> = None;
        let mut copy_rows = |file: &mut dyn Write| -> Result<(), Faults> {
            let mut write_line = |line: &str| -> Result<(), Faults> {
                writeln!(file, "{line}").map_err(|error| Fault::from_io(path, "written", &error).into())
            };
            write_line(&names.join(","))?;
            while let Some((step, fields)) = old.next_row(&removed_row)? {
                if let Some((text, cells)) = pending.take() {
                    write_line(&text)?;
                    record(&LogRow { names: &names, cells: &cells });
                }
                let fields: Vec<&str> =
                    old_indices.iter().map(|index| index.map_or("", |k| fields[k].as_str())).collect();
                pending = Some((fields.join(","), fields.iter().map(|field| LogCell::from_text(field)).collect()));
                (previous_row, last_row) = (last_row, step);
            }
            if schedule.is_due_after(last_row, previous_row)
                && let Some((text, cells)) = pending.take()
            {
                write_line(&text)?;
                record(&LogRow { names: &names, cells: &cells });
                previous_row = last_row;
            }
            // Before the table without the row has replaced that with it.
            pending.as_ref().map_or(Ok(()), |(text, _)| {
                atomic::write(&removed_row, format!("{}\n{text}\n", names.join(",")).as_bytes())
            })
        };
        let mut faults = Faults::default();
        let written = atomic::write_with(path, |file| {
            copy_rows(file).map_err(|copy_faults| {
                faults = copy_faults;
                io::Error::other("rows that cannot be copied")
            })
        });
        faults.into_result(())?;
        written?;
        let missing_rows_note = (last_row < resume_step).then(|| {
            let first_missing = last_row + 1;
            format!(
                "{}: no rows of steps {first_missing} to {resume_step}, which were computed before this run",
                path.display()
            )
        });
        Ok(LogTable {
            file: AppendedFile::open(path)?,
            columns: columns.to_vec(),
            trailing_fields: ",".repeat(names.len() - own_count),
            pending: pending.map(|(_, cells)| cells[..own_count].to_vec()),
            last_row: previous_row,
            completion: None,
            missing_rows_note,
            removed_row: Some(removed_row).filter(|file| path_exists(file)),
        })
    }

    /// Removes the file with the row that was removed when the table was opened: there is a later snapshot.
    pub fn forget_removed_row(&mut self) -> Result<(), Faults> {
        match self.removed_row.take().map(|file| (std::fs::remove_file(&file), file)) {
            Some((Err(error), file)) if error.kind() != io::ErrorKind::NotFound => {
                Err(Fault::from_io(&file, "removed", &error).into())
            }
            _ => Ok(()),
        }
    }

    /// Message about the rows up to the step of the resume that the file did not have, if any.
    pub fn missing_rows_note(&self) -> Option<&str> {
        self.missing_rows_note.as_deref()
    }

    /// The same table, whose rows are completed by `completion` before they are written.
    pub fn with_completion(self, completion: RowCompletion) -> Self {
        LogTable { completion: Some(completion), ..self }
    }

    /// Adds the figures of a step. If a row is due, writes it and passes it to `record`.
    pub fn add_step(
        &mut self,
        cells: Vec<LogCell>,
        schedule: RowSchedule,
        record: impl FnOnce(&LogRow),
    ) -> Result<(), Faults> {
        let step = cells[0].to_f64() as u64;
        match &mut self.pending {
            None => self.pending = Some(cells),
            Some(pending) => {
                let length_column = self.columns.iter().position(|(name, _)| *name == "h");
                let share =
                    length_column.map_or(1.0, |k| cells[k].to_f64() / (pending[k].to_f64() + cells[k].to_f64()));
                let columns = pending.iter_mut().zip(&self.columns).zip(cells);
                columns.for_each(|((sum, (_, kind)), cell)| sum.add(*kind, cell, share));
            }
        }
        if schedule.is_due_after(step, self.last_row) { self.finish_rows(record) } else { Ok(()) }
    }

    /// Writes the row of the steps since the last row, if there are any, and passes it to `record`.
    pub fn finish_rows(&mut self, record: impl FnOnce(&LogRow)) -> Result<(), Faults> {
        let Some(mut cells) = self.pending.take() else { return Ok(()) };
        if let Some(complete) = self.completion {
            complete(&mut cells);
        }
        let text: Vec<String> = cells.iter().map(|cell| cell.to_text()).collect();
        let names: Vec<&str> = self.columns.iter().map(|(name, _)| *name).collect();
        record(&LogRow { names: &names, cells: &cells });
        self.last_row = cells[0].to_f64() as u64;
        self.file.append(&format!("{}{}\n", text.join(","), self.trailing_fields))
    }

    /// The file with the rows so far.
    pub fn file(&self) -> &AppendedFile {
        &self.file
    }

    /// Flushes the rows, so that other programs can read them.
    pub fn flush_to_file(&mut self) -> Result<(), Faults> {
        self.file.flush_to_file()
    }

    /// Syncs the rows to disk, so that no snapshot exists without the rows before it.
    pub fn sync_to_disk(&mut self) -> Result<(), Faults> {
        self.file.sync_to_disk()
    }
}

/// Advice about a log that is damaged.
pub const DAMAGED_LOG_ADVICE: &str = "restore the file, or rename it to continue without its rows";

/// File with the row of a log that was removed when a run continued.
fn removed_row_path(path: &Path) -> PathBuf {
    path.with_file_name(format!(".{}.last", path.file_name().unwrap_or_default().to_string_lossy()))
}

/// Rows of a log up to the step from which a run continues.
struct LogReader {
    path: PathBuf,
    file: Box<dyn BufRead>,
    names: Vec<String>,
    /// Number of the last line that was read, from 1.
    line: usize,
    /// Step of the last row that was read, or the first step of the run.
    last_step: u64,
    resume_step: u64,
}

impl LogReader {
    /// Opens a log; it has no rows if it does not exist, or if the run continues from its first step. Errors: it cannot be read,
    /// or is another table.
    fn open(path: &Path, [first_step, resume_step]: [u64; 2]) -> Result<LogReader, Faults> {
        let mut reader = LogReader {
            path: path.to_path_buf(),
            file: Box::new(io::empty()),
            names: Vec::new(),
            line: 0,
            last_step: first_step,
            resume_step,
        };
        if resume_step > first_step && path_exists(path) {
            reader.file = Box::new(BufReader::new(atomic::open_to_read(path)?));
            if let Some(header) = reader.next_line()? {
                reader.names = header.split(',').map(str::to_string).collect();
                if reader.names[0] != "step" {
                    return Err(reader.fault(&header, "expected a table whose first column is step"));
                }
            }
        }
        Ok(reader)
    }

    /// Step and fields of the next row up to `resume_step`. The row of this step may be in the file `removed_row`.
    fn next_row(&mut self, removed_row: &Path) -> Result<Option<(u64, Vec<String>)>, Faults> {
        let row = self.next_listed_row()?;
        if row.is_some() || self.last_step == self.resume_step {
            return Ok(row);
        }
        // A file of another run is left alone.
        let removed = LogReader::open(removed_row, [self.last_step, self.resume_step]).and_then(|mut removed| {
            let row = removed.next_listed_row()?;
            Ok(row.filter(|(step, _)| *step == self.resume_step && removed.names == self.names))
        });
        self.last_step = self.resume_step;
        Ok(removed.ok().flatten())
    }

    /// Step and fields of the next row of the file up to `resume_step`. Errors: the file cannot be read, or has another line.
    fn next_listed_row(&mut self) -> Result<Option<(u64, Vec<String>)>, Faults> {
        if self.last_step == self.resume_step {
            return Ok(None);
        }
        let Some(line) = self.next_line()? else { return Ok(None) };
        let fields: Vec<String> = line.split(',').map(str::to_string).collect();
        let step = fields[0].parse::<u64>().ok().filter(|step| *step > self.last_step);
        let (Some(step), true) = (step, fields.len() == self.names.len()) else {
            let expected = format!("expected {} fields, the first a step after {}", self.names.len(), self.last_step);
            return Err(self.fault(&line, &expected));
        };
        if step > self.resume_step {
            self.file = Box::new(io::empty());
            return Ok(None);
        }
        self.last_step = step;
        Ok(Some((step, fields)))
    }

    /// Next line without its end; `None` at the end of the file, or for a line without an end, which a killed run leaves.
    fn next_line(&mut self) -> Result<Option<String>, Faults> {
        let mut line = Vec::new();
        self.file.read_until(b'\n', &mut line).map_err(|error| Fault::from_io(&self.path, "read", &error))?;
        self.line += 1;
        Ok((line.pop() == Some(b'\n')).then(|| String::from_utf8_lossy(&line).into_owned()))
    }

    /// Fault of the last line.
    fn fault(&self, found: &str, expected: &str) -> Faults {
        let expected = format!("{expected}; {DAMAGED_LOG_ADVICE}");
        Fault::new(&self.path, Some(self.line), "row", found, expected).into()
    }
}

/// Size of a row of these cells, bytes.
pub fn row_size(cells: &[LogCell]) -> usize {
    cells.iter().map(|cell| cell.to_text().len() + 1).sum()
}

/// Defines columns of a log: a constant with their names and kinds, a module with a constant for each name, and a function
/// that returns the cells of a step.
macro_rules! columns {
    ($columns:ident, $cells:ident($($name:ident : $type:ty),*), $($column:ident: $kind:ident = $value:expr,)+) => {
        pub const $columns: &[LogColumn] = &[$((stringify!($column), ColumnKind::$kind)),+];
        /// Names of the columns.
        #[allow(non_upper_case_globals, dead_code, reason = "constants that are named like the columns")]
        pub mod $cells {
            $(pub const $column: &str = stringify!($column);)+
        }
        pub fn $cells($($name: $type),*) -> Vec<LogCell> { vec![$(LogCell::from($value)),+] }
    };
}

impl From<u64> for LogCell {
    fn from(n: u64) -> Self {
        LogCell::Count(n)
    }
}

impl From<usize> for LogCell {
    fn from(n: usize) -> Self {
        LogCell::Count(n as u64)
    }
}

impl From<f64> for LogCell {
    fn from(x: f64) -> Self {
        LogCell::Real(x)
    }
}

columns! {
    NORMS, norms(norms: &Lmgc90Norms),
    quad_dv: Largest = norms.quad_dv,
    quad_dvr: Largest = norms.quad_dvr,
    maxm_dv: Largest = norms.maxm_dv,
    maxm_dvr: Largest = norms.maxm_dvr,
    mean_dvor: Largest = norms.mean_dvor,
}

columns! {
    ROW_STEPS, row_steps(),
    steps: Sum = 1u64,
}

columns! {
    LENGTH, length(report: &StepReport),
    h: Sum = report.h,
}

columns! {
    BONDS, bonds(state: &State),
    bonds: Last = state.bond_count(),
}

columns! {
    NARROW_PHASE, narrow_phase(scene: &Scene, report: &StepReport),
    narrow_error: Known = report.narrow_phase_error.map_or(f64::NAN, |error| error.mean / scene.mean_radius),
    narrow_error_largest: Largest = report.narrow_phase_error.map_or(f64::NAN, |error| error.largest / scene.mean_radius),
}

columns! {
    FIGURES, figures(scene: &Scene, state: &State, report: &StepReport),
    step: Last = state.step,
    time: Last = state.time,
    contacts_listed: Largest = report.contacts_listed,
    contacts_solved: Largest = report.contacts_solved,
    contacts_active: Last = report.contacts_active,
    sweeps: Sum = report.sweeps,
    residual: Largest = report.residual,
    converged: Sum = report.converged as u64,
    penetration_largest: Largest = report.penetration_largest / scene.mean_radius,
    penetration_mean: Last = report.penetration_mean / scene.mean_radius,
    kinetic_energy: Last = report.kinetic,
    rotational_energy: Last = report.rotational,
    potential_energy: Last = report.potential,
    contact_work: Last = state.ledger.contact_work,
    friction_work: Last = state.ledger.friction_work,
    outside_work: Last = state.ledger.outside_work,
    momentum_drift: Last = report.momentum_drift,
    gravity_removed: Largest = report.gravity.removed,
    gravity_extrapolation: Largest = report.gravity.extrapolation,
    gravity_sampled: Known = report.gravity.sampled.map_or(f64::NAN, |sampled| sampled.rms),
    gravity_sampled_largest: Largest = report.gravity.sampled.map_or(f64::NAN, |sampled| sampled.largest),
    gravity_sampled_virial: Known = report.gravity.sampled.map_or(f64::NAN, |sampled| sampled.virial),
    virial: Last = report.virial,
    flight_error: Sum = report.flight_error,
}

columns! {
    SECONDS, seconds(step: u64, times: &StageTimes),
    step: Last = step,
    gravity: Sum = times.gravity.as_secs_f64(),
    detection: Sum = times.detection.as_secs_f64(),
    assembly: Sum = times.assembly.as_secs_f64(),
    solve: Sum = times.solve.as_secs_f64(),
    integration: Sum = times.integration.as_secs_f64(),
    writing: Sum = times.writing.as_secs_f64(),
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: &[LogColumn] = &[("step", ColumnKind::Last), ("a", ColumnKind::Sum)];
    const EACH: RowSchedule = RowSchedule { log_every: 1, output_every: 1000 };

    fn cells(step: u64, a: f64) -> Vec<LogCell> {
        vec![step.into(), a.into()]
    }

    #[test]
    fn continues_after_a_step_and_drops_what_is_later_or_torn() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        std::fs::write(&path, "step,a\n1,x\n2,1e0\n3,z\n4,").unwrap();
        let mut kept = Vec::new();
        let mut table =
            LogTable::open(&path, A, [0, 2], EACH, |row| kept.push(["step", "a", "b"].map(|name| row.get(name))))
                .unwrap();
        assert_eq!(kept.iter().map(|row| row[0]).collect::<Vec<_>>(), [1.0, 2.0]);
        assert!(kept[0][1].is_nan() && kept[1][1] == 1.0 && kept[1][2].is_nan());
        table.add_step(cells(3, 0.25), EACH, |row| assert_eq!(row.get("a"), 0.25)).unwrap();
        table.sync_to_disk().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "step,a\n1,x\n2,1e0\n3,2.5e-1\n");
    }

    #[test]
    fn other_columns_leave_those_that_were_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        std::fs::write(&path, "step,a,h\n1,x,0.5\n2,y,0.5\n").unwrap();
        let columns = [A, &[("norm", ColumnKind::Last)]].concat();
        let mut lengths = Vec::new();
        let mut table = LogTable::open(&path, &columns, [0, 2], EACH, |row| lengths.push(row.get("h"))).unwrap();
        assert_eq!(lengths, [0.5, 0.5]);
        table.add_step(vec![3u64.into(), 2.0.into(), 7u64.into()], EACH, |_| ()).unwrap();
        table.sync_to_disk().unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(text, "step,a,norm,h\n1,x,,0.5\n2,y,,0.5\n3,2e0,7,\n");
        std::fs::write(&path, "").unwrap();
        LogTable::open(&path, A, [0, 2], EACH, |_| ()).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "step,a\n");
    }

    #[test]
    fn lines_that_are_no_rows_are_rejected_and_nothing_is_changed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        for (old, line, expected) in [
            ("name,b\n1,x\n", "t.csv:1: row: name,b; ", "a table whose first column is step"),
            ("step,a\n1,x\noh\n2,y\n", "t.csv:3: row: oh; ", "2 fields, the first a step after 1"),
            ("step,a\n1,x\n2;y\n3,y\n", "t.csv:3: row: 2;y; ", "2 fields, the first a step after 1"),
            ("step,a\n1,x\n1,y\n", "t.csv:3: row: 1,y; ", "2 fields, the first a step after 1"),
        ] {
            std::fs::write(&path, old).unwrap();
            let faults = LogTable::open(&path, A, [0, 2], EACH, |_| ()).err().unwrap().to_string();
            let advice = "; restore the file, or rename it to continue without its rows";
            assert!(faults.contains(&format!("{line}expected {expected}{advice}")), "{faults}");
            assert_eq!(std::fs::read_to_string(&path).unwrap(), old);
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
            // A run that begins anew needs no old rows.
            LogTable::open(&path, A, [2, 2], EACH, |_| ()).unwrap();
            assert_eq!(std::fs::read_to_string(&path).unwrap(), "step,a\n");
        }
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        assert!(LogTable::open(&path, A, [0, 2], EACH, |_| ()).is_err());
    }

    #[test]
    fn rows_sum_up_steps_and_go_on_after_any_of_them() {
        const ALL: &[LogColumn] = &[
            ("step", ColumnKind::Last),
            ("sum", ColumnKind::Sum),
            ("most", ColumnKind::Largest),
            ("known", ColumnKind::Known),
        ];
        let due = RowSchedule { log_every: 4, output_every: 6 };
        let figures = |k: u64| -> Vec<LogCell> {
            let known = if k.is_multiple_of(5) { k as f64 } else { f64::NAN };
            vec![k.into(), (0.1 * k as f64).into(), (10.0 - k as f64).into(), known.into()]
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        let run = |from: u64, to: u64| {
            let mut table = LogTable::open(&path, ALL, [0, from], due, |_| ()).unwrap();
            (from + 1..=to).for_each(|k| table.add_step(figures(k), due, |_| ()).unwrap());
            table.finish_rows(|_| ()).unwrap();
            table.sync_to_disk().unwrap();
            std::fs::read_to_string(&path).unwrap()
        };
        let unbroken = run(0, 13);
        let steps: Vec<&str> = unbroken.lines().skip(1).map(|row| row.split(',').next().unwrap()).collect();
        assert_eq!(steps, ["4", "6", "8", "12", "13"]);
        assert!(unbroken.contains("\n6,1.1e0,5e0,5e0\n"), "{unbroken}");
        for broken in 1..13 {
            std::fs::remove_file(&path).unwrap();
            run(0, broken);
            // Interrupted before the next snapshot, with or without a later row.
            for later in [broken, broken + 1, broken + 5] {
                let mut table = LogTable::open(&path, ALL, [0, broken], due, |_| ()).unwrap();
                (broken + 1..=later).for_each(|k| table.add_step(figures(k), due, |_| ()).unwrap());
                table.sync_to_disk().unwrap();
            }
            assert_eq!(run(broken, 13), unbroken, "broken after step {broken}");
            LogTable::open(&path, ALL, [0, 13], due, |_| ()).unwrap().forget_removed_row().unwrap();
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        }
    }
}
