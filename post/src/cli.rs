//! Command line of cd-post.

use std::ffi::OsString;
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use cd_formats::case::{CaseFolder, no_case, parse_arguments};
use cd_formats::error::Faults;
use cd_formats::ron_text::nearest_name;
use cd_formats::tell::{print_error, print_line};
use clap::{CommandFactory, Parser};

use crate::commands::series::process_case;
use crate::commands::{accuracy_study, compare, report, state, study, track};
use crate::options::{Measures, Options, SlopeReach, parse_finite};

/// Measures the snapshots of a case and draws them.
///
/// Reads DIR/OUTBOX/snapshot-*.npz; writes DIR/POSTPRO (series.csv, plots, a picture) and DIR/DISPLAY
/// (ParaView files, which paraview --script=DIR/DISPLAY/view.py shows). The shapes of polyhedra are
/// read from DIR/DATBOX/BODIES.DAT. A folder whose name is that of a command below is given as
/// ./NAME.
#[derive(Debug, Clone, Parser)]
#[command(name = "cd-post", version, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    options: Options,
}

#[derive(Debug, Clone, clap::Subcommand)]
enum Command {
    /// One snapshot in depth: profiles, forces, fabric, fragments with orbits, ejecta, surface.
    ///
    /// Writes DIR/POSTPRO/state-NNNNNN.
    State {
        /// The case directory
        #[arg(default_value = ".")]
        dir: PathBuf,
        /// Step of the snapshot; without it the last
        #[arg(long, value_name = "STEP")]
        snapshot: Option<u64>,
        /// Layers of a bed are means over so many snapshots up to that one
        #[arg(long, value_name = "COUNT", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
        mean: u32,
        #[command(flatten)]
        slope: SlopeReach,
    },
    /// The same observable of several runs in one figure, and their values in one table.
    ///
    /// Reads the POSTPRO/series.csv of each, which cd-post writes.
    Compare {
        /// The case directories
        #[arg(required = true, num_args = 1..)]
        dirs: Vec<PathBuf>,
        /// Folder in which NAME.svg and NAME.csv are written
        #[arg(short, long, default_value = "compare")]
        output: PathBuf,
        /// Names of the runs, in their order; without them those of their folders
        #[arg(long, value_delimiter = ',')]
        labels: Vec<String>,
        /// Table below POSTPRO of each case: series.csv, one of `cd-post state`, such as state/profile.csv for the last
        /// state of each, or of `cd-post track`, such as track-1/track.csv
        #[arg(long, default_value = "series.csv", value_name = "FILE")]
        table: PathBuf,
        /// Columns of the table; without them those of the plots
        #[arg(long, value_delimiter = ',')]
        columns: Vec<String>,
        /// Column of the horizontal axis; without it time, or the first of the table
        #[arg(long)]
        against: Option<String>,
    },
    /// Many runs, each by its means over the end, and how they go with the number of grains; fitted lines and cost.
    ///
    /// Reads of each POSTPRO/series.csv, OUTBOX/steps.csv, TIMER.csv and the last snapshot.
    Study {
        /// The case directories
        #[arg(required = true, num_args = 1..)]
        dirs: Vec<PathBuf>,
        /// Folder in which runs.csv, fits.csv and the figures are written
        #[arg(short, long, default_value = "study")]
        output: PathBuf,
        /// One name a run, the same for those that the figures show as one; without them all are one
        #[arg(long, value_delimiter = ',')]
        groups: Vec<String>,
        /// Time from which snapshots count for the means, s; without it the last alone
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_finite)]
        from: Option<f64>,
        /// Time up to which they count, s; without it the end
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_finite)]
        until: Option<f64>,
    },
    /// Runs of one scene against the finest: errors of what is observed, and the time that they took.
    ///
    /// Reads of each POSTPRO/series.csv, TIMER.csv, ERRORS.csv and snapshots.
    Trade {
        /// The case directories; errors are against that of `accuracy: reference`, else against the last. Or folders that this
        /// command has written, of several realisations of a scene
        #[arg(required = true, num_args = 2..)]
        dirs: Vec<PathBuf>,
        /// Folder in which trade.csv, orders.csv and trade.svg are written
        #[arg(short, long, default_value = "trade")]
        output: PathBuf,
        /// One name a run, of the option that it is about
        #[arg(long, value_delimiter = ',')]
        groups: Vec<String>,
        /// One number a run, the value of that option; nan where it is none
        #[arg(long, value_delimiter = ',')]
        values: Vec<f64>,
        /// Time from which snapshots count, s; without it the last alone
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_finite)]
        from: Option<f64>,
        /// Time from which on positions are compared at the first snapshot, s; without it, at the first after the start
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_finite)]
        early: Option<f64>,
        /// Title of the figure
        #[arg(long, value_name = "TEXT", default_value = "Error against time")]
        title: String,
    },
    /// One body in a bed of grains, such as a lander: its way, depth, force, bounce and crater.
    ///
    /// Writes DIR/POSTPRO/track-N.
    Track {
        /// The case directory
        #[arg(default_value = ".")]
        dir: PathBuf,
        /// Number of the body in BODIES.DAT
        #[arg(long, value_name = "N")]
        body: u64,
    },
    /// The run on one page that needs nothing else: figures, numbers, options, the grains to turn and zoom.
    ///
    /// Writes DIR/POSTPRO/report.html.
    Report {
        /// The case directory
        #[arg(default_value = ".")]
        dir: PathBuf,
        /// Take every Nth snapshot, counted from the first, and the last
        #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
        every: u32,
        #[command(flatten)]
        measures: Measures,
    },
}

