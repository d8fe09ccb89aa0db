//! Stage: writes state and reports to the files of OUTBOX.

mod appended;
pub mod checksums;
pub mod errors;
pub mod exchange;
mod log;
pub mod postpro;
mod probes;
mod problem;
mod snapshot;
pub mod summary;
pub mod text;
mod text_inputs;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

use cd_formats::atomic::{folder_entries, path_exists};
use cd_formats::checksums::CHECKSUMS_FILE;
use cd_formats::error::{Fault, Faults};
use cd_formats::lock::FolderLock;
use cd_formats::snapshot::{list_snapshots, remove_orphan_parts, snapshot_path};

use crate::ranks;
use crate::scene::Scene;
use crate::state::State;
use crate::step::{StageTimes, StepReport};

use self::appended::{AppendedFile, check_in_place};
use self::checksums::{ResultChecksums, ResumedSnapshot};
use self::postpro::PostproFiles;
use self::probes::ProbeFiles;
use errors::ErrorEstimator;
use log::{LogCell, LogTable, RowSchedule};

pub use log::DAMAGED_LOG_ADVICE;
pub use problem::{check_dump_step, write_problem};

/// Results of a case: snapshots and `steps.csv` in OUTBOX, `TIMER.csv` next to it. Durations are kept apart, so that
/// equal runs have equal bytes in OUTBOX.
pub struct ResultFiles {
    outbox: PathBuf,
    /// Opened folder at `outbox`; none if the system does not open folders.
    folder: Option<File>,
    checksums: ResultChecksums,
    steps: LogTable,
    timer: LogTable,
    schedule: RowSchedule,
    /// Offset of the numbers of text files.
    number_offset: u64,
    postpro: PostproFiles,
    probes: ProbeFiles,
    /// Number of bodies in a part of a snapshot.
    part_bodies: Option<usize>,
}

/// Messages about files that a run has opened.
#[derive(Debug, Clone, Default)]
pub struct OpeningNotes {
    /// Notes about logs that lack rows of earlier steps.
    pub missing_rows: Vec<String>,
    /// Warning of files of DATBOX that have changed since the run began.
    pub changed_inputs: Option<String>,
}

/// Path of a case's OUTBOX.
pub fn outbox_path(case: &Path) -> PathBuf {
    case.join("OUTBOX")
}

/// Locks the OUTBOX of a case for this run and creates it if needed. A DATBOX may be shared.
///
/// Errors: another run has locked it, or it cannot be created. If folders cannot be locked, every run gets it.
pub fn lock_outbox(case: &Path) -> Result<FolderLock, Faults> {
    FolderLock::exclusive(&outbox_path(case))?.ok_or_else(|| {
        let expected = "wait for it, or use another folder";
        Fault::new(case, None, "folder", "another run is writing to it", expected).into()
    })
}

/// Whether a run of cd-solve has begun in this case: the log of steps is the first file that it writes, before those that it
/// never writes over others.
pub fn has_begun(case: &Path) -> bool {
    path_exists(&outbox_path(case).join(log::STEPS_FILE))
}

/// Rejects a case that has results; files of LMGC90 count only if this run would overwrite them.
pub fn check_no_results(case: &Path, scene: &Scene) -> Result<(), Faults> {
    let outbox = outbox_path(case);
    let file_name = |path: &Path| path.file_name().unwrap_or_default().display().to_string();
    if let Some((_, last)) = list_snapshots(&outbox)?.last() {
        let expected = "use --resume to continue from it, --force to overwrite all results";
        return Err(Fault::new(&outbox, None, "results", format!("{} exists", file_name(last)), expected).into());
    }
    let texts = text::text_names_of_new_run().into_iter().map(|name| outbox.join(name)).filter(|_| scene.options.text);
    let text_conflicts = texts.map(|path| (path, "--text would overwrite it; use --force to remove such files"));
    let command_conflicts = postpro::paths(case, scene).into_iter();
    let command_conflicts =
        command_conflicts.map(|path| (path, "POSTPRO.DAT would overwrite it; use --force to do so"));
    let probe_conflicts = probes::paths(case, scene).into_iter();
    let probe_conflicts = probe_conflicts.map(|path| (path, "a probe would overwrite it; use --force to do so"));
    match text_conflicts.chain(command_conflicts).chain(probe_conflicts).find(|(path, _)| path_exists(path)) {
        Some((path, expected)) => {
            let folder = path.parent().unwrap_or(case);
            Err(Fault::new(folder, None, "results", format!("{} exists", file_name(&path)), expected).into())
        }
        None => Ok(()),
    }
}

