//! Command line of cd-post: runs one of the commands, and turns notes and faults into messages and an exit status.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use cd_formats::case::{CaseFolder, case_fault};
use cd_formats::command_line::parse_arguments;
use cd_formats::error::Faults;
use cd_formats::messages::{print_error, print_line, print_warning};
use cd_formats::names::count_text;
use cd_formats::ron_text::nearest_name;
use clap::{CommandFactory, Parser};

use crate::commands::series::process_case;
use crate::commands::{accuracy_study, compare, impact, movie, report, state, study, track, watch};
use crate::options::{
    AxesFlag, ImpactFlags, MeasurementFlags, SeriesOptions, SlopeReach, ThreadCount, parse_finite, parse_interval,
    parse_positive,
};
use crate::snapshots::lock_case;

/// Computes observables from the snapshots of a case, and writes plots and ParaView files.
///
/// Reads DIR/OUTBOX/snapshot-*.npz and, for shapes, DIR/DATBOX/BODIES.DAT. Writes DIR/POSTPRO (series.csv,
/// plots, pictures) and DIR/DISPLAY (ParaView files; show them with paraview --script=DIR/DISPLAY/view.py).
/// docs/reference/observables/ defines all observables. Write ./NAME for a folder that has the name of a command.
#[derive(Debug, Clone, Parser)]
#[command(name = "cd-post", version, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    options: SeriesOptions,
}

/// Name of `accuracy-study` in earlier versions.
const FORMER_ACCURACY_STUDY: &str = "trade";

/// Case, snapshots and measures of a page about a run.
#[derive(Debug, Clone, clap::Args)]
struct PageOptions {
    /// Case folder
    #[arg(default_value = ".")]
    dir: PathBuf,
    /// Use every Nth snapshot, counted from the first, and the last
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    #[command(flatten)]
    measures: MeasurementFlags,
    #[command(flatten)]
    threads: ThreadCount,
}

