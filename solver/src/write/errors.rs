//! What a run says of its own errors, and of what they cost.
//!
//! Every estimate is a share of the mean pressure between two snapshots, or of the energy that goes with it, so that they can be compared and added. From the
//! steps, those before a resume as well, of the second half of the time, for the first two that in which contacts carry force:
//!
//! | source | estimate | option |
//! |---|---|---|
//! | contacts | the smaller of two changes of Σ f·l, three volumes times the pressure, over its median: twice the median one from one step to the next, which has what averages out in an interval, too; and the median one of its mean over the n steps between two snapshots from one such interval to the next, over √n. That wavers by what happens, which all runs share, and by what each step leaves open, which averages out as 1/√n: runs whose intervals are a step each share nothing, and differ by as much as these do. The 2, as steps that follow each other are alike, is from the scenes of examples/trade | `tol` |
//! | step | 2 δ/r̄, δ the mean penetration of a contact: an aggregate shorter by δ/2r̄ of its length, pressure going as its -4th power; and of bodies in flight, that no contact acts on, Σ ¼ m \|h a\|² over the largest of the energies at play, a the acceleration beyond uniform gravity: by that kinetic energy wavers on a circular orbit | `dt` |
//! | gravity | \|Σ m x·(a - a_direct)\| / \|Σ m x·a_direct\|, the virial, on 64 bodies, mean of the looks | `gravity_error` |
//! | narrow | 2 δ/r̄, δ the mean of what the fast narrow phase misses of the gap of a pair that touches, mean of the looks | `narrow_phase` |
//! | chance | w (0.35/√N + s/√D): N pairs in contact whose forces differ as their mean (the points of one pair share theirs), s the share of the forces of driven bodies that they balance among themselves, since grains between walls can be wedged by any force, D the pairs that bear them, and w the share of the energy that contacts have taken, the way on which what happened could have happened otherwise; 0.35 is from the scenes of examples/trade | none |
//! | energy | what the ledger does not explain over the largest of the energies at play | `theta` |
//! | momentum | the energy of its drift as a motion of the whole, over the same | none: rounding |

use std::path::Path;
use std::time::Duration;

use cd_formats::atomic;
use cd_formats::error::Faults;

use crate::math::{Vec3, to_world};
use crate::scene::Scene;
use crate::state::{SolvedContact, State};
use crate::step::StageTimes;

use super::log::LogRow;
use super::summary;

/// File beside OUTBOX, as durations are.
pub const ERRORS_FILE: &str = "ERRORS.csv";

/// What the forces of one pair differ by that could have come otherwise, over their mean, in the scenes of examples/trade.
const SAMPLING_FACTOR: f64 = 0.35;

/// Figures of the steps so far, in a memory that does not grow with them.
#[derive(Debug, Clone, Default)]
pub struct ErrorEstimator {
    /// Of the rows in which contacts carry force: time (s), Σ f·l (J), mean penetration over the mean radius, number of the step, change of
    /// Σ f·l since the row before (J).
    loaded: ThinnedRows<5>,
    /// Of the intervals between snapshots in these rows: time (s), mean of Σ f·l (J), number of rows, change of the mean (J).
    intervals: ThinnedRows<4>,
    interval: Option<IntervalMean>,
    /// Of the row before: Σ f·l, and of the interval before its mean.
    before: [Option<f64>; 2],
    /// Time (s), by which the steps of a row err in the kinetic energy of bodies in flight (J), and their number.
    flights: ThinnedRows<3>,
    /// Relative errors of the virial at the looks at self-gravity: sum and number.
    virials: [f64; 2],
    /// What the fast narrow phase missed at the looks, in the mean of pairs that touch, over the mean radius: sum and number.
    narrow_phase_error: [f64; 2],
    clock: StageTimes,
    output_every: f64,
}

/// Mean of Σ f·l in an interval so far.
#[derive(Debug, Clone, Copy)]
struct IntervalMean {
    interval: f64,
    time: f64,
    sum: f64,
    count: f64,
}

/// Rows of a sample: all, as long as they are few.
const MAX_ROWS: usize = 1 << 14;

/// Rows that come one after the other, of which every second is dropped, again and again, where there are too many.
#[derive(Debug, Clone)]
struct ThinnedRows<const N: usize> {
    rows: Vec<[f64; N]>,
    /// Rows of which one is kept, and rows that have come.
    stride: u64,
    seen: u64,
}

