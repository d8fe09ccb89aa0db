//! Presets of accuracy, and the option `adaptive` of COMPUTE.RON; [`crate::presets`] has the values of the presets.

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