#[derive(Debug, Clone, clap::Subcommand)]
enum Command {
    /// Analyses one snapshot in detail: profiles, forces, fabric, fragments with orbits, ejecta, surface.
    ///
    /// Writes DIR/POSTPRO/state-NNNNNN.
    State {
        /// Case folder
        #[arg(default_value = ".")]
        dir: PathBuf,
        /// Step of the snapshot; default: the last
        #[arg(long, value_name = "STEP")]
        snapshot: Option<u64>,
        /// Number of snapshots over which the layers of a bed are averaged, ending with the analysed one
        #[arg(long, value_name = "COUNT", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
        mean: u32,
        #[command(flatten)]
        slope: SlopeReach,
        #[command(flatten)]
        axes: AxesFlag,
        #[command(flatten)]
        threads: ThreadCount,
    },
    /// Plots each observable of several runs in one figure, with their values in one table.
    ///
    /// Reads POSTPRO/series.csv of each case: run cd-post on the cases first.
    Compare {
        /// Case folders
        #[arg(required = true, num_args = 1.., value_name = "DIR")]
        dirs: Vec<PathBuf>,
        /// Folder for NAME.svg and NAME.csv of each observable NAME
        #[arg(short, long, default_value = "compare", value_name = "DIR")]
        output: PathBuf,
        /// Names of the runs, in their order; default: those of their folders
        #[arg(long, value_delimiter = ',', value_name = "NAME,...")]
        labels: Vec<String>,
        /// Table in POSTPRO of each case: series.csv, or one of `cd-post state`, such as state/profile.csv for the last
        /// state of each, of `cd-post track`, such as track-1/track.csv, of `cd-post impact`, such as impact/beta.csv, or of
        /// a probe, such as probe-lid.csv
        #[arg(long, default_value = "series.csv", value_name = "FILE")]
        table: PathBuf,
        /// Columns of the table; default: those of the plots
        #[arg(long, value_delimiter = ',', value_name = "COLUMN,...")]
        columns: Vec<String>,
        /// Column on the horizontal axis; default: time, or the first column of the table
        #[arg(long, value_name = "COLUMN")]
        against: Option<String>,
    },
    /// Compares the means of many runs: one row for each run, dependence on the number of grains, fitted lines, cost.
    ///
    /// Reads POSTPRO/series.csv, OUTBOX/steps.csv, TIMER.csv and the last snapshot of each case.
    Study {
        /// Case folders, or study.csv of `cd-pre study` for all of its cases with their parameters
        #[arg(required = true, num_args = 1.., value_name = "DIR")]
        dirs: Vec<PathBuf>,
        /// Folder for runs.csv, fits.csv and the figures
        #[arg(short, long, default_value = "study", value_name = "DIR")]
        output: PathBuf,
        /// Groups that the figures distinguish, one name for each run; default: a single group
        #[arg(long, value_delimiter = ',', value_name = "NAME,...", conflicts_with = "by")]
        groups: Vec<String>,
        /// Parameters of the study whose values are the groups
        #[arg(long, value_delimiter = ',', value_name = "PARAMETER,...")]
        by: Vec<String>,
        /// Table of `cd-pre study` with the parameters of the case folders
        #[arg(long, value_name = "study.csv")]
        parameters: Option<PathBuf>,
        /// Time from which on snapshots enter the means, s; default: the last snapshot only
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_finite)]
        from: Option<f64>,
        /// Time up to which snapshots enter the means, s; default: the end of the run
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_finite)]
        until: Option<f64>,
        /// Half the width of the 95 % confidence interval of a mean over seeds, relative to the mean, for which means.csv gives
        /// the number of runs that are needed
        #[arg(long, value_name = "X", default_value_t = 0.01, allow_negative_numbers = true, value_parser = parse_positive)]
        error: f64,
    },
    /// Plots error against run time, from runs of one scene that are compared with the most accurate of them.
    ///
    /// Reads POSTPRO/series.csv, TIMER.csv, ERRORS.csv and the snapshots of each case. Of a study with several seeds it
    /// separates bias from chance, fits orders of convergence, and prints the options of the fastest setting for each of
    /// the given errors.
    #[command(alias = FORMER_ACCURACY_STUDY)]
    AccuracyStudy {
        /// Case folders, which are compared with the one with `accuracy: reference`, else with the last; or study.csv of
        /// `cd-pre accuracy-study` or `cd-pre study` for all of its cases; or folders that this command has written for
        /// several realisations of a scene
        #[arg(required = true, num_args = 1.., value_name = "DIR")]
        dirs: Vec<PathBuf>,
        /// Folder for accuracy.csv, orders.csv and accuracy.svg
        #[arg(short, long, default_value = "accuracy-study", value_name = "DIR")]
        output: PathBuf,
        /// Name of the option that each run varies, one for each run
        #[arg(long, value_delimiter = ',', value_name = "OPTION,...")]
        groups: Vec<String>,
        /// Value of that option, one number for each run; nan if it is not a number
        #[arg(long, value_delimiter = ',', value_name = "VALUE,...")]
        values: Vec<f64>,
        /// Time from which on snapshots enter the means, s; default: the last snapshot only
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_finite)]
        from: Option<f64>,
        /// Time, s: positions are compared at the first snapshot after it; default: the first snapshot after the start
        #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = parse_finite)]
        early: Option<f64>,
        /// Table of `cd-pre study` with the parameters of the case folders
        #[arg(long, value_name = "study.csv")]
        parameters: Option<PathBuf>,
        /// Relative errors for which the fastest setting is recommended; default: 0.03,0.01,0.003
        #[arg(long, value_delimiter = ',', value_name = "X,...", allow_negative_numbers = true, value_parser = parse_positive)]
        error: Vec<f64>,
        /// Observables that shall have these errors, of Z, nu, pressure, a, b, c and energy; default: Z,nu,pressure
        #[arg(long, value_delimiter = ',', value_name = "NAME,...")]
        observables: Vec<String>,
        /// Title of the figure
        #[arg(long, value_name = "TEXT", default_value = "Error against time")]
        title: String,
    },
    /// Follows one body, such as a lander: trajectory, penetration depth, contact force, restitution, crater profile.
    ///
    /// Writes DIR/POSTPRO/track-N.
    Track {
        /// Case folder
        #[arg(default_value = ".")]
        dir: PathBuf,
        /// Number of the body in BODIES.DAT
        #[arg(long, value_name = "N")]
        body: u64,
        #[command(flatten)]
        axes: AxesFlag,
        #[command(flatten)]
        threads: ThreadCount,
    },
    /// Measures an impact: momentum enhancement, ejecta with their speeds and angles, diameter and depth of the crater.
    ///
    /// Writes DIR/POSTPRO/impact.
    Impact {
        /// Case folder
        #[arg(default_value = ".")]
        dir: PathBuf,
        #[command(flatten)]
        flags: ImpactFlags,
        #[command(flatten)]
        threads: ThreadCount,
    },
    /// Writes one HTML page of a run: figures, numbers, options, and the grains in an interactive view.
    ///
    /// Writes DIR/POSTPRO/report.html.
    Report(PageOptions),
    /// Makes a film of a run: the grains and walls of one snapshot after the other, seen from one position.
    ///
    /// Writes DIR/POSTPRO/movie.gif, which browsers, mail and office programs play.
    Movie(movie::MovieOptions),
    /// Keeps the page of a running case up to date until the run ends.
    ///
    /// Writes DIR/POSTPRO/report.html anew when there are new snapshots; the page in the browser loads them itself.
    Watch {
        /// Least time between two reports, s; they take a fifth of the time at most
        #[arg(long, default_value_t = 10.0, value_name = "S", value_parser = parse_interval)]
        interval: f64,
        #[command(flatten)]
        page: PageOptions,
    },
}

