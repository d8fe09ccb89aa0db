//! Values of the presets of accuracy: defaults of the options of COMPUTE.RON that trade speed for accuracy.
//!
//! The values were chosen by errors and run times of the scenes in `examples/accuracy-study`, which
//! `docs/explanation/accuracy.md` shows.

use crate::accuracy::{Adaptive, ChosenOptions};
use crate::compute::{Compute, NarrowPhase};

/// Option that a preset of accuracy decides unless it is set itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PresetOption {
    pub name: &'static str,
    /// Value in force, in RON.
    pub value: String,
    /// Whether the option itself is set.
    pub is_set: bool,
}

macro_rules! knobs {
    ($($name:ident: $type:ty = [$none:expr, $draft:expr, $standard:expr, $fine:expr, $reference:expr], $chosen:expr;)+) => {
        impl Compute {
            $(
                /// Value in force: the option of this name, the value that the run has chosen for `target_error`, or the value
                /// of the preset `accuracy`. Without a preset it is that of `standard`, in steps of `dt`, which need only a
                /// larger `tol`.
                pub fn $name(&self) -> $type {
                    let column = self.accuracy.map_or(0, |accuracy| accuracy as usize + 1);
                    let preset_value = [$none, $draft, $standard, $fine, $reference][column];
                    let chosen_value: fn(&ChosenOptions) -> Option<$type> = $chosen;
                    self.$name.or(chosen_value(&self.chosen)).unwrap_or(preset_value)
                }
            )+

            /// Every option that `accuracy` decides.
            pub fn accuracy_options(&self) -> Vec<PresetOption> {
                vec![$(PresetOption {
                    name: stringify!($name),
                    value: ron::to_string(&self.$name()).unwrap_or_default(),
                    is_set: self.$name.is_some(),
                },)+]
            }
        }
    };
}

/// All steps are `dt`.
const FIXED_STEP: Adaptive = Adaptive { max_multiple: 1, travel: 0.1, penetration: 1e-3 };
/// Adaptive steps of `standard`.
const STANDARD_STEP: Adaptive = Adaptive { max_multiple: 4, travel: 0.1, penetration: 1e-3 };
/// Adaptive steps of `draft`.
const DRAFT_STEP: Adaptive = Adaptive { max_multiple: 16, travel: 0.17, penetration: 3e-3 };

knobs! {
    // none, draft, standard, fine, reference; value of a run with `target_error`
    adaptive: Adaptive = [FIXED_STEP, DRAFT_STEP, STANDARD_STEP, FIXED_STEP, FIXED_STEP], |options| options.adaptive;
    tol: f64 = [1e-2, 2e-2, 5e-3, 1e-3, 1e-4], |options| options.tol;
    penetration_tol: f64 = [5e-4, 1e-3, 5e-4, 2e-4, 1e-4], |options| options.penetration_tol;
    max_sweeps: u64 = [20_000, 500, 20_000, 20_000, 20_000], |_| None;
    narrow_phase: NarrowPhase = [NarrowPhase::Accurate, NarrowPhase::Accurate, NarrowPhase::Accurate, NarrowPhase::Accurate, NarrowPhase::Accurate], |_| None;
    gravity_error: f64 = [1e-3, 1e-2, 1e-3, 1e-4, 1e-6], |options| options.gravity_error;
    gravity_refresh: u64 = [16, 16, 16, 16, 1], |_| None;
}
