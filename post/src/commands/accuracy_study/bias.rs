//! Biases of settings against a reference with several seeds, orders of convergence, and the Pareto front.

use crate::commands::replicates::Estimate;
use crate::math::{FittedLine, median};

/// Observables whose errors are separated into bias and chance, in the order of their columns in accuracy.csv.
pub const OBSERVABLES: [&str; 7] = ["Z", "nu", "pressure", "a", "b", "c", "energy"];

/// Observables that are wanted by default, as long as they have values.
pub const DEFAULT_OBSERVABLES: [&str; 3] = ["Z", "nu", "pressure"];

/// Mean of an observable of a run minus that of the reference with the same seed, and the latter; NaN without a value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanPair {
    pub difference: f64,
    pub exact: f64,
}

impl MeanPair {
    /// Pair of an observable without values.
    pub const UNDEFINED: MeanPair = MeanPair { difference: f64::NAN, exact: f64::NAN };

    /// Relative error.
    pub fn relative_error(&self) -> f64 {
        (self.difference / self.exact).abs()
    }
}

/// Run of a setting with one seed.
#[derive(Debug, Clone, PartialEq)]
pub struct SeedRun {
    /// Time of all stages of all steps, s.
    pub seconds: f64,
    /// Pairs in the order of [`OBSERVABLES`].
    pub pairs: [MeanPair; OBSERVABLES.len()],
}

/// Runs of a setting.
#[derive(Debug, Clone, PartialEq)]
pub struct SettingRuns {
    /// Values of the parameters, as a name.
    pub name: String,
    /// Name of the settings that differ from this one in one number.
    pub group: String,
    /// Value of this number; NaN for none.
    pub value: f64,
    /// Time step, s; NaN if the snapshots do not contain it.
    pub dt: f64,
    pub is_reference: bool,
    /// Runs, in the order of the seeds.
    pub runs: Vec<SeedRun>,
}

/// Bias of an observable, relative to the mean of the reference over the seeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bias {
    /// Mean of the differences, with its standard error; they are pairs of runs with equal seeds.
    pub estimate: Estimate,
    /// Root mean square difference of one run.
    pub rms: f64,
    /// Standard deviation of the difference of one run.
    pub chance: f64,
    /// Estimated error of the reference without chance, 0 if it is not known.
    pub reference: f64,
    /// Error by chance that the estimate of the error of the reference has from one run.
    pub reference_chance: f64,
    /// Number of runs.
    pub runs: usize,
}

impl Bias {
    /// Bias of an observable from its pairs, with an exact reference; NaN if one has no value.
    fn new(pairs: &[MeanPair]) -> Bias {
        let count = pairs.len() as f64;
        let scale = (pairs.iter().map(|pair| pair.exact).sum::<f64>() / count).abs();
        let differences: Vec<f64> = pairs.iter().map(|pair| pair.difference / scale).collect();
        let estimate = Estimate::of_mean(&differences);
        let squares: f64 = differences.iter().map(|x| x * x).sum();
        let chance = estimate.standard_error * count.sqrt();
        let rms = (squares / count).sqrt();
        Bias { estimate, rms, chance, reference: 0.0, reference_chance: 0.0, runs: pairs.len() }
    }

    /// Magnitude of the bias without the part that chance adds to it: √(b² - SE²), 0 if chance explains all.
    pub fn without_chance(&self) -> f64 {
        let Estimate { value, standard_error, .. } = self.estimate;
        (value * value - standard_error * standard_error).max(0.0).sqrt()
    }

    /// Error of the reference, with that by chance.
    pub fn reference_error(&self) -> f64 {
        self.reference.hypot(self.reference_chance / (self.runs as f64).sqrt())
    }

    /// Standard error of the bias and error of the reference together.
    pub fn uncertainty(&self) -> f64 {
        self.estimate.standard_error.hypot(self.reference_error())
    }

    /// Magnitude of the bias plus its uncertainty.
    pub fn bound(&self) -> f64 {
        self.estimate.value.abs() + self.uncertainty()
    }