/// Removes the files that an earlier run wrote, and nothing else.
pub fn remove_results(case: &Path) -> Result<(), Faults> {
    let outbox = outbox_path(case);
    let is_output = |name: &str| {
        (name.starts_with("snapshot-") && name.ends_with(".npz"))
            || [log::STEPS_FILE, CHECKSUMS_FILE].contains(&name)
            || text::is_state_name(name)
    };
    let mut removed = vec![case.join(log::TIMER_FILE), case.join(errors::ERRORS_FILE)];
    let is_written = |path: &PathBuf| path.file_name().and_then(|name| name.to_str()).is_some_and(is_output);
    removed.extend(folder_entries(&outbox)?.into_iter().filter(is_written));
    removed.extend(text_inputs::written_copies(&outbox));
    for path in removed.iter().filter(|path| path_exists(path)) {
        std::fs::remove_file(path).map_err(|error| Fault::from_io(path, "removed", &error))?;
    }
    Ok(())
}

impl ResultFiles {
    /// Opens the results for a run that continues from `state`; rows of later steps are dropped. Rows of earlier steps
    /// initialise the error estimator. Snapshots are written in parts of `part_bodies` bodies, if that is given.
    pub fn open(
        case: &Path,
        scene: &Scene,
        state: &State,
        part_bodies: Option<usize>,
    ) -> Result<(Self, ErrorEstimator, OpeningNotes), Faults> {
        let outbox = outbox_path(case);
        remove_orphan_parts(&outbox)?;
        let options = &scene.options;
        let schedule = RowSchedule { log_every: options.log_every, output_every: options.output_every };
        let [mut columns, mut seconds] = [log::FIGURES.to_vec(), log::SECONDS.to_vec()];
        if scene.options.adaptive().is_on() {
            columns.extend(log::LENGTH);
        }
        if scene.has_bonds() {
            columns.extend(log::BONDS);
        }
        if scene.narrow_phase_is_fast() {
            columns.extend(log::NARROW_PHASE);
        }
        if options.lmgc90_norms {
            columns.extend(log::NORMS);
        }
        if options.log_every > 1 {
            columns.extend(log::ROW_STEPS);
            seconds.extend(log::ROW_STEPS);
        }
        let steps = [scene.start.step, state.step];
        let is_resumed = snapshot_path(&outbox, state.step).is_file();
        if is_resumed {
            ResultChecksums::reopen(&outbox, state.step)?;
        }
        let mut estimator = ErrorEstimator::new(options.output_every);
        let log =
            LogTable::open(&outbox.join(log::STEPS_FILE), &columns, steps, schedule, |row| estimator.add_figures(row))?;
        let timer =
            LogTable::open(&case.join(log::TIMER_FILE), &seconds, steps, schedule, |row| estimator.add_seconds(row))?;
        let number_offset = if options.text { text::number_offset(&outbox, scene, state)? } else { 0 };
        if options.text {
            text_inputs::write_input_copies(&case.join("DATBOX"), &outbox, options)?;
        }
        let postpro = PostproFiles::open(case, scene, state)?;
        let probes = ProbeFiles::open(case, scene, state)?;
        let resumed_snapshot =
            is_resumed.then(|| ResumedSnapshot { step: state.step, is_due: is_snapshot_due(scene, state) });
        let logs = logs_with_checksums(&log, &postpro, &probes);
        let (checksums, changed_inputs) = ResultChecksums::open(case, &outbox, resumed_snapshot, &logs)?;
        let tables = [&log, &timer].into_iter().chain(probes.tables());
        let notes = OpeningNotes {
            missing_rows: tables.filter_map(LogTable::missing_rows_note).map(str::to_string).collect(),
            changed_inputs: (!changed_inputs.is_empty()).then(|| {
                format!(
                    "{}: changed or removed since this run began: {}; the run continues with the present files; --force \
                     starts anew",
                    outbox.display(),
                    changed_inputs.join(", ")
                )
            }),
        };
        let folder = File::open(&outbox).ok();
        let files = ResultFiles {
            outbox,
            folder,
            checksums,
            steps: log,
            timer,
            schedule,
            number_offset,
            postpro,
            probes,
            part_bodies,
        };
        Ok((files, estimator, notes))
    }

