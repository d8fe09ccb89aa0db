//! Command line of cd-solve: reads the arguments and the case, runs it or plans its run, and turns failures into messages
//! and an exit code.

use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::case::{CaseFolder, case_fault};
use cd_formats::command_line::parse_arguments;
use cd_formats::compute::{Adaptive, ComputeFlags, MAX_THREADS};
use cd_formats::error::{Fault, Faults, MAX_REPORTED_LINES};
use cd_formats::former_names::FormerNameUse;
use cd_formats::lock::FolderLock;
use cd_formats::messages::{print_error, print_line, print_warning, reserve_stdout, silence};
use cd_formats::settings::former_names_of_setting;
use clap::{CommandFactory, Parser};

use crate::accuracy_control::begin_control;
use crate::math::simd::SimdWidth;
use crate::ranks::launch::begin_session;
use crate::ranks::{Communicator, SingleRank, all_gather_unsized, set_communicator};
use crate::read::driver::DriverSettings;
use crate::run::{RunFailure, RunMode, check_run, record_changed_forces, run_case};
use crate::scene::Scene;
use crate::state::State;
use crate::verify::{self, Verification, verify_case};
use crate::{activity, agreement, plan, read, thread_pool, write};

const PROGRAM: &str = "cd-solve";

/// Simulates rigid grains in contact: reads DIR/DATBOX, writes DIR/OUTBOX.
///
/// The method is Non-Smooth Contact Dynamics. Files and units are described in docs/reference/.
#[derive(Debug, Parser)]
#[command(name = PROGRAM, version)]
struct CommandLine {
    /// Case folder; only DIR/DATBOX is required.
    dir: PathBuf,
    /// Continue from the last snapshot in DIR/OUTBOX.
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// With --resume: continue from the last snapshot that is sound; later ones, which are damaged, are renamed to NAME.damaged.
    #[arg(long, requires = "resume", conflicts_with = "plan")]
    skip_damaged: bool,
    /// Remove the results of an earlier run and start at the beginning.
    #[arg(long)]
    force: bool,
    /// Estimate the cost of the run (models, memory, disk, time of a step, bounds on h) and write no files.
    #[arg(long, conflicts_with = "dump_problem")]
    plan: bool,
    /// Compare the files of the case with their checksums and read all snapshots; name the damaged ones, and the step from which a run can continue.
    #[arg(long, conflicts_with_all = ["plan", "resume", "force", "dump_problem", "step_loop"])]
    verify: bool,
    /// With --plan: divide the sweeps of the next step among this number of processes, and estimate their time.
    #[arg(long, value_name = "RANKS", requires = "plan", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    ranks: Option<u32>,
    /// Write the contact problem of this step of the run to DIR/problem-STEP.fc3d.
    #[arg(long, value_name = "STEP")]
    dump_problem: Option<u64>,
    /// Write a snapshot of more bodies than this in parts of BODIES bodies; see docs/reference/files/snapshots.md.
    #[arg(long, value_name = "BODIES", conflicts_with = "plan", value_parser = clap::value_parser!(u64).range(1..))]
    part_bodies: Option<u64>,
    /// Take the options from a command script of LMGC90, which is read without running Python; options given here override it.
    #[arg(long, value_name = "SCRIPT")]
    lmgc90: Option<PathBuf>,
    /// Exchange states and forces of each step with another program on standard output and input, in binary; see docs/reference/running.md.
    #[arg(long, conflicts_with_all = ["plan", "dump_problem"])]
    step_loop: bool,
    /// Do not wait until files are on the disk, which takes milliseconds for each snapshot. If the machine fails, the last files may then be damaged or lost.
    #[arg(long, conflicts_with_all = ["plan", "verify"])]
    no_sync: bool,
    /// Compute with vectors of this width instead of the largest of the machine, for tests: no result depends on it.
    #[arg(long, value_name = "NAME", hide = true)]
    vector_width: Option<SimdWidth>,
    #[command(flatten)]
    flags: ComputeFlags,
}

/// Definition of the command line, from which manual pages and completions are made.
pub fn command() -> clap::Command {
    CommandLine::command()
}

