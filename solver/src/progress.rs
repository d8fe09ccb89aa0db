//! Progress of a run: a bar on a terminal, a line per output otherwise.

use std::cell::Cell;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::{JoinHandle, spawn};
use std::time::{Duration, Instant};

use cd_formats::compute::{Compute, ContactSolver};
use cd_formats::messages::{is_silent, print_error, print_line, print_warning};
use cd_formats::names::{count_text, rounded_number};
use indicatif::{ProgressBar, ProgressStyle};

use crate::activity;
use crate::scene::BodyId;
use crate::state::State;
use crate::step::{StepReport, WorstContact};

/// Longest time between two lines without a terminal, also in a step that takes longer.
const MAX_SILENCE: Duration = Duration::from_secs(30);
/// Time since the last line after which the end of a step prints one: a second before the line of [`spawn_watcher`], which
/// says less.
const REPORT_INTERVAL: Duration = Duration::from_secs(29);

/// Position of a run between two lines of output.
struct ProgressMark {
    /// Time of the last line.
    last_line: Instant,
    /// Step in progress.
    step: u64,
}

/// Progress of a run on the terminal, and its messages.
pub struct ProgressDisplay {
    bar: ProgressBar,
    /// Steps at which the run starts and ends.
    first: u64,
    last: u64,
    start: Instant,
    mark: Arc<Mutex<ProgressMark>>,
    /// Thread that reports long steps, and the channel that it waits on, if there is no bar. It ends when the channel closes.
    watcher: Option<(Sender<()>, JoinHandle<()>)>,
    /// Whether the replacement of the chosen solver by sweeps was reported.
    replacement_reported: Cell<bool>,
}

impl ProgressDisplay {
    /// Display of a run from step `first` to step `last`.
    pub fn new(first: u64, last: u64) -> Self {
        // The bar hides itself if standard error is no terminal.
        let bar = if is_silent() { ProgressBar::hidden() } else { ProgressBar::new(last) }.with_position(first);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} steps {per_sec} ETA {eta}  {msg}") {
            bar.set_style(style);
        }
        bar.reset_eta();
        let mark = Arc::new(Mutex::new(ProgressMark { last_line: Instant::now(), step: first }));
        let watcher = bar.is_hidden().then(|| spawn_watcher(Arc::clone(&mark), last));
        ProgressDisplay {
            bar,
            first,
            last,
            start: Instant::now(),
            mark,
            watcher,
            replacement_reported: Cell::new(false),
        }
    }

    /// Reports that the step after `step` begins.
    pub fn begin_step(&self, step: u64) {
        if let Ok(mut mark) = self.mark.lock() {
            mark.step = step;
        }
    }

    /// Shows a completed step.
    pub fn show_step(&self, state: &State, report: &StepReport) {
        self.bar.set_position(state.step);
        if state.step.is_multiple_of(10) {
            self.bar.set_message(format!(
                "{}, {}",
                count_text(report.contacts_active, "contact"),
                count_text(report.sweeps as usize, "sweep")
            ));
        }
        self.first_replacement_message(state.step, report.replacement_reason)
            .into_iter()
            .for_each(|message| self.print_message(&message));
    }

    /// Message about the first replacement of the chosen solver by sweeps.
    fn first_replacement_message(&self, step: u64, reason: Option<&str>) -> Option<String> {
        let reason = reason.filter(|_| !self.replacement_reported.replace(true))?;
        Some(format!("cd-solve: step {step}: the chosen solver is replaced by sweeps, because {reason}"))
    }

    /// Whether nothing has been printed for long.
    pub fn is_silent(&self) -> bool {
        self.mark.lock().is_ok_and(|mark| mark.last_line.elapsed() > REPORT_INTERVAL)
    }

    /// Prints the state of the run.
    pub fn print_status(&self, state: &State, report: &StepReport) {
        if let Ok(mut mark) = self.mark.lock() {
            mark.last_line = Instant::now();
        }
        if !self.bar.is_hidden() {
            return;
        }
        let rate = (state.step - self.first) as f64 / self.start.elapsed().as_secs_f64().max(1e-9);
        let seconds_left = (self.last - state.step) as f64 / rate.max(1e-9);
        print_line(format_args!(
            "step {}/{}  t = {} s  {} contacts carry force  {}, residual {:.1e}  kinetic {:.3e} J  {} steps/s, {:.0} s left",
            state.step,
            self.last,
            progress_time(state.time),
            report.contacts_active,
            count_text(report.sweeps as usize, "sweep"),
            report.residual,
            report.kinetic + report.rotational,
            rate_text(rate),
            seconds_left
        ));
    }

    /// Warns of a step that did not converge.
    pub fn report_unconverged(&self, state: &State, report: &StepReport, options: &Compute) {
        let contact_text = |WorstContact { bodies: [a, b], point }: WorstContact| {
            let [x, y, z] = [point.x, point.y, point.z];
            format!(", worst contact bodies {}-{} at ({x:.6e}, {y:.6e}, {z:.6e}) m", a.number(), b.number())
        };
        let worst = report.worst.map_or(String::new(), contact_text);
        let solver = solver_text(options.solver, report.replacement_reason.is_some());
        let reason = unconverged_reason(report.residual, report.tol, report.left_out);
        let conflict = report.conflict.map_or(String::new(), conflict_text);
        let advice = if conflict.is_empty() {
            unconverged_advice([report.residual, report.tol], report.sweeps, options.max_sweeps())
        } else {
            ""
        };
        let message = format!(
            "cd-solve: step {}, t = {} s: {solver} stopped after {}, {reason}{worst}{conflict}; continuing{advice}",
            state.step,
            rounded_number(state.time),
            count_text(report.sweeps as usize, "sweep")
        );
        self.bar.suspend(|| print_error(&message));
    }

    /// Prints a warning on stderr, next to the bar.
    pub fn warn(&self, message: &str) {
        self.bar.suspend(|| print_warning("cd-solve", message));
    }

    /// Prints a line next to the bar.
    pub fn print_message(&self, message: &str) {
        self.bar.suspend(|| print_line(format_args!("{message}")));
    }

    /// Removes the display.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// Reason why a step has not converged: its residual, the contacts that its problem omits, or both.