    /// Errors if OUTBOX is no longer the folder that the run has opened.
    fn check_folder(&self) -> Result<(), Faults> {
        self.folder.as_ref().map_or(Ok(()), |folder| check_in_place(&self.outbox, folder, "folder"))
    }

    /// Adds a step to the logs, and the rows that they write to `estimator`.
    pub fn add_step(
        &mut self,
        scene: &Scene,
        state: &State,
        report: &StepReport,
        times: &StageTimes,
        estimator: &mut ErrorEstimator,
    ) -> Result<(), Faults> {
        let [figures, seconds] = log_cells(scene, state, report, times);
        self.steps.add_step(figures, self.schedule, |row| estimator.add_figures(row))?;
        self.timer.add_step(seconds, self.schedule, |row| estimator.add_seconds(row))
    }

    /// Adds a step, which follows step `previous_step`, to the files of POSTPRO.DAT.
    pub fn add_postpro(
        &mut self,
        scene: &Scene,
        state: &mut State,
        report: &StepReport,
        previous_step: u64,
    ) -> Result<(), Faults> {
        self.postpro.add_step(scene, state, report, previous_step)
    }

    /// Adds the values of the probes after a step.
    pub fn add_probes(&mut self, state: &State, values: &[Vec<f64>]) -> Result<(), Faults> {
        self.probes.add_step(state, values)
    }

    /// Writes the rows of the last steps of the run, which are not due.
    pub fn finish_rows(&mut self, estimator: &mut ErrorEstimator) -> Result<(), Faults> {
        self.steps.finish_rows(|row| estimator.add_figures(row))?;
        self.timer.finish_rows(|row| estimator.add_seconds(row))?;
        self.probes.finish_rows()
    }

    /// Flushes the rows so far, so that other programs can read them.
    pub fn flush_to_file(&mut self) -> Result<(), Faults> {
        self.check_folder()?;
        self.steps.flush_to_file()?;
        self.timer.flush_to_file()?;
        self.postpro.flush_to_file()?;
        self.probes.flush_to_file()
    }

    /// Writes DOF.LAST and Vloc_Rloc.LAST, at the end of a run.
    pub fn write_last(&self, scene: &Scene, state: &State) -> Result<(), Faults> {
        if scene.options.text { text::write_last(&self.outbox, scene, state) } else { Ok(()) }
    }

    /// Writes the state, after the log of the steps that led to it.
    pub fn write_state(&mut self, scene: &Scene, state: &State) -> Result<(), Faults> {
        self.check_folder()?;
        self.steps.sync_to_disk()?;
        self.timer.sync_to_disk()?;
        self.postpro.sync_to_disk()?;
        self.probes.sync_to_disk()?;
        if scene.options.text {
            text::write_text(&self.outbox, scene, state, self.number_offset)?;
        }
        let (snapshot, path) = (snapshot::state_snapshot(scene, state), snapshot_path(&self.outbox, state.step));
        match self.part_bodies {
            Some(part_bodies) => snapshot.write_in_parts(&path, part_bodies)?,
            None => snapshot.write_to_folder(&path)?,
        }
        self.checksums.add_snapshot(state.step, &logs_with_checksums(&self.steps, &self.postpro, &self.probes))?;
        self.forget_removed_rows()
    }

    /// Removes what a run that is resumed before its next snapshot needs of the logs.
    fn forget_removed_rows(&mut self) -> Result<(), Faults> {
        let mut tables = [&mut self.steps, &mut self.timer].into_iter().chain(self.probes.tables_mut());
        tables.try_for_each(LogTable::forget_removed_row)
    }

    /// Writes what a run lacks that is resumed at its end: its last rows, and the checksums of these and of its last snapshot.
    pub fn complete_ended_run(
        &mut self,
        scene: &Scene,
        state: &State,
        estimator: &mut ErrorEstimator,
    ) -> Result<(), Faults> {
        self.finish_rows(estimator)?;
        self.flush_to_file()?;
        if !is_snapshot_due(scene, state) {
            let logs = logs_with_checksums(&self.steps, &self.postpro, &self.probes);
            self.checksums.add_snapshot(state.step, &logs)?;
        }
        self.forget_removed_rows()?;
        self.finish_checksums()
    }

