//! Estimates of a run's own errors and of their cost.
//!
//! Every estimate is a fraction of the mean pressure between two snapshots, or of the corresponding energy, so that
//! estimates can be compared and added. They use the steps of the second half of the time, including those before a
//! resume. The first two use the second half of the time in which contacts carry force:
//!
//! | source | estimate | option |
//! |---|---|---|
//! | contacts | the smaller of two changes of Σ f·l (three volumes times the pressure), divided by its median. First: twice the median change from one step to the next, which includes noise that averages out in an interval. Second: the median change of its mean over the n steps between two snapshots from one such interval to the next, divided by √n. The mean varies with the motion, which all runs share, and with the noise of each step, which averages out as 1/√n: runs with intervals of one step share nothing, and differ by as much as these do. The factor 2, as successive steps are alike, is from the scenes of examples/accuracy-study | `tol` |
//! | step | 2 δ/r̄, δ the mean penetration of a contact: an aggregate shorter by δ/2r̄ of its length, with a pressure proportional to the -4th power of the length; plus, for bodies in flight (without contact), Σ ¼ m \|h a\|² divided by the largest of the energies involved, a the acceleration beyond uniform gravity: the fluctuation of the kinetic energy on a circular orbit | `dt` |
//! | gravity | \|Σ m x·(a - a_direct)\| / \|Σ m x·a_direct\|, the virial, on 64 bodies, mean over the diagnostic steps | `gravity_error` |
//! | narrow | 2 δ/r̄, δ the mean error of the fast narrow phase in the gap of a touching pair, mean over the diagnostic steps | `narrow_phase` |
//! | chance | w (0.35/√N + s/√D): N is the number of pairs in contact, whose forces vary as much as their mean (the points of one pair count once); s is the fraction of the forces of driven bodies that balance among themselves, since grains between walls can be wedged by any force; D is the number of pairs that carry them; w is the fraction of the energy that contacts have dissipated, through which the result could have been different; 0.35 is from the scenes of examples/accuracy-study | none |
//! | energy | energy that the ledger does not explain, divided by the largest of the energies involved | `theta` |
//! | momentum | kinetic energy of its drift as a motion of all bodies together, divided by the same | none: rounding |

use std::io::Write;
use std::path::Path;
use std::time::Duration;

use cd_formats::atomic;
use cd_formats::error::Faults;

use crate::math::{Vec3, to_world};
use crate::scene::{BodyId, Scene};
use crate::state::{SolvedContact, State};
use crate::step::{BalanceErrors, StageTimes};

use super::log::{LogRow, figures, length, narrow_phase, row_steps, seconds};

/// File next to OUTBOX; it contains durations.
pub const ERRORS_FILE: &str = "ERRORS.csv";

/// Random variation of the force of one pair, divided by the mean force, in the scenes of examples/accuracy-study.
const SAMPLING_FACTOR: f64 = 0.35;

/// Figures of the steps so far, in bounded memory.
#[derive(Debug, Clone, Default)]
pub struct ErrorEstimator {
    /// Rows in which contacts carry force.
    loaded: ThinnedRows<LoadedRow>,
    /// Complete intervals between snapshots in these rows, and the current one.
    intervals: ThinnedRows<IntervalMean>,
    interval: Option<IntervalSum>,
    /// Σ f·l of the previous row in which contacts carry force, J.
    previous_virial: Option<f64>,
    /// Mean of Σ f·l in the previous interval, J.
    previous_mean: Option<f64>,
    flights: ThinnedRows<FlightRow>,
    /// Relative errors of the virial in the diagnostic steps.
    virial_error: ErrorMean,
    /// Errors of the fast narrow phase in the diagnostic steps, each a mean over touching pairs, divided by the mean
    /// radius.
    narrow_phase_error: ErrorMean,
    /// Seconds of the steps by stage.
    clock: StageTimes,
    /// Steps between two snapshots.
    output_every: f64,
    /// Longest step in which contacts carry force, s; of a row of several steps their mean. 0 if the lengths are not logged.
    longest_step: f64,
}

/// Mean of errors that only some steps measure.
#[derive(Debug, Clone, Copy, Default)]
struct ErrorMean {
    sum: f64,
    number: f64,
}

