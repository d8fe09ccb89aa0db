//! Means over the replicates of a study - runs that differ in their seeds alone - with their errors, and differences between
//! sets of parameters.

use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::derive::SeriesValue;
use crate::math::median;
use crate::write::series::name_field;

/// Probability of the confidence intervals.
const CONFIDENCE: f64 = 0.95;

/// Largest number of replicates that is given as needed.
const MAX_REPLICATES: u64 = 1_000_000_000;

/// Columns of means.csv after those of the parameters: name, unit, meaning.
pub const MEAN_COLUMNS: [(&str, &str, &str); 9] = [
    ("quantity", "-", "column of runs.csv"),
    ("runs", "1", "number of replicates with a value"),
    ("mean", "of the quantity", "mean of the replicates"),
    ("standard_error", "of the quantity", "s/√n of the mean, s the standard deviation with n - 1"),
    ("low", "of the quantity", "lower end of the 95 % confidence interval of the mean, by Student's t"),
    ("high", "of the quantity", "upper end of this interval"),
    ("median", "of the quantity", "median of the replicates"),
    ("deviation", "of the quantity", "standard deviation s of one run"),
    ("needed", "1", "number of replicates for which the interval is as narrow as --error, relative to the mean"),
];

/// Columns of differences.csv: name, unit, meaning.
pub const DIFFERENCE_COLUMNS: [(&str, &str, &str); 10] = [
    ("first", "-", "parameters of the first set"),
    ("second", "-", "parameters of the second set, of which one differs"),
    ("quantity", "-", "column of runs.csv"),
    ("test", "-", "paired, if both sets have the same seeds; else welch"),
    ("difference", "of the quantity", "mean of the second set minus that of the first"),
    ("standard_error", "of the quantity", "of the difference"),
    ("low", "of the quantity", "lower end of the 95 % confidence interval of the difference"),
    ("high", "of the quantity", "upper end of this interval"),
    ("t", "1", "difference over its standard error"),
    ("p", "1", "probability of a t as large, in either direction, if the two means are equal"),
];

/// Run as a replicate of its set of parameters.
pub struct Replicate<'a> {
    /// Names and values of the parameters that distinguish the sets.
    pub parameters: Vec<(&'a str, &'a str)>,
    /// Seed, by which replicates of two sets are paired.
    pub seed: &'a str,
    /// Values by quantity; not finite where the run has none.
    pub values: &'a [f64],
}

/// Runs that differ in their seeds alone.
struct ReplicateSet<'a> {
    parameters: &'a [(&'a str, &'a str)],
    runs: Vec<&'a Replicate<'a>>,
}

/// Estimate of a mean or difference with its error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Mean or difference.
    pub value: f64,
    /// Standard error of `value`; NaN of a single run.
    pub standard_error: f64,
    /// Degrees of freedom of Student's distribution.
    freedom: f64,
}

impl Estimate {
    /// Mean of some values, with s/√n.
    pub fn of_mean(values: &[f64]) -> Estimate {
        let n = values.len() as f64;
        let value = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|x| (x - value) * (x - value)).sum();
        Estimate { value, standard_error: (squares / (n - 1.0) / n).sqrt(), freedom: n - 1.0 }
    }

    /// Difference of two means, `b` minus `a`, of independent values with different variances.
    ///
    /// Source: B. L. Welch, Biometrika 34 (1947) 28-35.
    pub fn of_difference(a: Estimate, b: Estimate) -> Estimate {
        let squares = [a, b].map(|mean| mean.standard_error * mean.standard_error);
        let sum = squares[0] + squares[1];
        let freedom = sum * sum / (squares[0] * squares[0] / a.freedom + squares[1] * squares[1] / b.freedom);
        Estimate { value: b.value - a.value, standard_error: sum.sqrt(), freedom }
    }

    /// Half the width of the confidence interval; NaN without degrees of freedom, 0 without scatter.
    pub fn half_width(&self) -> f64 {
        if self.standard_error == 0.0 { 0.0 } else { critical_t(self.freedom) * self.standard_error }
    }

    /// Difference over its standard error, and the probability of such a one in either direction if the means are equal; NaN
    /// without scatter.
    pub fn t_and_p(&self) -> [f64; 2] {
        let t = self.value / self.standard_error;
        let p = student(self.freedom).filter(|_| t.is_finite()).map_or(f64::NAN, |student| 2.0 * student.cdf(-t.abs()));
        [if t.is_finite() { t } else { f64::NAN }, p]
    }
}

