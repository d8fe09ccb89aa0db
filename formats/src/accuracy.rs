//! Presets of accuracy, and the options `adaptive` and `target_error` of COMPUTE.RON; [`crate::presets`] has the values of
//! the presets.

use serde::{Deserialize, Serialize};

use crate::ron_file::option_from_flag;

/// Preset of the options that trade speed for accuracy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Accuracy {
    #[value(help = DRAFT)]
    Draft,
    #[value(help = STANDARD)]
    Standard,
    #[value(help = FINE)]
    Fine,
    #[value(help = REFERENCE)]
    Reference,
}

// Written by `make accuracy-study`, from docs/accuracy/accuracy.awk.
const DRAFT: &str = include_str!("accuracy/draft.txt");
const STANDARD: &str = include_str!("accuracy/standard.txt");
const FINE: &str = include_str!("accuracy/fine.txt");
const REFERENCE: &str = include_str!("accuracy/reference.txt");

impl Accuracy {
    /// All presets, from the fastest to the most accurate.
    pub const ALL: [Accuracy; 4] = [Accuracy::Draft, Accuracy::Standard, Accuracy::Fine, Accuracy::Reference];

    /// Cost and error of the preset as measured on the scenes of examples/accuracy-study.
    pub fn measured_cost_and_error(self) -> &'static str {
        [DRAFT, STANDARD, FINE, REFERENCE][self as usize]
    }

    /// Ratio of the suitable time step to that of `Standard`: errors of impacts are of first order in the step.
    pub fn step_factor(self) -> f64 {
        [4.0, 1.0, 0.25, 0.0625][self as usize]
    }
}

impl std::fmt::Display for Accuracy {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(["draft", "standard", "fine", "reference"][*self as usize])
    }
}

/// Option `adaptive`: limits of steps that are several times `dt` where little happens.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Adaptive {
    /// Ratio of the longest step to `dt`; 1: all steps are `dt`.
    pub max_multiple: u64,
    /// Largest relative displacement of two neighbours in a step, divided by the smaller radius; separation counts
    /// half.
    pub travel: f64,
    /// Largest penetration that a step may cause, divided by the smaller radius.
    pub penetration: f64,
}

impl Default for Adaptive {
    fn default() -> Self {
        Adaptive { max_multiple: 1, travel: 0.1, penetration: 1e-3 }
    }
}

impl Adaptive {
    /// Largest `max_multiple` that is accepted.
    pub const MAX_STEP_MULTIPLE: u64 = 1_000_000;

    /// Whether steps may be longer than `dt`.
    pub fn is_on(&self) -> bool {
        self.max_multiple > 1
    }

    /// Whether the values are in range.
    pub(crate) fn is_sound(&self) -> bool {
        let is_positive = |x: f64| x.is_finite() && x > 0.0;
        (1..=Self::MAX_STEP_MULTIPLE).contains(&self.max_multiple)
            && is_positive(self.travel)
            && is_positive(self.penetration)
    }
}

impl std::str::FromStr for Adaptive {
    type Err = crate::ron_text::FlagError;
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        option_from_flag("adaptive", text)
    }
}

/// Option `target_error`: largest relative errors of means over time, without the scatter of single realisations. The run
/// chooses the other options that trade speed for accuracy.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TargetErrors {
    /// Neighbours per grain.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub z: Option<f64>,
    /// Solid fraction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nu: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub semi_axes: Option<f64>,
    /// Kinetic and potential energy.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub energy: Option<f64>,
}

impl TargetErrors {
    /// Smallest and largest target that is accepted: below, chance usually prevails; above, a mean says little.
    pub const RANGE: [f64; 2] = [1e-4, 0.3];

    /// Names of the observables, in the order of [`Self::values`].
    pub const NAMES: [&str; 5] = ["z", "nu", "pressure", "semi_axes", "energy"];

    /// Target of each observable.
    pub fn values(&self) -> [Option<f64>; 5] {
        [self.z, self.nu, self.pressure, self.semi_axes, self.energy]
    }
}