impl ErrorMean {
    /// Adds an error; NaN if the step has not measured it.
    fn add(&mut self, error: f64) {
        if !error.is_nan() {
            self.sum += error;
            self.number += 1.0;
        }
    }

    /// Mean; 0 without errors.
    fn mean(self) -> f64 {
        self.sum / self.number.max(1.0)
    }
}

/// Row of steps.csv in which contacts carry force.
#[derive(Debug, Clone, Copy)]
struct LoadedRow {
    step: f64,
    /// Time, s.
    time: f64,
    /// Σ f·l, J, and its change since the previous such row; the change is NaN in the first.
    virial: f64,
    virial_change: f64,
    /// Ratio of the mean penetration to the mean radius.
    penetration_mean: f64,
}

/// Interval between two snapshots, with the mean of Σ f·l.
#[derive(Debug, Clone, Copy)]
struct IntervalMean {
    /// Time of the last row, s.
    time: f64,
    /// Change of the mean since the previous interval, J; NaN in the first.
    change: f64,
    /// Number of rows.
    count: f64,
}

/// Error of the steps of a row in the kinetic energy of bodies in flight.
#[derive(Debug, Clone, Copy)]
struct FlightRow {
    /// Time, s.
    time: f64,
    /// Error, J, and number of the steps.
    error: f64,
    steps: f64,
}

/// Row with a time.
trait TimedRow {
    /// Time, s.
    fn time(&self) -> f64;
}

impl TimedRow for LoadedRow {
    fn time(&self) -> f64 {
        self.time
    }
}

impl TimedRow for IntervalMean {
    fn time(&self) -> f64 {
        self.time
    }
}

impl TimedRow for FlightRow {
    fn time(&self) -> f64 {
        self.time
    }
}

/// Sum of Σ f·l, J, in the current interval.
#[derive(Debug, Clone, Copy)]
struct IntervalSum {
    /// Number of the interval, from the start of the run.
    interval: f64,
    /// Time of the last row, s.
    time: f64,
    sum: f64,
    count: f64,
}

/// Largest number of rows of a sample; smaller samples keep all.
const MAX_ROWS: usize = 1 << 14;

/// Sample of consecutive rows; if there are too many, every second one is dropped, repeatedly.
#[derive(Debug, Clone)]
struct ThinnedRows<T> {
    rows: Vec<T>,
    /// Number of rows per kept row, and number of rows so far.
    stride: u64,
    seen: u64,
}

impl<T> Default for ThinnedRows<T> {
    fn default() -> Self {
        ThinnedRows { rows: Vec::new(), stride: 1, seen: 0 }
    }
}

impl<T> ThinnedRows<T> {
    fn push(&mut self, row: T) {
        if self.seen.is_multiple_of(self.stride) {
            if self.rows.len() == MAX_ROWS {
                let mut indices = 0..;
                self.rows.retain(|_| indices.next().is_some_and(|k: usize| k.is_multiple_of(2)));
                self.stride *= 2;
            }
            if self.seen.is_multiple_of(self.stride) {
                self.rows.push(row);
            }
        }
        self.seen += 1;
    }
}

/// Error estimate and the seconds spent on keeping it that small.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorSource {
    pub name: &'static str,
    /// Option that controls the error; empty if there is none.
    pub option: &'static str,
    /// Error divided by the mean pressure, or by the corresponding energy.
    pub error: f64,
    /// Relative error of Z by the same cause; `None` if it is not estimated.
    pub z_error: Option<f64>,
    /// Time that the stages that the option controls took, s.
    pub seconds: f64,
}

impl ErrorSource {
    /// Name in the summary.
    fn title(&self) -> &'static str {
        match self.name {
            "narrow" => "narrow phase",
            "step" => "time step",
            name => name,
        }
    }
}

impl ErrorEstimator {
    /// Estimator of a run with a snapshot every `output_every` steps.
    pub fn new(output_every: u64) -> Self {
        ErrorEstimator { output_every: output_every as f64, ..ErrorEstimator::default() }
    }

