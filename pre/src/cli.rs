//! Command line of cd-pre: its arguments, and the call of the command that they name.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use cd_formats::command_line::parse_arguments;
use cd_formats::messages::{parse_number, print_error, print_line};
use cd_formats::ron_text::nearest_name;
use clap::{CommandFactory, Parser};

use crate::datbox::write_datbox;
use crate::pour::{PourRequest, pour_grains, run_solver};
use crate::{accuracy_study, from_outbox, study};

/// Converts a scene to DATBOX, the input of cd-solve.
///
/// A scene contains materials, contact laws, groups of grains (sizes, positions, initial motion), walls and
/// the options of the run; docs/reference/scene/ describes all fields. All errors of a scene are reported together,
/// and nothing is written then.
#[derive(Debug, Parser)]
#[command(name = "cd-pre", version, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// Scene, in RON.
    #[arg(value_name = "scene.ron", required = true)]
    scene: Option<PathBuf>,
    /// Folder in which DATBOX is written; default: that of the scene.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Replaces a value of the scene; PATH joins names of fields and positions in lists, counted from 1, by dots, as in grains.1.number=2000. May be repeated.
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Makes DATBOX from a snapshot of another case, with its bodies, laws and contacts, bit for bit.
    ///
    /// A file of changes can select the largest remnant, move and rotate it, add bodies of other runs and new bodies,
    /// and set other laws and options; docs/reference/from-outbox.md describes all fields.
    FromOutbox {
        /// Folder of the case, with DATBOX and OUTBOX.
        case: PathBuf,
        /// Folder in which the new DATBOX is written.
        dir: PathBuf,
        /// File of changes, in RON; default: no changes.
        #[arg(long, value_name = "changes.ron")]
        changes: Option<PathBuf>,
        /// Replaces a value of the changes, as in compute.dt=1. May be repeated.
        #[arg(long, value_name = "PATH=VALUE")]
        set: Vec<String>,
    },
    /// Lets the grains of a scene come to rest, by cd-solve, and makes the DATBOX of the next run from their last state.
    ///
    /// The scene ends by a condition such as until: [AtRest(speed: 1e-3, during: 0.1)], or at its end_time. Its run is
    /// DIR/pour; docs/reference/from-outbox.md describes the changes.
    Pour {
        /// Scene of the grains that fall, in RON.
        #[arg(value_name = "scene.ron")]
        scene: PathBuf,
        /// Folder of the next run.
        dir: PathBuf,
        /// File of changes for the next run, in RON; default: no changes.
        #[arg(long, value_name = "changes.ron")]
        changes: Option<PathBuf>,
        /// Replaces a value of the scene, as in grains.1.number=2000. May be repeated.
        #[arg(long, value_name = "PATH=VALUE")]
        set: Vec<String>,
        /// Options of cd-solve, after --.
        #[arg(last = true, value_name = "OPTIONS")]
        solver_options: Vec<OsString>,
    },
    /// Writes a folder with a scene for each combination of parameters.
    ///
    /// A study contains a base scene, parameters with their paths and values, and a pattern for the names of the folders;
    /// docs/reference/study.md describes all fields. All cases are checked first; if one has an error, nothing is written.
    Study {
        /// Study, in RON.
        #[arg(value_name = "study.ron")]
        study: PathBuf,
        /// Folder in which the folders of the cases are written; default: that of the study.
        #[arg(short, long, value_name = "DIR")]
        output: Option<PathBuf>,
        /// Replaces a value of the study, as in groups.1.seeds=[1,2,3]. May be repeated.
        #[arg(long, value_name = "PATH=VALUE")]
        set: Vec<String>,
        /// Gives the groups with seeds the seeds 1 to N.
        #[arg(
            long,
            value_name = "N",
            allow_negative_numbers = true,
            value_parser = clap::value_parser!(u32).range(1..=1_000_000)
        )]
        replicates: Option<u32>,
    },
    /// Writes a study of the options of a scene that trade speed for accuracy, and a Makefile that runs it.
    ///
    /// The study has settings with other time steps, tolerances and presets, and a reference, each with several seeds.
    /// make -C DIR runs and compares them, and prints the options with which the scene has given errors at the lowest cost;
    /// docs/reference/accuracy-study.md describes the tables.
    AccuracyStudy {
        /// Scene, in RON.
        #[arg(value_name = "scene.ron")]
        scene: PathBuf,
        /// Folder in which study.ron and Makefile are written; default: accuracy-study next to the scene.
        #[arg(short, long, value_name = "DIR")]
        output: Option<PathBuf>,
        /// Number of seeds with which each setting runs; with one, errors have no bars.
        #[arg(
            long,
            value_name = "N",
            default_value_t = 5,
            allow_negative_numbers = true,
            value_parser = clap::value_parser!(u32).range(1..=1000)
        )]
        replicates: u32,
        /// Options that are varied, of dt, tol, adaptive, penetration_tol, theta, gravity_error, narrow_phase, target_error and
        /// accuracy, the presets; default: those that have an effect in the scene.
        #[arg(long, value_delimiter = ',', value_name = "OPTION,...")]
        options: Vec<String>,
        /// Time step of the reference, s; default: a quarter of the shortest of the other settings.
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_number)]
        reference_dt: Option<f64>,
    },
}