    /// Adds the logs of the run, which ends, to the list of checksums.
    pub fn finish_checksums(&mut self) -> Result<(), Faults> {
        self.checksums.add_logs(&logs_with_checksums(&self.steps, &self.postpro, &self.probes))
    }
}

/// Whether a snapshot of the present step is due, as the first one of a run or by its schedule.
fn is_snapshot_due(scene: &Scene, state: &State) -> bool {
    state.step == scene.start.step || state.step.is_multiple_of(scene.options.output_every)
}

/// Files of a run that grow and are covered by checksums: all but TIMER.csv, since equal runs take different times.
fn logs_with_checksums<'a>(
    steps: &'a LogTable,
    postpro: &'a PostproFiles,
    probes: &'a ProbeFiles,
) -> Vec<&'a AppendedFile> {
    [steps.file()].into_iter().chain(postpro.files()).chain(probes.files()).collect()
}

/// Results of a run, which only one of its ranks writes.
pub struct RunOutput(Option<ResultFiles>);

impl RunOutput {
    /// Opens the results, see [`ResultFiles::open`], if this rank is the one that writes them.
    pub fn open(
        is_writer: bool,
        case: &Path,
        scene: &Scene,
        state: &State,
        part_bodies: Option<usize>,
    ) -> Result<(Self, ErrorEstimator, OpeningNotes), Faults> {
        if !is_writer {
            let estimator = ErrorEstimator::new(scene.options.output_every);
            return Ok((RunOutput(None), estimator, OpeningNotes::default()));
        }
        let (files, estimator, notes) = ranks::compute_alone(|| ResultFiles::open(case, scene, state, part_bodies))?;
        Ok((RunOutput(Some(files)), estimator, notes))
    }

    /// Applies `write` to the files of the rank that has them.
    pub fn write(&mut self, write: impl FnOnce(&mut ResultFiles) -> Result<(), Faults>) -> Result<(), Faults> {
        let Some(files) = &mut self.0 else { return Ok(()) };
        // If OUTBOX was moved away, that is the reason, not a file that is missing in it.
        ranks::compute_alone(|| write(files).or_else(|faults| files.check_folder().and(Err(faults))))
    }
}

/// Cells of a step in `steps.csv` and in `TIMER.csv`.
fn log_cells(scene: &Scene, state: &State, report: &StepReport, times: &StageTimes) -> [Vec<LogCell>; 2] {
    let options = &scene.options;
    let [mut figures, mut seconds] = [log::figures(scene, state, report), log::seconds(state.step, times)];
    if options.adaptive().is_on() {
        figures.extend(log::length(report));
    }
    if scene.has_bonds() {
        figures.extend(log::bonds(state));
    }
    if scene.narrow_phase_is_fast() {
        figures.extend(log::narrow_phase(scene, report));
    }
    if options.lmgc90_norms {
        figures.extend(report.norms.iter().flat_map(log::norms));
    }
    if options.log_every > 1 {
        figures.extend(log::row_steps());
        seconds.extend(log::row_steps());
    }
    [figures, seconds]
}

/// Number of decimal digits.
fn digits(number: u64) -> usize {
    number.to_string().len()
}

/// Sizes of a row of both logs together, and of a snapshot, bytes.
pub fn output_sizes(scene: &Scene, state: &State, report: &StepReport) -> [usize; 2] {
    // Durations have more digits than zero.
    let second = Duration::from_nanos(123_456);
    let [gravity, detection, assembly, solve, integration, writing] = [second; 6];
    let times = StageTimes { gravity, detection, assembly, solve, integration, writing };
    let [figures, mut seconds] = log_cells(scene, state, report, &times);
    if scene.options.log_every > 1 {
        seconds.iter_mut().for_each(log::LogCell::add_rounding);
    }
    let further_digits = digits(scene.last_step()).saturating_sub(digits(state.step));
    let rows = [figures, seconds].map(|cells| log::row_size(&cells) + further_digits).into_iter().sum();
    [rows, snapshot::state_snapshot(scene, state).to_bytes().len()]
}