/// Degrees of freedom beyond which Student's distribution counts as that of so many: quantiles differ from the normal ones by
/// a millionth.
const MAX_FREEDOM: f64 = 1e6;

/// Student's distribution, if there are degrees of freedom.
fn student(freedom: f64) -> Option<StudentsT> {
    StudentsT::new(0.0, 1.0, freedom.min(MAX_FREEDOM)).ok()
}

/// Value of |t| that a share [`CONFIDENCE`] of the draws does not exceed; NaN without degrees of freedom.
fn critical_t(freedom: f64) -> f64 {
    let Some(student) = student(freedom).filter(|_| freedom > 0.0) else { return f64::NAN };
    let quantile = 0.5 * (1.0 + CONFIDENCE);
    // Bisection: the inverse of the library does not end for all numbers of degrees of freedom.
    let (mut low, mut high) = (0.0, 1.0);
    while student.cdf(high) < quantile {
        (low, high) = (high, 2.0 * high);
    }
    while high - low > 1e-12 * high {
        let middle = 0.5 * (low + high);
        if student.cdf(middle) < quantile { low = middle } else { high = middle }
    }
    high
}

/// Smallest number of replicates with the standard deviation `deviation` for which half the width of the confidence interval is
/// at most `width`; `None` if it is larger than 10⁹ or not known.
pub fn needed_replicates(deviation: f64, width: f64) -> Option<u64> {
    let is_enough = |n: u64| critical_t((n - 1) as f64) * deviation <= width * (n as f64).sqrt();
    if deviation == 0.0 {
        return Some(2);
    }
    if !is_enough(MAX_REPLICATES) {
        return None;
    }
    let (mut too_few, mut enough) = (1, MAX_REPLICATES);
    while enough - too_few > 1 {
        let middle = too_few + (enough - too_few) / 2;
        if is_enough(middle) { enough = middle } else { too_few = middle }
    }
    Some(enough)
}

/// Names and values of parameters, as a field of a table; those without a value are left out.
pub fn parameter_label(parameters: &[(&str, &str)]) -> String {
    let parts = parameters.iter().filter(|(_, value)| !value.is_empty());
    let text: Vec<String> = parts.map(|(name, value)| format!("{name} {value}").trim().to_string()).collect();
    name_field(&text.join("; "))
}

/// Sets of parameters in the order of their first runs.
fn replicate_sets<'a>(runs: &'a [Replicate<'a>]) -> Vec<ReplicateSet<'a>> {
    let mut sets: Vec<ReplicateSet> = Vec::new();
    for run in runs {
        match sets.iter_mut().find(|set| set.parameters == run.parameters) {
            Some(set) => set.runs.push(run),
            None => sets.push(ReplicateSet { parameters: &run.parameters, runs: vec![run] }),
        }
    }
    sets
}

/// Means of a study.
pub struct ReplicateTables {
    /// Text of means.csv.
    pub means: String,
    /// Text of differences.csv.
    pub differences: String,
    /// Number of sets of parameters.
    pub sets: usize,
    /// Largest number of replicates that a set needs, for each quantity; `None` without a bound.
    pub needed: Vec<Option<u64>>,
}

impl ReplicateTables {
    /// Tables of `runs` with values of these `quantities`; `error`: half the width of the confidence interval that is
    /// requested, over the mean. `None` if no set of parameters has two runs.
    pub fn new(runs: &[Replicate], quantities: &[&str], error: f64) -> Option<ReplicateTables> {
        let sets = replicate_sets(runs);
        if sets.iter().all(|set| set.runs.len() < 2) {
            return None;
        }
        let names = sets[0].parameters.iter().map(|(name, _)| name_field(name));
        let header: Vec<String> = names.chain(MEAN_COLUMNS.map(|(name, _, _)| name.to_string())).collect();
        let mut means = header.join(",") + "\n";
        let mut needed: Vec<Option<u64>> = vec![Some(0); quantities.len()];
        for set in &sets {
            for (k, quantity) in quantities.iter().enumerate() {
                let values = set.values(k);
                if values.is_empty() {
                    continue;
                }
                let (mean, n) = (Estimate::of_mean(&values), values.len() as f64);
                let deviation = mean.standard_error * n.sqrt();
                let replicates = needed_replicates(deviation, error * mean.value.abs()).filter(|_| values.len() > 1);
                if values.len() > 1 {
                    needed[k] = needed[k].zip(replicates).map(|(a, b)| a.max(b));
                }
                let [low, high] = [-1.0, 1.0].map(|sign| mean.value + sign * mean.half_width());
                let middle = median(values.iter().copied());
                let numbers = [mean.value, mean.standard_error, low, high, middle, deviation];
                let fields = set.parameters.iter().map(|(_, value)| name_field(value));
                let fields = fields.chain([quantity.to_string(), values.len().to_string()]);
                let fields = fields.chain(numbers.iter().map(SeriesValue::text));
                let fields = fields.chain([replicates.map_or(String::new(), |n| n.to_string())]);
                means += &(fields.collect::<Vec<_>>().join(",") + "\n");
            }
        }
        let differences = differences_text(&sets, quantities);
        Some(ReplicateTables { means, differences, sets: sets.len(), needed })
    }
}

impl ReplicateSet<'_> {
    /// Values of quantity `k` of the runs that have one.
    fn values(&self, k: usize) -> Vec<f64> {
        self.runs.iter().map(|run| run.values[k]).filter(|value| value.is_finite()).collect()
    }

    /// Names and values of the parameters, as a field of a table.
    fn label(&self) -> String {
        parameter_label(self.parameters)
    }

    /// Difference of the means of quantity `k` from this set to another one, and the name of the test. Runs of equal seeds
    /// start from equal random numbers: if all have a partner, the differences of partners scatter less than the runs.
    fn difference(&self, other: &ReplicateSet, k: usize) -> Option<(Estimate, &'static str)> {
        let value_of_seed = |set: &ReplicateSet, seed: &str| {
            let mut runs = set.runs.iter().filter(|run| run.seed == seed && !seed.is_empty());
            let run = runs.next()?;
            runs.next().is_none().then_some(run.values[k]).filter(|value| value.is_finite())
        };
        let partners: Option<Vec<f64>> = self
            .runs
            .iter()
            .map(|run| Some(value_of_seed(other, run.seed)? - value_of_seed(self, run.seed)?))
            .collect();
        match partners.filter(|differences| differences.len() > 1 && self.runs.len() == other.runs.len()) {
            Some(differences) => Some((Estimate::of_mean(&differences), "paired")),
            None => {
                let values = [self, other].map(|set| set.values(k));
                let [a, b] = [&values[0], &values[1]].map(|values| Estimate::of_mean(values));
                values.iter().all(|values| values.len() > 1).then(|| (Estimate::of_difference(a, b), "welch"))
            }
        }
    }
}