    /// Number of replicates with which `bound` is expected to be at most `error`, as all chance falls with the root of their
    /// number; `None` if no number is enough.
    pub fn needed_replicates(&self, error: f64) -> Option<u64> {
        let margin = error - self.without_chance();
        let square = margin * margin - self.reference * self.reference;
        let number = ((self.chance.powi(2) + self.reference_chance.powi(2)) / square).ceil();
        (margin > 0.0 && square > 0.0 && number < 1e9).then_some((number as u64).max(2))
    }
}

/// Order of convergence of an observable in the number that a group varies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConvergenceOrder {
    /// Number of settings with a bias.
    pub settings: usize,
    /// Number of settings whose bias is above its noise floor.
    pub resolved: usize,
    /// Exponent of the number in the bias; NaN if fewer than [`MIN_RESOLVED`] settings are above the floor.
    pub order: f64,
    pub standard_error: f64,
}

/// Least number of settings above the noise floor from which an order is fitted.
pub const MIN_RESOLVED: usize = 3;

/// Ratio of a bias to its standard error from which on it is above the noise floor: 95 % of the biases by chance are below.
const NOISE_FLOOR: f64 = 2.0;

/// Order at which the reference converges if none can be fitted: that of impacts.
const DEFAULT_ORDER: f64 = 1.0;

/// Number of corrections of an order by the error of the reference; each reduces the remaining error by a factor of four or
/// more.
const CORRECTIONS: usize = 40;

/// Setting with its biases.
#[derive(Debug, Clone)]
pub struct SettingBias<'a> {
    pub runs: &'a SettingRuns,
    /// Median over the seeds, s.
    pub seconds: f64,
    /// Biases in the order of [`OBSERVABLES`].
    pub biases: [Bias; OBSERVABLES.len()],
}

impl SettingBias<'_> {
    /// Observable of these with the largest bound, and its bias; `None` if one has no bound.
    pub fn worst(&self, observables: &[usize]) -> Option<(usize, Bias)> {
        let biases = observables.iter().map(|&k| (k, self.biases[k]));
        let is_defined = observables.iter().all(|&k| self.biases[k].bound().is_finite());
        biases.max_by(|(_, a), (_, b)| a.bound().total_cmp(&b.bound())).filter(|_| is_defined)
    }

    /// Number of replicates with which the bounds of all of these observables are expected to be at most `error`.
    pub fn needed_replicates(&self, observables: &[usize], error: f64) -> Option<u64> {
        let needed: Option<Vec<u64>> = observables.iter().map(|&k| self.biases[k].needed_replicates(error)).collect();
        needed?.into_iter().max()
    }
}

/// Settings of a scene with their biases, and orders of convergence.
pub struct BiasStudy<'a> {
    /// Settings in the order of the study, the reference included.
    pub settings: Vec<SettingBias<'a>>,
    /// Groups that vary a number, with the order of each of [`OBSERVABLES`].
    pub orders: Vec<(&'a str, [ConvergenceOrder; OBSERVABLES.len()])>,
}

impl<'a> BiasStudy<'a> {
    /// Biases of the settings, which all have the same number of runs, one of them of the reference.
    pub fn new(setting_runs: &'a [SettingRuns]) -> BiasStudy<'a> {
        let bias =
            |runs: &SettingRuns, k: usize| Bias::new(&runs.runs.iter().map(|run| run.pairs[k]).collect::<Vec<_>>());
        let setting = |runs: &'a SettingRuns| SettingBias {
            runs,
            seconds: median(runs.runs.iter().map(|run| run.seconds)),
            biases: std::array::from_fn(|k| bias(runs, k)),
        };
        let mut study = BiasStudy { settings: setting_runs.iter().map(setting).collect(), orders: Vec::new() };
        let reference_dt = setting_runs.iter().find(|runs| runs.is_reference).map_or(f64::NAN, |runs| runs.dt);
        study.add_orders(reference_dt);
        study.add_reference_errors(reference_dt);
        study
    }