fn unconverged_reason(residual: f64, tol: f64, left_out: usize) -> String {
    let is_reached = residual <= tol;
    // Two numbers that differ are not shown as equal.
    let [residual, tol] = (1..=16)
        .map(|digits| [residual, tol].map(|x| format!("{x:.digits$e}")))
        .find(|[a, b]| a != b || residual == tol)
        .unwrap_or_else(|| [residual, tol].map(|x| x.to_string()));
    let contacts = if left_out == 1 { "1 contact".to_string() } else { format!("{left_out} contacts") };
    match (is_reached, left_out) {
        (true, 0) => format!("residual {residual}"),
        (true, _) => {
            format!("as {contacts} began to close late and are not solved (residual {residual} <= tol {tol})")
        }
        (false, 0) => format!("residual {residual} > tol {tol}"),
        (false, _) => format!("residual {residual} > tol {tol}, without {contacts} that began to close late"),
    }
}

/// Value of `max_sweeps` below which it may be too small to reduce the residual at all: chains of hundreds of bodies need as
/// many sweeps.
const FEW_SWEEPS: u64 = 1000;

/// Advice about a step that has not converged, without a known cause.
fn unconverged_advice([residual, tol]: [f64; 2], sweeps: u64, max_sweeps: u64) -> &'static str {
    let at_limit = sweeps >= max_sweeps;
    match residual {
        residual if residual <= tol => "; use a smaller dt",
        residual if residual < 1.0 && at_limit => "; raise max_sweeps or use a smaller dt",
        residual if residual < 1.0 => "; use a smaller dt or a larger tol",
        _ if at_limit && max_sweeps < FEW_SWEEPS => "; no part of the contact problem is solved: raise max_sweeps",
        _ => {
            "; no part of the contact problem is solved: use a smaller dt, or check the imposed motion of these bodies"
        }
    }
}

/// Cause of a step without a solution, with the bodies of a contact that imposed motion closes, and advice.
fn conflict_text([a, b]: [BodyId; 2]) -> String {
    format!(
        "; imposed motion closes contacts of bodies {}-{}, and no free motion opens all of them: impose fewer components, or a \
         motion away from the contact",
        a.number(),
        b.number()
    )
}

impl Drop for ProgressDisplay {
    fn drop(&mut self) {
        if let Some((end_sender, watcher)) = self.watcher.take() {
            drop(end_sender);
            let _ = watcher.join();
        }
    }
}