/// Text of differences.csv: pairs of sets that differ in one parameter.
fn differences_text(sets: &[ReplicateSet], quantities: &[&str]) -> String {
    let mut text = DIFFERENCE_COLUMNS.map(|(name, _, _)| name).join(",") + "\n";
    let differ_in_one = |a: &ReplicateSet, b: &ReplicateSet| {
        a.parameters.iter().zip(b.parameters).filter(|((_, a), (_, b))| a != b).count() == 1
    };
    for (i, first) in sets.iter().enumerate() {
        for second in sets[i + 1..].iter().filter(|second| differ_in_one(first, second)) {
            for (k, quantity) in quantities.iter().enumerate() {
                let Some((estimate, test)) = first.difference(second, k) else { continue };
                let [low, high] = [-1.0, 1.0].map(|sign| estimate.value + sign * estimate.half_width());
                let [t, p] = estimate.t_and_p();
                let numbers = [estimate.value, estimate.standard_error, low, high, t, p].map(|x| x.text());
                let labels = [first.label(), second.label()];
                text += &format!("{},{quantity},{test},{}\n", labels.join(","), numbers.join(","));
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Quantiles and probabilities of Student's distribution as tables print them: t(0.975; 4) = 2.776, t(0.975; 9) = 2.262;
    /// |t| > 2.776 with 4 degrees of freedom has the probability 0.05.
    #[test]
    fn intervals_have_the_widths_of_student() {
        assert!((critical_t(4.0) - 2.776445).abs() < 1e-6 && (critical_t(9.0) - 2.262157).abs() < 1e-6);
        let mean = Estimate::of_mean(&[1.0, 2.0, 3.0, 4.0, 5.0]);
        // s² = 2.5, s/√5 = √0.5
        assert_eq!((mean.value, mean.freedom), (3.0, 4.0));
        assert!((mean.standard_error - 0.5f64.sqrt()).abs() < 1e-15);
        assert!((mean.half_width() - 2.776445 * 0.5f64.sqrt()).abs() < 1e-6);
        let difference = Estimate { value: 2.776445, standard_error: 1.0, freedom: 4.0 };
        assert!((difference.t_and_p()[1] - 0.05).abs() < 1e-7);
        let single = Estimate::of_mean(&[7.0]);
        assert!(single.value == 7.0 && single.half_width().is_nan() && single.t_and_p()[1].is_nan());
        let equal = Estimate::of_mean(&[7.0, 7.0]);
        assert!(equal.half_width() == 0.0 && equal.t_and_p()[0].is_nan());
    }

    /// Equal variances and numbers give the degrees of freedom of the test with a common variance, 2 (n - 1).
    #[test]
    fn welch_equals_the_common_variance_test_for_equal_samples() {
        let (a, b) = (Estimate::of_mean(&[1.0, 2.0, 3.0]), Estimate::of_mean(&[5.0, 6.0, 7.0]));
        let difference = Estimate::of_difference(a, b);
        assert!((difference.freedom - 4.0).abs() < 1e-12 && difference.value == 4.0);
        assert!((difference.standard_error - (2.0f64 / 3.0).sqrt()).abs() < 1e-15);
    }

    #[test]
    fn as_many_replicates_are_needed_as_narrow_the_interval_to() {
        // 1.959964² (1 / 0.1)² = 384.1, and Student's t of so many is a little larger than 1.96.
        assert_eq!(needed_replicates(1.0, 0.1), Some(387));
        let half_width = |n: f64| critical_t(n - 1.0) / n.sqrt();
        assert!(half_width(387.0) <= 0.1 && half_width(386.0) > 0.1);
        assert_eq!(needed_replicates(0.0, 0.1), Some(2));
        assert_eq!(needed_replicates(1.0, 0.0), None);
        assert_eq!(needed_replicates(f64::NAN, 0.1), None);
    }

    /// Intervals of 5 and 10 values contain the mean in 93 to 96.5 % of the draws, which a factor of 1.96 in place of Student's t
    /// would miss for 5 values (88 %). The values are sums of two uniform numbers.
    #[test]
    fn intervals_contain_the_mean_as_often_as_they_say() {
        let mut state = 1u64;
        let mut draw = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for (count, lowest) in [(5, 0.93), (10, 0.935)] {
            let trials = 20000;
            let critical = critical_t(count as f64 - 1.0);
            let mut hits = 0;
            for _ in 0..trials {
                let values: Vec<f64> = (0..count).map(|_| draw() + draw()).collect();
                let mean = Estimate::of_mean(&values);
                hits += usize::from((mean.value - 1.0).abs() <= critical * mean.standard_error);
            }
            let share = hits as f64 / trials as f64;
            // Standard error of the share: 0.0015.
            assert!((lowest..0.965).contains(&share), "{count}: {share}");
        }
    }

    #[test]
    fn pairs_of_equal_seeds_have_smaller_errors() {
        let values: Vec<Vec<f64>> =
            [0.0, 10.0, 20.0].iter().flat_map(|s| [vec![*s], vec![s + 1.0 + 0.01 * s]]).collect();
        let runs: Vec<Replicate> = values
            .iter()
            .enumerate()
            .map(|(k, values)| Replicate {
                parameters: vec![("mu", ["0.2", "0.4"][k % 2]), ("N", "500")],
                seed: ["1", "2", "3"][k / 2],
                values,
            })
            .collect();
        let tables = ReplicateTables::new(&runs, &["Z"], 0.01).unwrap();
        assert_eq!(tables.sets, 2);
        let means: Vec<&str> = tables.means.lines().collect();
        assert!(means[0].starts_with("mu,N,quantity,runs,mean,standard_error,low,high,median,deviation,needed"));
        assert!(means[1].starts_with("0.2,500,Z,3,10.0,5.77"), "{}", means[1]);
        let row: Vec<&str> = tables.differences.lines().nth(1).unwrap().split(',').collect();
        assert_eq!(row[..4], ["mu 0.2; N 500", "mu 0.4; N 500", "Z", "paired"]);
        let number = |k: usize| row[k].parse::<f64>().unwrap();
        // Differences 1, 1.1, 1.2.
        assert!((number(4) - 1.1).abs() < 1e-12 && (number(5) - 0.1 / 3f64.sqrt()).abs() < 1e-12, "{row:?}");
        // Without seeds the scatter of the runs counts.
        let without: Vec<Replicate> =
            runs.iter().map(|run| Replicate { seed: "", parameters: run.parameters.clone(), ..*run }).collect();
        let text = ReplicateTables::new(&without, &["Z"], 0.01).unwrap().differences;
        let row: Vec<&str> = text.lines().nth(1).unwrap().split(',').collect();
        assert!(row[3] == "welch" && row[5].parse::<f64>().unwrap() > 8.0, "{row:?}");
        assert!(ReplicateTables::new(&runs[..2], &["Z"], 0.01).is_none());
    }
}