impl Command {
    /// Runs the command, prints the paths that it has written, and returns its notes.
    fn run(&self) -> Result<Vec<String>, Faults> {
        let print_path = |(path, notes): (PathBuf, Vec<String>)| {
            print_line(format_args!("cd-post: {}", path.display()));
            notes
        };
        match self {
            Command::State { dir, snapshot, mean, slope, axes, threads: _ } => {
                state::write(dir, *snapshot, *mean, slope.slope_reach, axes.axes).map(print_path)
            }
            Command::Track { dir, body, axes, threads: _ } => track::write(dir, *body, axes.axes).map(print_path),
            Command::Impact { dir, flags, threads: _ } => impact::write(dir, &flags.impact_options()).map(print_path),
            Command::Report(PageOptions { dir, every, measures, threads: _ }) => {
                report::write(dir, *every, measures, None).map(print_path)
            }
            Command::Movie(options) => movie::write(options).map(print_path),
            Command::Watch { interval, page: PageOptions { dir, every, measures, threads: _ } } => {
                watch::write(dir, *interval, *every, measures).map(print_path)
            }
            Command::Compare { dirs, output, labels, table, columns, against } => {
                let comparison = compare::ComparisonOptions { table, columns, x_column: against.as_deref() };
                let (count, notes) = compare::write(dirs, labels, &comparison, output)?;
                print_line(format_args!("cd-post: {} in {}", count_text(count, "figure"), output.display()));
                Ok(notes)
            }
            Command::Study { dirs, output, groups, by, parameters, from, until, error } => {
                let parameters = parameters.as_deref();
                let (from, to) = (*from, *until);
                let selected = study::StudyOptions { groups, grouping: by, parameters, from, to, error: *error };
                let summary = study::write(dirs, &selected, output)?;
                let [runs, figures] = [count_text(summary.runs, "run"), count_text(summary.figures, "figure")];
                print_line(format_args!("cd-post: {runs}, {figures} in {}", output.display()));
                if let Some(line) = &summary.replicates {
                    print_line(format_args!("cd-post: {line}"));
                }
                Ok(summary.notes)
            }
            Command::AccuracyStudy {
                dirs,
                output,
                groups,
                values,
                from,
                early,
                parameters,
                error,
                observables,
                title,
            } => {
                let (from, early) = (*from, *early);
                let (parameters, errors) = (parameters.as_deref(), &error[..]);
                let selected = accuracy_study::AccuracyStudyOptions {
                    groups,
                    values,
                    from,
                    early,
                    parameters,
                    errors,
                    observables,
                };
                let (table, notes) = accuracy_study::write(dirs, &selected, title, output)?;
                print_line(format_args!("cd-post: {table}"));
                Ok(notes)
            }
        }
    }
}