impl<const N: usize> Default for ThinnedRows<N> {
    fn default() -> Self {
        ThinnedRows { rows: Vec::new(), stride: 1, seen: 0 }
    }
}

impl<const N: usize> ThinnedRows<N> {
    fn push(&mut self, row: [f64; N]) {
        if self.seen.is_multiple_of(self.stride) {
            if self.rows.len() == MAX_ROWS {
                let mut place = 0..;
                self.rows.retain(|_| place.next().is_some_and(|k: usize| k.is_multiple_of(2)));
                self.stride *= 2;
            }
            if self.seen.is_multiple_of(self.stride) {
                self.rows.push(row);
            }
        }
        self.seen += 1;
    }
}

/// An estimate and the seconds spent on making it as small as it is.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorSource {
    pub name: &'static str,
    /// The option that decides it.
    pub option: &'static str,
    pub error: f64,
    pub seconds: f64,
}

impl ErrorEstimator {
    pub fn new(output_every: u64) -> Self {
        ErrorEstimator { output_every: output_every as f64, ..ErrorEstimator::default() }
    }

    /// Enters a row of steps.csv.
    pub fn add_figures(&mut self, row: &LogRow) {
        let [time, step, virial] = ["time", "step", "virial"].map(|name| row.get(name));
        if row.get("contacts_active") > 0.0 && !virial.is_nan() {
            let change = self.before[0].map_or(f64::NAN, |before| (virial - before).abs());
            self.before[0] = Some(virial);
            self.loaded.push([time, virial, row.get("penetration_mean"), step, change]);
            let interval = ((step - 1.0) / self.output_every).floor();
            match &mut self.interval {
                Some(mean) if mean.interval == interval => {
                    (mean.time, mean.sum, mean.count) = (time, mean.sum + virial, mean.count + 1.0);
                }
                open => {
                    let done = open.replace(IntervalMean { interval, time, sum: virial, count: 1.0 });
                    done.into_iter().for_each(|done| self.end_interval(done));
                }
            }
        }
        let steps = row.get("steps");
        self.flights.push([time, row.get("flight_error"), if steps.is_nan() { 1.0 } else { steps }]);
        for (sum, name) in
            [(&mut self.virials, "gravity_sampled_virial"), (&mut self.narrow_phase_error, "narrow_error")]
        {
            let value = row.get(name);
            if !value.is_nan() {
                *sum = [sum[0] + value, sum[1] + 1.0];
            }
        }
    }

    fn end_interval(&mut self, IntervalMean { time, sum, count, .. }: IntervalMean) {
        let mean = sum / count;
        let change = self.before[1].map_or(f64::NAN, |before| (mean - before).abs());
        self.before[1] = Some(mean);
        self.intervals.push([time, mean, count, change]);
    }

    /// Enters a row of TIMER.csv.
    pub fn add_seconds(&mut self, row: &LogRow) {
        let spent = |name: &str| Duration::try_from_secs_f64(row.get(name)).unwrap_or_default();
        self.clock.accumulate(&StageTimes {
            gravity: spent("gravity"),
            detection: spent("detection"),
            assembly: spent("assembly"),
            solve: spent("solve"),
            integration: spent("integration"),
            writing: spent("writing"),
        });
    }

    /// Seconds that belong to no step.
    pub fn add_writing_time(&mut self, lap: &StageTimes) {
        self.clock.accumulate(lap);
    }