impl Arguments {
    /// Folder of the case to which the command writes.
    fn case_dir(&self) -> Option<&Path> {
        match &self.command {
            None => Some(&self.options.dir),
            Some(Command::State { dir, .. } | Command::Track { dir, .. } | Command::Report { dir, .. }) => Some(dir),
            Some(Command::Compare { .. } | Command::Study { .. } | Command::Trade { .. }) => None,
        }
    }

    /// Errors if folders are not those of cases.
    fn folders(&self) -> Result<(), Faults> {
        let (dirs, part) = match &self.command {
            Some(Command::Compare { dirs, .. } | Command::Study { dirs, .. } | Command::Trade { dirs, .. }) => {
                (dirs.iter().map(PathBuf::as_path).collect(), CaseFolder::Any)
            }
            _ => (Vec::from_iter(self.case_dir()), CaseFolder::Outbox),
        };
        Faults(dirs.into_iter().filter_map(|dir| no_case(dir, part, "cd-post")).collect()).into_result(())
    }
}

/// Message about a first argument that is neither a folder nor a command, but resembles a command.
fn misspelt_command(args: &[OsString]) -> Option<String> {
    let first = args.get(1)?.to_str().filter(|first| !first.starts_with('-') && !Path::new(first).exists())?;
    let command = Arguments::command();
    let names: Vec<&str> = command.get_subcommands().map(|command| command.get_name()).chain(["help"]).collect();
    if names.contains(&first) {
        return None;
    }
    Some(format!("{first}: is no folder and no command; did you mean {}?", nearest_name(first, &names)?))
}

/// Locks a case for this run until the file is dropped; waits for another run that works in it. Two runs would write the
/// same files, and each would remove files of the other.
///
/// If files cannot be locked, every run proceeds.
fn lock_case(case: &Path) -> Option<File> {
    let folder = File::open(case).ok()?;
    if matches!(folder.try_lock(), Err(TryLockError::WouldBlock)) {
        print_error(format_args!("cd-post: {}: another cd-post is at work in it; waiting for its end", case.display()));
        folder.lock().ok()?;
    }
    Some(folder)
}

/// Runs the program: reads the command line, does the work, prints messages.
///
/// Returns the exit status: 0 success; 1 success with messages; 2 input rejected, each fault on a line of stderr as
/// `cd-post: file: object: found; expected`.
pub fn run(args: impl IntoIterator<Item = OsString>) -> i32 {
    let args: Vec<OsString> = args.into_iter().collect();
    if let Some(message) = misspelt_command(&args) {
        print_error(format_args!("cd-post: {message}"));
        return 2;
    }
    let arguments: Arguments = match parse_arguments(&args) {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    if let Err(faults) = arguments.folders() {
        print_error(faults.format_report("cd-post").trim_end());
        return 2;
    }
    let Arguments { command, options } = &arguments;
    let pool = match rayon::ThreadPoolBuilder::new().num_threads(options.threads).build() {
        Ok(pool) => pool,
        Err(_) => {
            print_error(format_args!(
                "cd-post: options: threads: {} cannot be started; expected a number that the system allows",
                options.threads
            ));
            return 2;
        }
    };
    let _alone = arguments.case_dir().and_then(lock_case);
    let done = pool.install(|| match command {
        None => process_case(options),
        Some(Command::State { dir, snapshot, mean, slope }) => state::write(dir, *snapshot, *mean, slope.slope_reach)
            .map(|(folder, notes)| {
                print_line(format_args!("cd-post: {}", folder.display()));
                notes
            }),
        Some(Command::Compare { dirs, output, labels, table, columns, against }) => {
            let compared = compare::ComparisonOptions { table, columns, against: against.as_deref() };
            compare::write(dirs, labels, &compared, output).map(|(count, notes)| {
                print_line(format_args!("cd-post: {count} figures in {}", output.display()));
                notes
            })
        }
        Some(Command::Study { dirs, output, groups, from, until }) => study::write(dirs, groups, *from, *until, output)
            .map(|(count, notes)| {
                print_line(format_args!("cd-post: {} runs, {count} figures in {}", dirs.len(), output.display()));
                notes
            }),
        Some(Command::Trade { dirs, output, groups, values, from, early, title }) => {
            let asked = accuracy_study::TradeOptions { groups, values, from: *from, early: *early };
            accuracy_study::write(dirs, &asked, title, output).map(|(table, notes)| {
                print_line(format_args!("cd-post: {} runs in {}\n{table}", dirs.len(), output.display()));
                notes
            })
        }
        Some(Command::Track { dir, body }) => track::write(dir, *body).map(|(folder, notes)| {
            print_line(format_args!("cd-post: {}", folder.display()));
            notes
        }),
        Some(Command::Report { dir, every, measures }) => report::write(dir, *every, measures).map(|(page, notes)| {
            print_line(format_args!("cd-post: {}", page.display()));
            notes
        }),
    });
    match done {
        Ok(notes) => {
            notes.iter().for_each(|note| print_error(format_args!("cd-post: {note}")));
            i32::from(!notes.is_empty())
        }
        Err(faults) => {
            print_error(faults.format_report("cd-post").trim_end());
            2
        }
    }
}
