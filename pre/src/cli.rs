//! Command line of cd-pre.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use cd_formats::case::parse_arguments;
use cd_formats::ron_text::nearest_name;
use cd_formats::tell::{print_error, print_line};
use clap::{CommandFactory, Parser};

use crate::datbox::write_datbox;
use crate::{from_outbox, study};

/// Makes DATBOX, the input of cd-solve, from a scene.
///
/// The scene names materials, contact laws, bodies of grains (their sizes, their places, their initial
/// motion), walls and the options of the run; docs/scene.md describes every field. A scene that is at
/// fault is refused with all its faults, and nothing is written.
#[derive(Debug, Parser)]
#[command(name = "cd-pre", version, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// The scene, in RON.
    #[arg(value_name = "scene.ron", required = true)]
    scene: Option<PathBuf>,
    /// Folder in which DATBOX is written; without it, the scene's own.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Another value in the scene: names of fields and places in lists, from 1, as in grains.1.number=2000; may be repeated.
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Makes DATBOX from a snapshot of another case: its bodies, laws and contacts, bit for bit.
    ///
    /// A file of changes, described in docs/from-outbox.md, may keep the largest remnant alone, move and spin it,
    /// add bodies of other runs and new ones, and set other laws and options.
    FromOutbox {
        /// Folder of the case with DATBOX and OUTBOX.
        case: PathBuf,
        /// Folder in which the new DATBOX is written.
        dir: PathBuf,
        /// What is to be different, in RON.
        #[arg(long, value_name = "changes.ron")]
        changes: Option<PathBuf>,
        /// Another value in the changes, as compute.dt=1; may be repeated.
        #[arg(long, value_name = "PATH=VALUE")]
        set: Vec<String>,
    },
    /// Writes a folder with a scene for each combination of parameters.
    ///
    /// The study names a base scene, parameters with their paths and values, and a pattern for the names of the folders;
    /// docs/study.md describes every field. All cases are checked first; if one is refused, nothing is written.
    Study {
        /// The study, in RON.
        #[arg(value_name = "study.ron")]
        study: PathBuf,
        /// Folder in which the folders of the cases are written; default: that of the study.
        #[arg(short, long, value_name = "DIR")]
        output: Option<PathBuf>,
        /// Another value in the study, as groups.1.seeds=[1,2,3]; may be repeated.
        #[arg(long, value_name = "PATH=VALUE")]
        set: Vec<String>,
    },
}

/// Runs the program; `args` as from [`std::env::args_os`], the program's name first.
///
/// Returns the exit code: 0 done, 2 input refused (faults on stderr, no file written).
pub fn run(args: impl IntoIterator<Item = OsString>) -> i32 {
    let args: Vec<OsString> = args.into_iter().collect();
    let first = args.get(1).and_then(|first| first.to_str()).unwrap_or_default();
    let commands = Arguments::command();
    let commands: Vec<&str> = commands.get_subcommands().map(|command| command.get_name()).collect();
    let unknown = !commands.contains(&first) && !first.starts_with('-') && !Path::new(first).exists();
    if let Some(near) = nearest_name(first, &commands).filter(|_| unknown) {
        print_error(format_args!("cd-pre: {first}: is no file and no command; did you mean {near}?"));
        return 2;
    }
    let arguments: Arguments = match parse_arguments(&args) {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    let written = match arguments.command {
        Some(Command::FromOutbox { case, dir, changes, set }) => {
            from_outbox::write_datbox(&case, changes.as_deref(), &set, &dir)
        }
        Some(Command::Study { study, output, set }) => study::write(&study, &set, output.as_deref()),
        None => {
            let scene = arguments.scene.unwrap_or_default();
            let folder = arguments.output.unwrap_or_else(|| scene.parent().unwrap_or(Path::new("")).to_path_buf());
            write_datbox(&scene, &arguments.set, &folder.join("DATBOX"))
        }
    };
    match written {
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