    /// The sources of error, each with its cost.
    pub fn error_sources(&self, scene: &Scene, state: &State) -> Vec<ErrorSource> {
        let recent = second_half(&self.loaded.rows);
        let depth = mean_of(recent.iter().map(|figures| figures[2]));
        let virials: Vec<f64> = recent.iter().map(|figures| figures[1]).collect();
        let typical = median(virials.iter().map(|virial| virial.abs()));
        let noise = if self.loaded.stride == 1 {
            let interval = |figures: &[f64; 5]| ((figures[3] - 1.0) / self.output_every).floor();
            let intervals = recent.chunk_by(|a, b| interval(a) == interval(b));
            let means: Vec<f64> = intervals.map(|steps| mean_of(steps.iter().map(|figures| figures[1]))).collect();
            step_noise(&virials, &means)
        } else {
            self.noise_of_samples()
        };
        let over = |error: f64, scale: f64| if scale > 0.0 { error / scale } else { 0.0 };
        let (drift, scale) = summary::energy_drift(scene, state);
        let lost = over(state.ledger.contact_work.abs(), scale);
        let loaded = state.contacts.iter().filter(|solved| solved.impulse != Vec3::zeros());
        // Contacts are in the order of their pairs.
        let mut pairs: Vec<(u32, u32)> =
            loaded.map(|solved| (solved.contact.candidate, solved.contact.antagonist)).collect();
        pairs.dedup();
        let stray = summary::momentum_drift(scene, state).0 * state.ledger.momentum_scale;
        let flight = over(self.flight_error(), scale);
        let mass: f64 = scene.free.iter().map(|&i| scene.bodies[i as usize].mass).sum();
        let StageTimes { gravity, detection, assembly, solve, integration, writing } = self.clock;
        let of = |name, option, error, seconds: Duration| ErrorSource {
            name,
            option,
            error: error + 0.0, // not -0, the sum of nothing
            seconds: seconds.as_secs_f64(),
        };
        let none = Duration::ZERO;
        vec![
            of("contacts", "tol", over(noise, typical), assembly + solve),
            of("step", "dt", 2.0 * depth + flight, detection + integration),
            of("gravity", "gravity_error", mean_of_sum(self.virials).abs(), gravity),
            of("narrow", "narrow_phase", 2.0 * mean_of_sum(self.narrow_phase_error), none),
            of(
                "chance",
                "",
                lost * (over(SAMPLING_FACTOR, (pairs.len() as f64).sqrt()) + self_balanced_wall_share(scene, state)),
                none,
            ),
            of("energy", "theta", drift.abs(), none),
            of("momentum", "", over(0.5 * stray * stray / mass, scale), none),
            of("writing", "output_every", 0.0, writing),
        ]
    }
}

impl ErrorEstimator {
    /// What a step errs by in the kinetic energy of bodies in flight, mean of the second half, J.
    fn flight_error(&self) -> f64 {
        let recent = second_half(&self.flights.rows);
        let steps: f64 = recent.iter().map(|figures| figures[2]).sum();
        recent.iter().map(|figures| figures[1]).sum::<f64>() / steps.max(1.0)
    }

    /// [`step_noise`] where some rows are left out: from the changes that those kept have from their neighbours.
    fn noise_of_samples(&self) -> f64 {
        let changes = |values: &mut dyn Iterator<Item = f64>| median(values.filter(|change| !change.is_nan()));
        let of_steps = 2.0 * changes(&mut second_half(&self.loaded.rows).iter().map(|figures| figures[4]));
        let intervals = second_half(&self.intervals.rows);
        let number = mean_of(intervals.iter().map(|figures| figures[2])).max(1.0);
        let of_means = changes(&mut intervals.iter().map(|figures| figures[3])) / number.sqrt();
        if intervals.len() < MIN_INTERVALS { of_steps } else { of_steps.min(of_means) }
    }
}

/// Of a sum and a number; 0 of nothing.
fn mean_of_sum([sum, number]: [f64; 2]) -> f64 {
    sum / number.max(1.0)
}

/// Intervals from which their changes tell anything.
const MIN_INTERVALS: usize = 4;

/// What steps leave open in the mean of an interval: twice the median change between values of one step and the next, or the
/// median change between means of one interval and the next over √n of n steps, whichever is smaller.
fn step_noise(steps: &[f64], means: &[f64]) -> f64 {
    let change = |values: &[f64]| median(values.windows(2).map(|pair| (pair[1] - pair[0]).abs()));
    let of_steps = 2.0 * change(steps);
    let number = (steps.len() as f64 / means.len() as f64).max(1.0);
    if means.len() < MIN_INTERVALS { of_steps } else { of_steps.min(change(means) / number.sqrt()) }
}

/// The share of the forces of driven bodies on free ones that sums up to nothing, over the root of the number of such pairs.
fn self_balanced_wall_share(scene: &Scene, state: &State) -> f64 {
    let (mut each, mut all) = (0.0, Vec3::zeros());
    let mut pairs = Vec::new();
    for SolvedContact { contact, impulse, .. } in &state.contacts {
        let bodies = [contact.candidate, contact.antagonist];
        let [candidate, antagonist] = bodies.map(|body| scene.bodies[body as usize].driven);
        if (candidate || antagonist) && *impulse != Vec3::zeros() {
            let force = to_world(&contact.frame(), impulse);
            each += force.norm();
            all += if candidate { -force } else { force };
            pairs.push(bodies);
        }
    }
    pairs.dedup();
    if each > 0.0 { (1.0 - all.norm() / each).max(0.0) / (pairs.len() as f64).sqrt() } else { 0.0 }
}