impl std::str::FromStr for TargetErrors {
    type Err = crate::ron_text::FlagError;
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        option_from_flag("target_error", text)
    }
}

/// Values that a run chooses for [`TargetErrors`], of options that are not set themselves.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ChosenOptions {
    pub adaptive: Option<Adaptive>,
    pub tol: Option<f64>,
    pub penetration_tol: Option<f64>,
    pub gravity_error: Option<f64>,
}

/// Mean of values, of which later ones have more weight.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct RunningMean {
    pub mean: f64,
    /// Mean of the squares.
    pub squared: f64,
    /// Number of values.
    pub count: u64,
}

impl RunningMean {
    /// Weight of a new value, after the first ones.
    const WEIGHT: f64 = 0.2;

    /// Adds a value.
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        let weight = (1.0 / self.count as f64).max(Self::WEIGHT);
        self.mean += weight * (value - self.mean);
        self.squared += weight * (value * value - self.squared);
    }

    /// Twice the standard error of the mean; `None` for fewer than three values.
    pub fn uncertainty(&self) -> Option<f64> {
        // Sum of the squared weights: 1/n of the first n values, w/(2 - w) in the end.
        let share = (1.0 / self.count.max(1) as f64).max(Self::WEIGHT / (2.0 - Self::WEIGHT));
        let variance = (self.squared - self.mean * self.mean).max(0.0) / (1.0 - share).max(0.5);
        (self.count >= 3).then(|| 2.0 * (share * variance).sqrt())
    }

    /// Size of the mean as far as it exceeds its uncertainty; of fewer than three values its whole size.
    pub fn significant_size(&self) -> f64 {
        (self.mean.abs() - self.uncertainty().unwrap_or(0.0)).max(0.0)
    }
}

/// State of the choice of options for [`TargetErrors`].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct AccuracyControl {
    /// Options in force unless they are set explicitly: `tol`, `penetration` of `adaptive`, and `gravity_error`.
    pub tol: f64,
    pub penetration: f64,
    pub gravity_error: f64,
    /// Largest number of `dt` in a step.
    pub longest_multiple: u64,
    /// Number of steps that were also solved to a much smaller residual, the comparisons.
    pub comparisons: u64,
    /// Sweeps of the last comparison, and of the steps since.
    pub last_sweeps: u64,
    pub sweeps_since: u64,
    /// Relative excess of contacts that carry force over the better solution.
    pub contacts_excess: RunningMean,
    /// Relative error of Σ f·l against the better solution.
    pub virial_error: RunningMean,
    /// Sweeps of all comparisons, and of all steps.
    pub comparison_sweeps: u64,
    pub step_sweeps: u64,
}

#[cfg(test)]
mod tests {
    use super::RunningMean;

    /// A constant is significant in full; values that alternate about zero are not; a mean beyond the scatter is in part.
    #[test]
    fn only_means_beyond_their_scatter_are_significant() {
        let size = |values: &[f64]| {
            let mut mean = RunningMean::default();
            (0..30).flat_map(|_| values).for_each(|value| mean.add(*value));
            mean.significant_size()
        };
        assert!((size(&[0.25]) - 0.25).abs() < 1e-12);
        assert_eq!(size(&[0.1, -0.1]), 0.0);
        let part = size(&[1.0, 1.2]);
        assert!(part > 0.9 && part < 1.1, "{part}");
        assert_eq!(RunningMean::default().significant_size(), 0.0);
    }

    /// The standard error of the mean of three values of variance 1/3: ((2/9) / (1 - 1/3) / 3)^(1/2) = 1/3.
    #[test]
    fn the_uncertainty_is_twice_the_standard_error() {
        let mut mean = RunningMean::default();
        [0.0, 0.0].into_iter().for_each(|value| mean.add(value));
        assert_eq!(mean.uncertainty(), None);
        mean.add(1.0);
        assert!((mean.uncertainty().unwrap() - 2.0 / 3.0).abs() < 1e-12);
    }
}