    /// Adds a row of steps.csv.
    pub fn add_figures(&mut self, row: &LogRow) {
        let [time, step, virial] = [figures::time, figures::step, figures::virial].map(|name| row.get(name));
        if row.get(figures::contacts_active) > 0.0 && !virial.is_nan() {
            let virial_change = self.previous_virial.map_or(f64::NAN, |previous| (virial - previous).abs());
            self.previous_virial = Some(virial);
            let penetration_mean = row.get(figures::penetration_mean);
            self.loaded.push(LoadedRow { step, time, virial, virial_change, penetration_mean });
            let interval = ((step - 1.0) / self.output_every).floor();
            match &mut self.interval {
                Some(current) if current.interval == interval => {
                    current.time = time;
                    current.sum += virial;
                    current.count += 1.0;
                }
                current => {
                    let complete = current.replace(IntervalSum { interval, time, sum: virial, count: 1.0 });
                    complete.into_iter().for_each(|interval| self.end_interval(interval));
                }
            }
        }
        let steps = row.get(row_steps::steps);
        let steps = if steps.is_nan() { 1.0 } else { steps };
        if row.get(figures::contacts_active) > 0.0 {
            self.longest_step = self.longest_step.max(row.get(length::h) / steps);
        }
        self.flights.push(FlightRow { time, error: row.get(figures::flight_error), steps });
        self.virial_error.add(row.get(figures::gravity_sampled_virial));
        self.narrow_phase_error.add(row.get(narrow_phase::narrow_error));
    }

    /// Adds a complete interval.
    fn end_interval(&mut self, IntervalSum { time, sum, count, .. }: IntervalSum) {
        let mean = sum / count;
        let change = self.previous_mean.map_or(f64::NAN, |previous| (mean - previous).abs());
        self.previous_mean = Some(mean);
        self.intervals.push(IntervalMean { time, change, count });
    }

    /// Adds a row of TIMER.csv.
    pub fn add_seconds(&mut self, row: &LogRow) {
        let spent_time = |name: &str| Duration::try_from_secs_f64(row.get(name)).unwrap_or_default();
        self.clock.accumulate(&StageTimes {
            gravity: spent_time(seconds::gravity),
            detection: spent_time(seconds::detection),
            assembly: spent_time(seconds::assembly),
            solve: spent_time(seconds::solve),
            integration: spent_time(seconds::integration),
            writing: spent_time(seconds::writing),
        });
    }

    /// Adds seconds that belong to no step.
    pub fn add_writing_time(&mut self, times: &StageTimes) {
        self.clock.accumulate(times);
    }

    /// Returns the sources of error, each with its cost. `balance`: balance of the state.
    pub fn error_sources(&self, scene: &Scene, state: &State, balance: &BalanceErrors) -> Vec<ErrorSource> {
        let recent = second_half(&self.loaded.rows);
        let virials: Vec<f64> = recent.iter().map(|row| row.virial).collect();
        let typical_virial = median(virials.iter().map(|virial| virial.abs()));
        let noise = if self.loaded.stride == 1 {
            let interval = |row: &LoadedRow| ((row.step - 1.0) / self.output_every).floor();
            let intervals = recent.chunk_by(|a, b| interval(a) == interval(b));
            let means: Vec<f64> = intervals.map(|steps| mean_of(steps.iter().map(|row| row.virial))).collect();
            step_noise(&virials, &means)
        } else {
            self.noise_of_samples()
        };
        let ratio = |error: f64, scale: f64| if scale > 0.0 { error / scale } else { 0.0 };
        let (energy_drift, scale) = (balance.energy, balance.energy_scale);
        let dissipated_share = ratio(state.ledger.contact_work.abs(), scale);
        let loaded_contacts = state.contacts.iter().filter(|solved| solved.impulse != Vec3::zeros());
        // Contacts are ordered by pair, and the points of one pair count once.
        let mut pairs: Vec<(BodyId, BodyId)> =
            loaded_contacts.map(|solved| (solved.contact.candidate, solved.contact.antagonist)).collect();
        pairs.dedup();
        let lost_momentum = balance.momentum * state.ledger.momentum_scale;
        let flight = ratio(self.flight_error(), scale);
        let mass: f64 = scene.free.iter().map(|&i| scene.bodies[i.index()].mass).sum();
        let StageTimes { gravity, detection, assembly, solve, integration, writing } = self.clock;
        let source = |name, option, error, seconds: Duration| ErrorSource {
            name,
            option,
            error: error + 0.0, // not -0, the sum of nothing
            z_error: None,
            seconds: seconds.as_secs_f64(),
        };
        let none = Duration::ZERO;
        vec![
            source("contacts", "tol", ratio(noise, typical_virial), assembly + solve),
            source("step", "dt", self.overlap_error() + flight, detection + integration),
            source("gravity", "gravity_error", self.virial_error.mean().abs(), gravity),
            source("narrow", "narrow_phase", 2.0 * self.narrow_phase_error.mean(), none),
            source(
                "chance",
                "",
                dissipated_share
                    * (ratio(SAMPLING_FACTOR, (pairs.len() as f64).sqrt()) + self_balanced_wall_share(scene, state)),
                none,
            ),
            source("energy", "theta", energy_drift.abs(), none),
            source("momentum", "", ratio(0.5 * lost_momentum * lost_momentum / mass, scale), none),
            source("writing", "output_every", 0.0, writing),
        ]
    }
}