/// Runs the program; returns its exit code: 0 done, 1 `--verify` has found damage, 2 input rejected, 3 internal error, 4 ended
/// early, as a stop was requested or files could not be written.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> i32 {
    let args: Vec<OsString> = arguments.into_iter().collect();
    match begin_session() {
        Ok(session) => run_on_rank(session.communicator, &args),
        Err(faults) => {
            print_error(faults.format_report(PROGRAM).trim_end());
            2
        }
    }
}

/// Runs the program as one of the ranks. Only rank 0 writes files and messages.
fn run_on_rank(communicator: &'static dyn Communicator, args: &[OsString]) -> i32 {
    if communicator.size() > 1 {
        activity::stop_by_agreement();
    }
    if communicator.rank() > 0 {
        silence();
    }
    let arguments: CommandLine = match parse_arguments(args) {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    if arguments.step_loop {
        reserve_stdout();
    }
    if let Some(width) = arguments.vector_width {
        width.set_for_process();
    }
    atomic::set_syncing(!arguments.no_sync);
    if arguments.verify {
        return if communicator.rank() == 0 { verify(&arguments.dir) } else { 0 };
    }
    former_names_in_flags(args).iter().for_each(|warning| print_warning(PROGRAM, warning));
    let damaged_set_aside = if arguments.skip_damaged { skip_damaged(&arguments, communicator) } else { Ok(()) };
    let prepared = damaged_set_aside.map_err(RunFailure::Files).and_then(|()| prepare_case(&arguments, communicator));
    let prepared = agreement::agreed_case(communicator, prepared, |case| (&case.scene, &case.state));
    // Faults of reading are exchanged by `agreed_case`, so that all ranks end; faults of a run are known to this rank alone.
    let has_begun = prepared.is_ok();
    match prepared.and_then(|case| advance_case(&arguments, case, communicator)) {
        Ok(summary) => {
            let title = if arguments.plan { "plan" } else { "done" };
            print_line(format_args!("{PROGRAM}: {title}\n{}", summary.trim_end()));
            0
        }
        Err(failure) => {
            let (message, code) = match &failure {
                RunFailure::Files(faults) => (faults.format_report(PROGRAM), 2),
                RunFailure::Unwritten(faults) => (faults.format_report(PROGRAM), 4),
                RunFailure::Stopped(message) => (format!("{PROGRAM}: {message}"), 4),
                RunFailure::Broken(message) => (format!("{PROGRAM}: internal: {message}"), 3),
            };
            print_error(message.trim_end());
            if communicator.size() > 1
                && has_begun
                && matches!(failure, RunFailure::Files(_) | RunFailure::Unwritten(_))
            {
                if communicator.rank() > 0 {
                    let _ = writeln!(std::io::stderr(), "{} (rank {})", message.trim_end(), communicator.rank());
                }
                communicator.abort(code);
            }
            code
        }
    }
}

/// Compares a case with its checksums; returns the exit code.
fn verify(case: &Path) -> i32 {
    let verification = match case_fault(case, CaseFolder::Datbox, PROGRAM) {
        Some(fault) => Err(fault.into()),
        None => verify_case(case),
    };
    match verification {
        Ok(Verification { text, is_sound, .. }) => {
            print_line(format_args!("{PROGRAM}: verify\n{}", text.trim_end()));
            i32::from(!is_sound)
        }
        Err(faults) => {
            print_error(faults.format_report(PROGRAM).trim_end());
            2
        }
    }
}

/// Sets damaged snapshots aside, on rank 0, before any rank reads the last one. Errors: another run uses the folder, or no
/// snapshot is sound.
fn skip_damaged(arguments: &CommandLine, communicator: &dyn Communicator) -> Result<(), Faults> {
    let case = &arguments.dir;
    let set_aside = || {
        // A folder that is no case is rejected with all other faults.
        let _lock = if write::outbox_path(case).is_dir() { write::lock_outbox(case)? } else { return Ok(Vec::new()) };
        verify::set_damaged_aside(case)
    };
    let renamed = if communicator.rank() == 0 { set_aside() } else { Ok(Vec::new()) };
    // All ranks wait for rank 0.
    all_gather_unsized(communicator, &[]);
    let renamed = renamed?;
    for path in renamed.iter().take(MAX_REPORTED_LINES) {
        print_warning(PROGRAM, format_args!("{}: set aside: the snapshot is damaged", path.display()));
    }
    if renamed.len() > MAX_REPORTED_LINES {
        print_warning(PROGRAM, format_args!("{} more files set aside", renamed.len() - MAX_REPORTED_LINES));
    }
    Ok(())
}

/// Warnings about former names in the values of flags: `--adaptive: most: renamed; write max_multiple`.
fn former_names_in_flags(args: &[OsString]) -> Vec<String> {
    let flags = args.iter().enumerate().filter_map(|(k, arg)| {
        let flag = arg.to_str()?.strip_prefix("--")?;
        flag.split_once('=').or_else(|| Some((flag, args.get(k + 1)?.to_str()?)))
    });
    let warnings = flags.flat_map(|(flag, value)| {
        let uses = former_names_of_setting(&format!("{}={value}", flag.replace('-', "_")));
        uses.into_iter().map(move |FormerNameUse { name, .. }| {
            format!("--{flag}: {}: renamed; write {}", name.former, name.current)
        })
    });
    warnings.collect()
}

/// A case that was read, before anything is computed.
struct PreparedCase {
    scene: Scene,
    state: State,
    /// Whether `state` has been read from a snapshot.
    resumed: bool,
    /// Threads that have read it, and their number as given.
    reading_pool: (rayon::ThreadPool, usize),
    /// Lock of OUTBOX until the run ends; only rank 0 has it, and only if it writes.
    _lock: Option<FolderLock>,
}

/// Reads a case and checks whether it can run. Each rank does so alone, as any of them may find faults. The lock is that of
/// rank 0.
fn prepare_case(arguments: &CommandLine, communicator: &'static dyn Communicator) -> Result<PreparedCase, RunFailure> {
    let case = &arguments.dir;
    if let Some(fault) = case_fault(case, CaseFolder::Datbox, PROGRAM) {
        return Err(RunFailure::Files(fault.into()));
    }
    if arguments.step_loop && communicator.size() > 1 {
        let (found, expected) =
            (format!("runs on {} ranks", communicator.size()), "expected one process, without mpirun");
        return Err(RunFailure::Files(Fault::new("options".as_ref(), None, "--step-loop", found, expected).into()));
    }
    let driver = match &arguments.lmgc90 {
        Some(script) => read::driver::read_driver(script, case, &arguments.flags)?,
        None => DriverSettings::default(),
    };
    let flags = arguments.flags.or(&driver.options);
    let reading_threads = flags.threads.filter(|&threads| threads <= MAX_THREADS).unwrap_or(0);
    let reading_pool = start_threads(reading_threads, &SingleRank)?;
    let (mut scene, mut state) = reading_pool.install(|| read::read_case(case, &flags))?;
    if arguments.step_loop && (scene.options.adaptive().is_on() || scene.options.target_error.is_some()) {
        scene.options.adaptive = Some(Adaptive { max_multiple: 1, ..scene.options.adaptive() });
        scene.notes.push("adaptive: steps are dt in a step loop, whose forces may change in each of them".into());
    }
    if arguments.step_loop && scene.roster.is_some() {
        let (found, expected) = ("with sinks or sources", "expected none of these options: each answer has all bodies");
        return Err(RunFailure::Files(Fault::new("options".as_ref(), None, "--step-loop", found, expected).into()));
    }
    if let Some(gravity) = driver.gravity {
        read::replace_gravity(gravity, &scene, &mut state);
    }
    scene.notes.splice(0..0, driver.notes);
    let lock = if arguments.plan || communicator.rank() > 0 { None } else { Some(write::lock_outbox(case)?) };
    scene.notes.iter().for_each(|note| print_line(format_args!("{PROGRAM}: {note}")));
    scene.warnings.iter().for_each(|warning| print_warning(PROGRAM, warning));
    let mut resumed = false;
    if arguments.resume {
        resumed = resume_case(case, &flags, &mut scene, &mut state)?;
    } else if !arguments.force && !arguments.plan {
        write::check_no_results(case, &scene)?;
    }
    begin_control(&mut scene, &mut state);
    check_run(&scene, &state)?;
    if let Some(step) = arguments.dump_problem {
        write::check_dump_step(&scene, &state, step)?;
    }
    Ok(PreparedCase { scene, state, resumed, reading_pool: (reading_pool, reading_threads), _lock: lock })
}

/// Replaces the state by the state of the last snapshot, and reports the options that have changed since; returns whether there
/// is a snapshot. Without one, a case is rejected whose results are of another program; with one, if it or the logs up to it differ
/// from their checksums.
fn resume_case(case: &Path, flags: &ComputeFlags, scene: &mut Scene, state: &mut State) -> Result<bool, Faults> {
    let outbox = write::outbox_path(case);
    let Some(snapshot) = read::resume::restore_last(&outbox, scene, state)? else {
        if !write::has_begun(case) {
            write::check_no_results(case, scene)?;
        }
        print_line(format_args!("{PROGRAM}: no snapshot to resume from: starting from DATBOX"));
        return Ok(false);
    };
    verify::check_last_snapshot(case)?;
    record_changed_forces(scene, &snapshot.parameters, &case.join("DATBOX"), state)?;
    // The initial state has no text in OUTBOX, as it is in DATBOX.
    let has_text = (state.step > scene.start.step).then(|| write::text::is_written(&outbox, state)).transpose()?;
    let (warnings, notes) = snapshot.option_changes(scene, has_text, &flags.given_names());
    warnings.iter().for_each(|warning| print_warning(PROGRAM, warning));
    notes.iter().for_each(|note| print_line(format_args!("{PROGRAM}: {note}")));
    Ok(true)
}

/// Runs a case, or plans its run; returns the summary.
fn advance_case(
    arguments: &CommandLine,
    prepared: PreparedCase,
    communicator: &'static dyn Communicator,
) -> Result<String, RunFailure> {
    let (case, PreparedCase { scene, state, resumed, reading_pool, _lock }) = (&arguments.dir, prepared);
    let (reading_pool, reading_threads) = reading_pool;
    // Allocators keep the memory that a thread has freed for this thread: others would need as much again.
    let reading_pool = (reading_threads == scene.options.threads).then_some(reading_pool);
    let pool_without_ranks = || reading_pool.map_or_else(|| start_threads(scene.options.threads, &SingleRank), Ok);
    if arguments.plan {
        let planned_ranks = arguments.ranks.map(|ranks| ranks as usize);
        let plan = || plan::plan_text(&scene, &state, planned_ranks);
        // The trial steps of a plan end after some time, which differs between ranks, so that they cannot make them together.
        return if communicator.rank() == 0 { Ok(pool_without_ranks()?.install(plan)) } else { Ok(String::new()) };
    }
    let pool = match communicator.size() {
        1 => pool_without_ranks()?,
        _ => {
            drop(pool_without_ranks);
            start_threads(scene.options.threads, communicator)?
        }
    };
    // Nothing is rejected from here on.
    if communicator.rank() == 0 {
        if arguments.force {
            write::remove_results(case)?;
        }
        // A run that was killed at a step without a planned snapshot may have left one of a name that is not written again.
        atomic::remove_temporary_files(&write::outbox_path(case));
    }
    let mode = RunMode {
        resumed,
        dump_step: arguments.dump_problem,
        step_loop: arguments.step_loop,
        part_bodies: arguments.part_bodies.map(|bodies| usize::try_from(bodies).unwrap_or(usize::MAX)),
    };
    let advance = || run_case(case, &scene, state, mode);
    let wait_busily = scene.bodies.len() >= thread_pool::MIN_BODIES_TO_BUSY_WAIT;
    pool.install(|| if wait_busily { thread_pool::with_busy_waiting_workers(advance) } else { advance() })
}

/// Starts `threads` threads that belong to a rank; for 0, one for each processor.
fn start_threads(threads: usize, communicator: &'static dyn Communicator) -> Result<rayon::ThreadPool, RunFailure> {
    let builder =
        rayon::ThreadPoolBuilder::new().num_threads(threads).start_handler(move |_| set_communicator(communicator));
    builder.build().map_err(|_| {
        let found = format!("{threads} cannot be started");
        RunFailure::Files(Faults::from(Fault::new(
            "options".as_ref(),
            None,
            "threads",
            found,
            "expected a number of threads that the machine can start",
        )))
    })
}