/// The rows, of which the first figure is the time, of the second half of the time that they span: with steps of many lengths not
/// half of the rows.
fn second_half<const N: usize>(rows: &[[f64; N]]) -> &[[f64; N]] {
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return rows };
    let half = 0.5 * (first[0] + last[0]);
    &rows[rows.partition_point(|row| row[0] < half)..]
}

/// 0 of nothing.
fn mean_of(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let number = values.len().max(1);
    values.sum::<f64>() / number as f64
}

/// 0 of nothing.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Lines of the summary: what the error is and mostly from, and what the cost.
pub fn summary_lines(sources: &[ErrorSource]) -> [(&'static str, String); 2] {
    let all: f64 = sources.iter().map(|source| source.error).sum();
    let seconds: f64 = sources.iter().map(|source| source.seconds).sum();
    let most = |of: fn(&ErrorSource) -> f64| {
        let largest = sources.iter().max_by(|a, b| of(a).total_cmp(&of(b)));
        largest.map_or(String::new(), |source| match source.option {
            "" => source.name.to_string(),
            option => format!("{} ({option})", source.name),
        })
    };
    let each: Vec<String> = sources
        .iter()
        .filter(|source| source.error > 0.0)
        .map(|source| format!("{} {:.1e}", source.name, source.error))
        .collect();
    let error = match each.len() {
        0 => "none seen".into(),
        _ => format!("{all:.1e} of the pressure, mostly {}: {}", most(|source| source.error), each.join(", ")),
    };
    let share = |source: &ErrorSource| format!("{} {:.0} %", source.name, 100.0 * source.seconds / seconds);
    let shares: Vec<String> = sources.iter().filter(|source| source.seconds > 0.005 * seconds).map(share).collect();
    let cost = match shares.len() {
        0 => "none".into(),
        _ => format!("mostly {}: {}", most(|source| source.seconds), shares.join(", ")),
    };
    [("error, estimated", error), ("cost", cost)]
}

/// Whether the case has [`ERRORS_FILE`].
pub fn is_there(case: &Path) -> bool {
    atomic::path_exists(&case.join(ERRORS_FILE))
}

/// Writes [`ERRORS_FILE`].
pub fn write_errors(case: &Path, sources: &[ErrorSource]) -> Result<(), Faults> {
    let row =
        |source: &ErrorSource| format!("{},{},{:e},{:e}\n", source.name, source.option, source.error, source.seconds);
    let text = format!("source,option,error,seconds\n{}", sources.iter().map(row).collect::<String>());
    atomic::write(&case.join(ERRORS_FILE), text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_half_is_one_of_time() {
        let of = |times: &[f64]| second_half(&times.iter().map(|t| [*t]).collect::<Vec<_>>()).len();
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
            sample.push([k as f64]);
        }
        assert!(sample.rows.len() > MAX_ROWS / 2 && sample.rows.len() <= MAX_ROWS);
        assert_eq!(sample.stride, 16);
        assert!((0..).zip(&sample.rows).all(|(k, row)| row[0] == f64::from(k * 16)));
    }

    #[test]
    fn noise_is_the_smaller_bound() {
        // What jumps to and fro by 2 each step, and averages out: four intervals of four steps.
        assert_eq!(step_noise(&[1.0, 3.0].repeat(8), &[2.0, 2.5, 2.0, 2.5]), 0.25);
        // What grows by 0.1 a step, 1 an interval.
        assert_eq!(step_noise(&[1.0, 1.125, 1.25], &[1.0, 2.0, 3.0, 4.0]), 0.25);
        // A single change of means tells nothing.
        assert_eq!(step_noise(&[1.0, 3.0, 1.0, 3.0], &[2.0, 2.0]), 4.0);
    }

    #[test]
    fn what_dominates_is_named() {
        let source = |name, option, error, seconds| ErrorSource { name, option, error, seconds };
        let sources = [
            source("contacts", "tol", 1e-2, 1.0),
            source("step", "dt", 4e-2, 0.5),
            source("gravity", "gravity_error", 0.0, 8.5),
        ];
        let [(_, error), (_, cost)] = summary_lines(&sources);
        assert_eq!(error, "5.0e-2 of the pressure, mostly step (dt): contacts 1.0e-2, step 4.0e-2");
        assert_eq!(cost, "mostly gravity (gravity_error): contacts 10 %, step 5 %, gravity 85 %");
    }
}