impl ErrorEstimator {
    /// Longest step in which contacts carry force, s, 0 if lengths are not logged; `None` if no contact has carried force.
    pub fn longest_loaded_step(&self) -> Option<f64> {
        (!self.loaded.rows.is_empty()).then_some(self.longest_step)
    }

    /// Error of the solid fraction by overlaps, 2 δ/r̄: δ/r̄ is the mean penetration in the second half of the loaded steps.
    pub fn overlap_error(&self) -> f64 {
        2.0 * mean_of(second_half(&self.loaded.rows).iter().map(|row| row.penetration_mean))
    }

    /// Error of a step in the kinetic energy of bodies in flight, mean of the second half, J.
    fn flight_error(&self) -> f64 {
        let recent = second_half(&self.flights.rows);
        let steps: f64 = recent.iter().map(|row| row.steps).sum();
        recent.iter().map(|row| row.error).sum::<f64>() / steps.max(1.0)
    }

    /// [`step_noise`] if some rows are omitted: uses the changes of the kept rows from their neighbours.
    fn noise_of_samples(&self) -> f64 {
        let changes = |values: &mut dyn Iterator<Item = f64>| median(values.filter(|change| !change.is_nan()));
        let step_noise = 2.0 * changes(&mut second_half(&self.loaded.rows).iter().map(|row| row.virial_change));
        let intervals = second_half(&self.intervals.rows);
        let number = mean_of(intervals.iter().map(|interval| interval.count)).max(1.0);
        let mean_noise = changes(&mut intervals.iter().map(|interval| interval.change)) / number.sqrt();
        if intervals.len() < MIN_INTERVALS { step_noise } else { step_noise.min(mean_noise) }
    }
}

/// Smallest number of intervals whose changes are used.
const MIN_INTERVALS: usize = 4;

/// Noise of steps in the mean of an interval: twice the median change of values from one step to the next, or the median
/// change of means from one interval to the next divided by √n for n steps, whichever is smaller.
fn step_noise(steps: &[f64], means: &[f64]) -> f64 {
    let change = |values: &[f64]| median(values.windows(2).map(|pair| (pair[1] - pair[0]).abs()));
    let change_of_steps = 2.0 * change(steps);
    let number = (steps.len() as f64 / means.len() as f64).max(1.0);
    if means.len() < MIN_INTERVALS { change_of_steps } else { change_of_steps.min(change(means) / number.sqrt()) }
}

/// Fraction of the forces of driven bodies on free ones that cancel in the sum, divided by the root of the number of
/// such pairs.
fn self_balanced_wall_share(scene: &Scene, state: &State) -> f64 {
    let (mut sum_of_norms, mut resultant) = (0.0, Vec3::zeros());
    let mut pairs = Vec::new();
    for SolvedContact { contact, impulse, .. } in &state.contacts {
        let bodies = [contact.candidate, contact.antagonist];
        let [candidate_driven, antagonist_driven] = bodies.map(|body| scene.bodies[body.index()].driven);
        if (candidate_driven || antagonist_driven) && *impulse != Vec3::zeros() {
            let force = to_world(&contact.frame(), impulse);
            sum_of_norms += force.norm();
            resultant += if candidate_driven { -force } else { force };
            pairs.push(bodies);
        }
    }
    pairs.dedup();
    if sum_of_norms > 0.0 {
        (1.0 - resultant.norm() / sum_of_norms).max(0.0) / (pairs.len() as f64).sqrt()
    } else {
        0.0
    }
}