    /// Settings but the reference.
    pub fn compared_settings(&self) -> impl Iterator<Item = &SettingBias<'a>> {
        self.settings.iter().filter(|setting| !setting.runs.is_reference)
    }

    /// Fits the orders of the groups in which at least [`MIN_RESOLVED`] settings have a number; `reference_dt`: time step of
    /// the reference, s.
    fn add_orders(&mut self, reference_dt: f64) {
        let mut names: Vec<&str> = Vec::new();
        for setting in self.settings.iter().filter(|setting| setting.runs.value.is_finite()) {
            if !names.contains(&setting.runs.group.as_str()) {
                names.push(&setting.runs.group);
            }
        }
        for name in names {
            let members: Vec<&SettingBias> = self.compared_settings().filter(|one| one.runs.group == name).collect();
            if members.len() < MIN_RESOLVED {
                continue;
            }
            // The reference is not exact in the time step either.
            let reference = if is_step_group(name) { reference_dt } else { 0.0 };
            let number = |runs: &SettingRuns| if is_step_group(name) { runs.dt } else { runs.value };
            let orders = std::array::from_fn(|k| {
                let points: Vec<(f64, Estimate)> =
                    members.iter().map(|one| (number(one.runs), one.biases[k].estimate)).collect();
                ConvergenceOrder::new(&points, reference)
            });
            self.orders.push((name, orders));
        }
    }

    /// Estimates the error of the reference in each observable from the last setting with the shortest time step. A bias that
    /// falls with the power p of the step is b = C (h^p - h_r^p), and the error of the reference C h_r^p = b q/(1 - q) with
    /// q = (h_r/h)^p.
    fn add_reference_errors(&mut self, reference_dt: f64) {
        let steps = self.compared_settings().map(|setting| setting.runs.dt);
        let shortest = steps.fold(f64::INFINITY, f64::min);
        let is_finest = |setting: &&SettingBias| !setting.runs.is_reference && setting.runs.dt == shortest;
        let Some(finest) = self.settings.iter().rfind(is_finest) else { return };
        let ratio = reference_dt / shortest;
        if !(0.0..1.0).contains(&ratio) {
            return;
        }
        let orders = self.orders.iter().find(|(name, _)| *name == finest.runs.group && is_step_group(name));
        let errors: [[f64; 2]; OBSERVABLES.len()] = std::array::from_fn(|k| {
            let fitted = orders.map(|(_, orders)| orders[k].order).filter(|order| *order > 0.0);
            let share = ratio.powf(fitted.unwrap_or(DEFAULT_ORDER));
            let bias = &finest.biases[k];
            // Without a second run nothing is known of chance.
            let magnitude = if bias.runs > 1 { bias.without_chance() } else { bias.estimate.value.abs() };
            [magnitude, bias.chance].map(|error| error * share / (1.0 - share))
        });
        for setting in &mut self.settings {
            for (bias, errors) in setting.biases.iter_mut().zip(errors) {
                let [error, chance] = errors.map(|error| if error.is_finite() { error } else { 0.0 });
                (bias.reference, bias.reference_chance) = (error, chance);
            }
        }
    }

    /// Settings that no other beats in both time and bound, the fastest first.
    pub fn pareto_front(&self, observables: &[usize]) -> Vec<&SettingBias<'a>> {
        let bound = |setting: &SettingBias| setting.worst(observables).map(|(_, bias)| bias.bound());
        let mut front: Vec<&SettingBias> = self.compared_settings().filter(|one| bound(one).is_some()).collect();
        front.sort_by(|a, b| a.seconds.total_cmp(&b.seconds).then(bound(a).partial_cmp(&bound(b)).unwrap()));
        let mut best = f64::INFINITY;
        front.retain(|setting| {
            let value = bound(setting).unwrap_or(f64::NAN);
            let is_better = value < best;
            best = best.min(value);
            is_better
        });
        front
    }
}

/// Whether a group varies the time step: `dt`, or `dt; accuracy fine`.
fn is_step_group(name: &str) -> bool {
    name.split("; ").next() == Some("dt")
}