/// Starts a thread that prints a line if a step takes longer than [`MAX_SILENCE`]; it ends when the returned sender is
/// dropped.
fn spawn_watcher(mark: Arc<Mutex<ProgressMark>>, last: u64) -> (Sender<()>, JoinHandle<()>) {
    let (end_sender, end_receiver) = channel();
    let watch = move || {
        let mut wait = MAX_SILENCE;
        while end_receiver.recv_timeout(wait) == Err(RecvTimeoutError::Timeout) {
            let Ok(mut mark) = mark.lock() else { return };
            let silence = mark.last_line.elapsed();
            if silence >= MAX_SILENCE {
                print_line(format_args!(
                    "after step {}/{last}: next step in progress, {}",
                    mark.step,
                    activity::current_activity()
                ));
                mark.last_line = Instant::now();
            }
            wait = MAX_SILENCE.saturating_sub(mark.last_line.elapsed()).max(Duration::from_millis(100));
        }
    };
    (end_sender, spawn(watch))
}

/// Time (s) in lines of progress, which align; very short and long times have an exponent.
fn progress_time(time: f64) -> String {
    if time == 0.0 || (1e-3..1e9).contains(&time) { format!("{time:.6}") } else { rounded_number(time) }
}

/// Formats a rate with at least three digits.
fn rate_text(rate: f64) -> String {
    let decimals = if rate < 100.0 { (2.0 - libm::log10(rate.max(1e-9)).floor()) as usize } else { 0 };
    format!("{rate:.decimals$}")
}

/// Solver of a step, which may be sweeps that replaced the chosen solver.
fn solver_text(solver: ContactSolver, is_replaced: bool) -> String {
    if is_replaced { format!("sweeps in place of {solver}") } else { solver.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_runs_have_a_rate() {
        assert_eq!(
            [0.01234, 1.0, 9.876, 56.78, 123.4, 56789.1].map(rate_text),
            ["0.0123", "1.00", "9.88", "56.8", "123", "56789"]
        );
    }

    #[test]
    fn a_step_that_has_not_converged_says_why() {
        assert_eq!(unconverged_reason(3e-2, 2e-2, 0), "residual 3.0e-2 > tol 2.0e-2");
        assert_eq!(unconverged_reason(1.004e-8, 1e-8, 0), "residual 1.004e-8 > tol 1.000e-8");
        let late = "as 2 contacts began to close late and are not solved (residual 3.5e-3 <= tol 2.0e-2)";
        assert_eq!(unconverged_reason(3.5e-3, 2e-2, 2), late);
        let both = "residual 3.0e-2 > tol 2.0e-2, without 1 contact that began to close late";
        assert_eq!(unconverged_reason(3e-2, 2e-2, 1), both);
    }

    #[test]
    fn an_unsolved_step_gets_other_advice_than_an_inaccurate_one() {
        let advice = |residual, sweeps, max_sweeps| unconverged_advice([residual, 1e-2], sweeps, max_sweeps);
        assert_eq!(advice(0.1, 500, 500), "; raise max_sweeps or use a smaller dt");
        assert_eq!(advice(0.1, 200, 500), "; use a smaller dt or a larger tol");
        // Contacts that began to close late.
        assert_eq!(advice(1e-3, 200, 500), "; use a smaller dt");
        assert_eq!(advice(1.0, 3, 3), "; no part of the contact problem is solved: raise max_sweeps");
        for residual in [1.0, 7.0, f64::NAN] {
            let unsolved = "; no part of the contact problem is solved: use a smaller dt, or check the imposed motion";
            assert!(advice(residual, 20_000, 20_000).starts_with(unsolved));
        }
    }

    #[test]
    fn times_of_any_size_are_short() {
        let times = [0.0, 0.25, 12_000.0, 1e300, 1e-300, 3.0 * 0.003];
        let texts = ["0.000000", "0.250000", "12000.000000", "1e300", "1e-300", "0.009000"];
        assert_eq!(times.map(progress_time), texts);
        assert_eq!(rounded_number(3.0 * 0.003), "0.009");
    }

    #[test]
    fn a_solver_is_named_that_solved() {
        assert_eq!(solver_text(ContactSolver::Admm, true), "sweeps in place of admm");
        assert_eq!(solver_text(ContactSolver::Admm, false), "admm");
    }

    #[test]
    fn a_replacement_by_sweeps_is_reported_once() {
        let progress = ProgressDisplay::new(0, 5);
        assert_eq!(progress.first_replacement_message(1, None), None);
        let message = progress.first_replacement_message(2, Some("it is large")).unwrap();
        assert_eq!(message, "cd-solve: step 2: the chosen solver is replaced by sweeps, because it is large");
        assert_eq!(progress.first_replacement_message(3, Some("it is large")), None);
    }
}