/// Rows of the second half of the time that they span. With steps of varying length that is not half of the rows.
fn second_half<T: TimedRow>(rows: &[T]) -> &[T] {
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return rows };
    let half = 0.5 * (first.time() + last.time());
    &rows[rows.partition_point(|row| row.time() < half)..]
}

/// Mean; 0 without values.
fn mean_of(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let number = values.len().max(1);
    values.sum::<f64>() / number as f64
}

/// Median; 0 without values.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Probable cause of large changes of contact forces from step to step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ForceNoise {
    /// Steps that are too long even for a draft.
    LongSteps,
    /// Half of the steps or more did not converge.
    Unconverged,
    /// None of these: bodies collide, or `tol` is large.
    Unknown,
}

impl ForceNoise {
    /// Advice, after a statement about the estimate.
    fn remedy(self) -> &'static str {
        match self {
            ForceNoise::LongSteps => ": lower dt",
            ForceNoise::Unconverged => ": raise max_sweeps or lower dt, so that the steps converge",
            ForceNoise::Unknown => {
                ": if bodies collide, raise output_every, to average over more collisions; otherwise lower tol"
            }
        }
    }
}

/// Lines of the summary: the total error and its main source, and the cost.
pub fn summary_lines(sources: &[ErrorSource], noise: ForceNoise) -> [(&'static str, String); 2] {
    let total: f64 = sources.iter().map(|source| source.error).sum();
    let seconds: f64 = sources.iter().map(|source| source.seconds).sum();
    let largest_source =
        |figure: fn(&ErrorSource) -> f64| sources.iter().max_by(|a, b| figure(a).total_cmp(&figure(b)));
    let title_of_largest = |figure: fn(&ErrorSource) -> f64| {
        largest_source(figure).map_or(String::new(), |source| match source.option {
            "" => source.title().to_string(),
            option => format!("{} ({option})", source.title()),
        })
    };
    let parts: Vec<String> = sources
        .iter()
        .filter(|source| source.error > 0.0)
        .map(|source| format!("{} {}", source.title(), percent(source.error)))
        .collect();
    let error = match parts.len() {
        0 if noise == ForceNoise::Unconverged => {
            "not known: steps did not converge, and no contact carried force".into()
        }
        0 => "none: no contact carried force".into(),
        _ => {
            let remedy = match largest_source(|source| source.error).map_or("", |source| source.option) {
                "tol" => noise.remedy().into(),
                option @ ("dt" | "gravity_error") => format!(": lower {option}"),
                // The energy of motion in fields drifts with the length of the step.
                "theta" => ": lower dt".into(),
                "narrow_phase" => ": set it to accurate".into(),
                _ => String::new(),
            };
            let advice = if total > 1.0 {
                format!("; more than 100 % is not a meaningful estimate{remedy}")
            } else {
                String::new()
            };
            let main = title_of_largest(|source| source.error);
            format!("{} of the pressure, mainly {main}: {}{advice}", percent(total), parts.join(", "))
        }
    };
    let share = |source: &ErrorSource| format!("{} {:.0} %", source.title(), 100.0 * source.seconds / seconds);
    let shares: Vec<String> = sources.iter().filter(|source| source.seconds > 0.005 * seconds).map(share).collect();
    let cost = match shares.len() {
        0 => "none".into(),
        _ => format!("mainly {}: {}", title_of_largest(|source| source.seconds), shares.join(", ")),
    };
    [("estimated error", error), ("cost", cost)]
}

/// Fraction in percent with two digits.
pub fn percent(x: f64) -> String {
    let digits = (1.0 - libm::log10((100.0 * x).abs().max(1e-99)).floor()).max(0.0) as usize;
    if x >= 1e-4 { format!("{:.digits$} %", 100.0 * x) } else { format!("{:.1e} %", 100.0 * x) }
}

/// Whether the case has an [`ERRORS_FILE`].
pub fn has_errors_file(case: &Path) -> bool {
    atomic::path_exists(&case.join(ERRORS_FILE))
}

/// Writes [`ERRORS_FILE`].
pub fn write_errors(case: &Path, sources: &[ErrorSource]) -> Result<(), Faults> {
    let row = |source: &ErrorSource| {
        let ErrorSource { name, option, error, z_error, seconds } = source;
        let z_error = z_error.map_or(String::new(), |z_error| format!("{z_error:e}"));
        format!("{name},{option},{error:e},{z_error},{seconds:e}\n")
    };
    let text = format!("source,option,error,z_error,seconds\n{}", sources.iter().map(row).collect::<String>());
    atomic::write_file(&case.join(ERRORS_FILE), |file| file.write_all(text.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_half_is_one_of_time() {
        let of = |times: &[f64]| {
            let row = |&time: &f64| FlightRow { time, error: 0.0, steps: 1.0 };
            second_half(&times.iter().map(row).collect::<Vec<_>>()).len()
        };
        assert_eq!(of(&[]), 0);
        assert_eq!(of(&[3.0]), 1);
        assert_eq!(of(&[1.0, 2.0, 3.0, 4.0]), 2);
        // Short steps, then long ones.
        assert_eq!(of(&[1.0, 1.1, 1.2, 1.3, 1.4, 5.0, 9.0]), 2);
    }

    #[test]
    fn a_sample_is_even_and_bounded() {
        let mut sample = ThinnedRows::default();
        for k in 0..10 * MAX_ROWS {
            sample.push(k);
        }
        assert!(sample.rows.len() > MAX_ROWS / 2 && sample.rows.len() <= MAX_ROWS);
        assert_eq!(sample.stride, 16);
        assert!((0..).zip(&sample.rows).all(|(k, row): (usize, &usize)| *row == k * 16));
    }

    #[test]
    fn noise_is_the_smaller_bound() {
        // Values that alternate by 2 every step and average out: four intervals of four steps.
        assert_eq!(step_noise(&[1.0, 3.0].repeat(8), &[2.0, 2.5, 2.0, 2.5]), 0.25);
        // Values that increase by 0.1 a step, 1 an interval.
        assert_eq!(step_noise(&[1.0, 1.125, 1.25], &[1.0, 2.0, 3.0, 4.0]), 0.25);
        // A single change of means is not used.
        assert_eq!(step_noise(&[1.0, 3.0, 1.0, 3.0], &[2.0, 2.0]), 4.0);
    }

    #[test]
    fn what_dominates_is_named() {
        let source = |name, option, error, seconds| ErrorSource { name, option, error, z_error: None, seconds };
        let sources = [
            source("contacts", "tol", 1e-2, 1.0),
            source("step", "dt", 4e-2, 0.5),
            source("gravity", "gravity_error", 0.0, 8.5),
        ];
        let [(_, error), (_, cost)] = summary_lines(&sources, ForceNoise::Unknown);
        assert_eq!(error, "5.0 % of the pressure, mainly time step (dt): contacts 1.0 %, time step 4.0 %");
        assert_eq!(cost, "mainly gravity (gravity_error): contacts 10 %, time step 5 %, gravity 85 %");
        let [long, unconverged, unknown] = [ForceNoise::LongSteps, ForceNoise::Unconverged, ForceNoise::Unknown]
            .map(|noise| ("tol", noise, noise.remedy()));
        let others = [("theta", ForceNoise::Unknown, ": lower dt"), ("", ForceNoise::Unknown, "")];
        for (option, noise, remedy) in [long, unconverged, unknown].into_iter().chain(others) {
            let sources = [source("part", option, 2.0, 1.0), source("step", "dt", 0.5, 1.0)];
            let [(_, error), _] = summary_lines(&sources, noise);
            assert!(error.ends_with(&format!("; more than 100 % is not a meaningful estimate{remedy}")), "{error}");
        }
        // No force because nothing was solved is no small error.
        let [none, unsolved] =
            [ForceNoise::Unknown, ForceNoise::Unconverged].map(|noise| summary_lines(&[], noise)[0].1.clone());
        assert_eq!(none, "none: no contact carried force");
        assert_eq!(unsolved, "not known: steps did not converge, and no contact carried force");
    }
}