impl Arguments {
    /// Folder of the case to which the command writes.
    fn case_dir(&self) -> Option<&Path> {
        match &self.command {
            None => Some(&self.options.dir),
            Some(
                Command::State { dir, .. }
                | Command::Track { dir, .. }
                | Command::Impact { dir, .. }
                | Command::Report(PageOptions { dir, .. })
                | Command::Watch { page: PageOptions { dir, .. }, .. },
            ) => Some(dir),
            Some(Command::Movie(options)) => Some(&options.dir),
            Some(Command::Compare { .. } | Command::Study { .. } | Command::AccuracyStudy { .. }) => None,
        }
    }

    /// Number of threads to start; 0: one for each core.
    fn threads(&self) -> usize {
        match &self.command {
            None => self.options.threads.threads,
            Some(
                Command::State { threads, .. }
                | Command::Track { threads, .. }
                | Command::Impact { threads, .. }
                | Command::Report(PageOptions { threads, .. })
                | Command::Watch { page: PageOptions { threads, .. }, .. },
            ) => threads.threads,
            Some(Command::Movie(options)) => options.threads.threads,
            Some(Command::Compare { .. } | Command::Study { .. } | Command::AccuracyStudy { .. }) => 0,
        }
    }

    /// Errors if folders are not folders of cases.
    fn check_folders(&self) -> Result<(), Faults> {
        let (dirs, part) = match &self.command {
            Some(Command::Compare { dirs, .. } | Command::Study { dirs, .. } | Command::AccuracyStudy { dirs, .. }) => {
                let reads_tables = !matches!(self.command, Some(Command::Compare { .. }));
                let is_table = |dir: &&Path| reads_tables && study::is_study_table(dir);
                (dirs.iter().map(PathBuf::as_path).filter(|dir| !is_table(dir)).collect(), CaseFolder::Any)
            }
            _ => (Vec::from_iter(self.case_dir()), CaseFolder::Outbox),
        };
        Faults(dirs.into_iter().filter_map(|dir| case_fault(dir, part, "cd-post")).collect()).into_result(())
    }
}

/// Message about a first argument that is neither a folder nor a command, but resembles a command.
fn misspelt_command(args: &[OsString]) -> Option<String> {
    let first = args.get(1)?.to_str().filter(|first| !first.starts_with('-') && !Path::new(first).exists())?;
    let command = Arguments::command();
    let names: Vec<&str> =
        command.get_subcommands().map(|command| command.get_name()).chain(["help", FORMER_ACCURACY_STUDY]).collect();
    if names.contains(&first) {
        return None;
    }
    Some(format!("{first}: is neither a folder nor a command; did you mean {}?", nearest_name(first, &names)?))
}

/// Definition of the command line, from which manual pages and completions are made.
pub fn command() -> clap::Command {
    Arguments::command()
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
    if let Err(faults) = arguments.check_folders() {
        print_error(faults.format_report("cd-post").trim_end());
        return 2;
    }
    let Arguments { command, options } = &arguments;
    if let Some(Command::AccuracyStudy { output, .. }) = command
        && args.get(1).is_some_and(|name| name == FORMER_ACCURACY_STUDY)
    {
        let table = output.join("accuracy.csv");
        let renamed =
            format!("{FORMER_ACCURACY_STUDY}: renamed; write accuracy-study; the table is {}", table.display());
        print_warning("cd-post", renamed);
    }
    let threads = arguments.threads();
    let pool = match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool,
        Err(_) => {
            print_error(format_args!(
                "cd-post: options: threads: {threads} cannot be started; expected a number that the machine can start"
            ));
            return 2;
        }
    };
    // `watch` locks the case for each of its reports.
    let is_watching = matches!(command, Some(Command::Watch { .. }));
    let _lock = arguments.case_dir().filter(|_| !is_watching).map(lock_case);
    let result = pool.install(|| command.as_ref().map_or_else(|| process_case(options), Command::run));
    match result {
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