impl ConvergenceOrder {
    /// Order from the biases at values of a number, against a reference at the value `reference` of the number, 0 for an exact
    /// one.
    ///
    /// The line is that of least squares through the logarithms of those above the noise floor. With b = C (h^p - h_r^p) the
    /// bias is divided by 1 - (h_r/h)^p. The standard error is the larger one of that by the errors of the biases and that
    /// by the distances from the line.
    pub fn new(points: &[(f64, Estimate)], reference: f64) -> ConvergenceOrder {
        let known: Vec<&(f64, Estimate)> =
            points.iter().filter(|(x, bias)| *x > 0.0 && x.is_finite() && bias.value.is_finite()).collect();
        let is_resolved = |bias: &Estimate| bias.value.abs() > NOISE_FLOOR * bias.standard_error;
        let resolved: Vec<&(f64, Estimate)> = known.iter().copied().filter(|(_, bias)| is_resolved(bias)).collect();
        let undetermined = ConvergenceOrder {
            settings: known.len(),
            resolved: resolved.len(),
            order: f64::NAN,
            standard_error: f64::NAN,
        };
        if resolved.len() < MIN_RESOLVED {
            return undetermined;
        }
        let line = |order: f64| {
            let logarithms = resolved.iter().map(|(x, bias)| {
                let share = (reference / x).powf(order);
                let share = if order > 0.0 && share < 1.0 { share } else { 0.0 };
                (x.ln(), (bias.value.abs() / (1.0 - share)).ln())
            });
            let logarithms: Vec<(f64, f64)> = logarithms.collect();
            FittedLine::least_squares(&logarithms).map(|line| (line, logarithms))
        };
        let Some((mut fit, mut logarithms)) = line(0.0) else { return undetermined };
        for _ in 0..CORRECTIONS {
            let Some(corrected) = line(fit.slope) else { break };
            (fit, logarithms) = corrected;
        }
        let n = logarithms.len() as f64;
        let mean_x = logarithms.iter().map(|(x, _)| x).sum::<f64>() / n;
        let xx: f64 = logarithms.iter().map(|(x, _)| (x - mean_x) * (x - mean_x)).sum();
        let distances: f64 = logarithms.iter().map(|(x, y)| (y - fit.intercept - fit.slope * x).powi(2)).sum();
        let by_biases: f64 = logarithms
            .iter()
            .zip(&resolved)
            .map(|((x, _), (_, bias))| ((x - mean_x) / xx * bias.standard_error / bias.value).powi(2))
            .sum();
        let standard_error = by_biases.max(distances / (n - 2.0) / xx).sqrt();
        ConvergenceOrder { order: fit.slope, standard_error, ..undetermined }
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// Runs of a setting whose Z is 5 in the reference and has these relative errors, one a seed; nu has no error, and the
    /// others have no values.
    pub fn setting_runs(group: &str, dt: f64, seconds: f64, errors: &[f64]) -> SettingRuns {
        let run = |error: &f64| {
            let mut pairs = [MeanPair::UNDEFINED; OBSERVABLES.len()];
            pairs[0] = MeanPair { difference: 5.0 * error, exact: 5.0 };
            pairs[1] = MeanPair { difference: 0.0, exact: 0.6 };
            SeedRun { seconds, pairs }
        };
        let is_reference = group == "reference";
        let value = if is_reference { f64::NAN } else { dt };
        let runs = errors.iter().map(run).collect();
        SettingRuns { name: format!("{group} {dt}"), group: group.into(), value, dt, is_reference, runs }
    }

    /// Errors 0.01 (h^order - 0.125^order) with chance of a standard deviation `chance` and the mean 0, of three seeds.
    fn step_settings(order: f64, chance: f64) -> Vec<SettingRuns> {
        let errors = |bias: f64| [-1.0, 0.0, 1.0].map(|draw| bias + chance * draw);
        let bias = |h: f64| 0.01 * (h.powf(order) - 0.125f64.powf(order));
        let mut all: Vec<SettingRuns> =
            [4.0, 2.0, 1.0, 0.5].map(|h| setting_runs("dt", h, 1.0 / h, &errors(bias(h)))).to_vec();
        all.push(setting_runs("reference", 0.125, 20.0, &[0.0; 3]));
        all
    }

    #[test]
    fn orders_and_the_error_of_the_reference_are_found() {
        for order in [0.5, 1.0, 2.0] {
            let all = step_settings(order, 0.0);
            let study = BiasStudy::new(&all);
            let (group, orders) = &study.orders[0];
            // The corrections for the error of the reference converge to rounding.
            assert_eq!((*group, orders[0].settings, orders[0].resolved), ("dt", 4, 4));
            assert!((orders[0].order - order).abs() < 1e-9 && orders[0].standard_error < 1e-9, "{orders:?}");
            let expected = 0.01 * 0.125f64.powf(order);
            let bias = study.settings[2].biases[0];
            assert!((bias.reference - expected).abs() < 1e-9 * expected, "{bias:?}");
            // No error, and no value.
            assert_eq!((orders[1].resolved, orders[1].settings, orders[2].settings), (0, 4, 0));
            assert!(orders[1].order.is_nan() && study.settings[0].biases[2].estimate.value.is_nan());
        }
    }

    #[test]
    fn biases_below_the_noise_have_no_order() {
        // Standard errors of 0.004/√3 = 0.0023: the biases 0.039 to 0.00875 are above twice as much, 0.00375 is not.
        let all = step_settings(1.0, 0.004);
        let study = BiasStudy::new(&all);
        let order = study.orders[0].1[0];
        assert_eq!((order.settings, order.resolved), (4, 3));
        // The noise of the draws has the mean 0.
        assert!((order.order - 1.0).abs() < 1e-9, "{order:?}");
        // ln(h) = ln 4, ln 2, 0: the slope is (y1 - y3)/(2 ln 2), with the relative errors of both.
        let error = 0.004 / 3f64.sqrt();
        let expected = ((error / 0.03875).powi(2) + (error / 0.00875).powi(2)).sqrt() / (2.0 * 2f64.ln());
        assert!((order.standard_error - expected).abs() < 1e-9, "{order:?} {expected}");
        let all = step_settings(1.0, 0.01);
        let order = BiasStudy::new(&all).orders[0].1[0];
        assert!(order.resolved == 2 && order.order.is_nan() && order.standard_error.is_nan(), "{order:?}");
    }

    #[test]
    fn chance_is_separated_from_the_bias() {
        // Differences 0.2, 0.8: mean 0.5, s = 0.3 √2, SE = 0.3; RMS √(0.34).
        let pair = |difference: f64| MeanPair { difference, exact: -1.0 };
        let bias = Bias::new(&[pair(0.2), pair(0.8)]);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        near(bias.estimate.value, 0.5);
        near(bias.estimate.standard_error, 0.3);
        near(bias.without_chance(), 0.4);
        near(bias.rms, 0.34f64.sqrt());
        near(bias.chance, 0.3 * 2f64.sqrt());
        near(bias.bound(), 0.8);
        // With the reference: √(0.3² + 0.4²) = 0.5; 0.4 + √(0.18/n + 0.16) ≤ 0.91 for n ≥ 1.8.
        let bias = Bias { reference: 0.4, ..bias };
        near(bias.bound(), 1.0);
        assert_eq!((bias.needed_replicates(0.91), bias.needed_replicates(0.81)), (Some(2), Some(23)));
        assert_eq!((bias.needed_replicates(0.8), bias.needed_replicates(0.3)), (None, None));
        // One run has no error; chance explains all of a smaller bias.
        let single = Bias::new(&[pair(0.2)]);
        assert!(single.estimate.value == 0.2 && single.bound().is_nan() && single.needed_replicates(1.0).is_none());
        assert_eq!(Bias::new(&[pair(-0.2), pair(0.4)]).without_chance(), 0.0);
    }

    #[test]
    fn a_setting_that_another_beats_is_not_on_the_front() {
        let all = [
            setting_runs("a", 1.0, 1.0, &[0.1, 0.1]),
            setting_runs("b", 1.0, 2.0, &[0.2, 0.2]),
            setting_runs("c", 1.0, 3.0, &[0.01, 0.01]),
            setting_runs("reference", 1.0, 9.0, &[0.0, 0.0]),
        ];
        let study = BiasStudy::new(&all);
        let front: Vec<f64> = study.pareto_front(&[0, 1]).iter().map(|setting| setting.seconds).collect();
        // The reference has the steps of the others: its error is not known.
        assert_eq!((front, study.settings[0].biases[0].reference), (vec![1.0, 3.0], 0.0));
        assert!(study.pareto_front(&[0, 2]).is_empty());
    }
}