/// Definition of the command line, from which manual pages and completions are made.
pub fn command() -> clap::Command {
    Arguments::command()
}

/// Runs the program; `args` as from [`std::env::args_os`], the program's name first.
///
/// Returns the exit code: 0 done, 2 input rejected, or the run of `pour` did not end (faults on stderr).
pub fn run(args: impl IntoIterator<Item = OsString>) -> i32 {
    let args: Vec<OsString> = args.into_iter().collect();
    let first_word = args.get(1).and_then(|word| word.to_str()).unwrap_or_default();
    let commands = Arguments::command();
    let commands: Vec<&str> = commands.get_subcommands().map(|command| command.get_name()).collect();
    let is_unknown = !commands.contains(&first_word) && !first_word.starts_with('-') && !Path::new(first_word).exists();
    if let Some(near) = nearest_name(first_word, &commands).filter(|_| is_unknown) {
        print_error(format_args!("cd-pre: {first_word}: is neither a file nor a command; did you mean {near}?"));
        return 2;
    }
    let arguments: Arguments = match parse_arguments(&args) {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    let result = match arguments.command {
        Some(Command::FromOutbox { case, dir, changes, set }) => {
            from_outbox::write_datbox(&case, changes.as_deref(), &set, &dir)
        }
        Some(Command::Pour { scene, dir, changes, set, solver_options }) => {
            let request = PourRequest { scene: &scene, settings: &set, dir: &dir, changes: changes.as_deref() };
            pour_grains(&request, |case| run_solver(case, &solver_options))
        }
        Some(Command::Study { study, output, set, replicates }) => {
            study::write(&study, &set, replicates, output.as_deref())
        }
        Some(Command::AccuracyStudy { scene, output, replicates, options, reference_dt }) => {
            let folder = scene.parent().unwrap_or(Path::new("")).join("accuracy-study");
            accuracy_study::write(&accuracy_study::AccuracyStudyRequest {
                scene: &scene,
                options: &options,
                replicates,
                reference_dt,
                output: output.as_deref().unwrap_or(&folder),
            })
        }
        None => {
            let scene = arguments.scene.unwrap_or_default();
            let folder = arguments.output.unwrap_or_else(|| scene.parent().unwrap_or(Path::new("")).to_path_buf());
            write_datbox(&scene, &arguments.set, &folder.join("DATBOX"))
        }
    };
    match result {
        Ok(summary) => {
            print_line(summary.trim_end());
            0
        }
        Err(faults) => {
            print_error(faults.format_report("cd-pre").trim_end());
            2
        }
    }
}
