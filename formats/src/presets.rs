//! Values of the presets of accuracy: defaults of the options that trade speed for accuracy.

use crate::accuracy::Adaptive;
use crate::compute::{Compute, NarrowPhase};

macro_rules! knobs {
    ($($name:ident: $type:ty = [$none:expr, $draft:expr, $standard:expr, $fine:expr, $reference:expr];)+) => {
        impl Compute {
            $(
                /// Value in force: the option of this name, or the value of the preset `accuracy`. Without a preset it is
                /// that of `standard`, in steps of `dt`, which need only a larger `tol`.
                pub fn $name(&self) -> $type {
                    let column = self.accuracy.map_or(0, |accuracy| accuracy as usize + 1);
                    self.$name.unwrap_or([$none, $draft, $standard, $fine, $reference][column])
                }
            )+

            /// Name and value in force of every option that `accuracy` decides, and whether the option itself is set.
            pub fn accuracy_options(&self) -> Vec<(&'static str, String, bool)> {
                let text = |value: Result<String, ron::Error>| value.unwrap_or_default();
                vec![$((stringify!($name), text(ron::to_string(&self.$name())), self.$name.is_some()),)+]
            }
        }
    };
}

/// Adaptive steps of up to `max_multiple` times `dt`.
const fn up_to(max_multiple: u64, travel: f64, penetration: f64) -> Adaptive {
    Adaptive { max_multiple, travel, penetration }
}

const FIXED_STEP: Adaptive = up_to(1, 0.1, 1e-3);

knobs! {
    // none, draft, standard, fine, reference
    adaptive: Adaptive = [FIXED_STEP, up_to(16, 0.17, 3e-3), up_to(4, 0.1, 1e-3), FIXED_STEP, FIXED_STEP];
    tol: f64 = [1e-2, 2e-2, 5e-3, 1e-3, 1e-4];
    penetration_tol: f64 = [5e-4, 1e-2, 5e-4, 2e-4, 1e-4];
    max_sweeps: u64 = [20_000, 500, 20_000, 20_000, 20_000];
    narrow_phase: NarrowPhase = [NarrowPhase::Accurate, NarrowPhase::Accurate, NarrowPhase::Accurate, NarrowPhase::Accurate, NarrowPhase::Accurate];
    gravity_error: f64 = [1e-3, 1e-2, 1e-3, 1e-4, 1e-6];
    gravity_refresh: u64 = [16, 16, 16, 16, 1];
}
