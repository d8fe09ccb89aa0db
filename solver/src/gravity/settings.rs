//! Settings for a target error: order, opening and error share, from a table of measurements.

/// Lowest order of an expansion.
pub const LOWEST_ORDER: usize = 2;
/// Highest order of an expansion.
pub const HIGHEST_ORDER: usize = 8;

/// Smallest target error that the fast multipole method supports.
pub const MIN_FMM_ERROR: f64 = 1e-6;

/// Largest opening; beyond it expansions converge slowly.
const MAX_OPENING: f64 = 0.9;

/// Settings of the fast multipole method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpansionSettings {
    /// Total order p of the expansions.
    pub order: usize,
    /// Opening theta: cells are far only if the sum of their radii is below theta times the distance of their centres.
    pub opening: f64,
    /// Largest estimated error of one expansion, as a share of the pull at the target.
    pub share: f64,
    /// Largest number of bodies in a leaf.
    pub leaf: usize,
    /// Fraction of the leaves' radii beyond which pairs are summed in single precision; nearer sources are not.
    pub single: Option<f64>,
    /// Accuracy of a pair in single precision.
    pub pair: PairPrecision,
}

/// Relative error of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PairPrecision {
    /// 1.7e-4 without a potential, 2.5e-5 with it.
    Coarse,
    /// 2.5e-5.
    Medium,
    /// 3e-7.
    Fine,
}

/// Measured settings for a target error.
struct SettingsRow {
    /// Target error.
    error: f64,
    /// Total order of the expansions.
    order: usize,
    /// Largest ratio of the error of one expansion to the target error, for 1e5 bodies.
    share: f64,
    /// Relative increase of `share` for a thousand bodies, which have few cells far enough away to err.
    few_bodies_gain: f64,
    /// Number of bodies from which on the fast method is faster than the direct sum.
    crossover: usize,
}

/// Measured on uniform balls, jittered lattices and pairs of these of 1000 to 100 000 bodies: there the RMS relative
/// error, sqrt(sum |da|^2 / sum |a|^2), is an eighth to 0.94 of the target error, largest for pairs of lattices. Of the
/// orders that reach an error, the fastest is used.
const SETTINGS: [SettingsRow; 5] = [
    SettingsRow { error: 1e-2, order: 3, share: 0.7, few_bodies_gain: 0.8, crossover: 500 },
    SettingsRow { error: 1e-3, order: 5, share: 0.7, few_bodies_gain: 0.7, crossover: 600 },
    SettingsRow { error: 1e-4, order: 7, share: 0.58, few_bodies_gain: 1.5, crossover: 800 },
    SettingsRow { error: 1e-5, order: 8, share: 0.49, few_bodies_gain: 2.2, crossover: 1000 },
    SettingsRow { error: 1e-6, order: 8, share: 0.32, few_bodies_gain: 4.0, crossover: 6000 },
];

/// Returns the row of the largest error that does not exceed the target error.
fn settings_row(error: f64) -> &'static SettingsRow {
    SETTINGS.iter().find(|row| row.error <= error).unwrap_or(&SETTINGS[SETTINGS.len() - 1])
}

/// Number of bodies from which on the fast method is faster.
pub fn crossover_bodies(error: f64) -> usize {
    if error < MIN_FMM_ERROR { usize::MAX } else { settings_row(error).crossover }
}

impl ExpansionSettings {
    /// Settings that reach the target RMS relative error.
    pub fn for_error(error: f64, bodies: usize) -> Self {
        let row = settings_row(error);
        let target = error.clamp(row.error, 10.0 * row.error);
        let bodies = bodies.max(1000) as f64;
        // The errors of many cells cancel in part, but more bodies interact with more cells.
        let number_factor = libm::pow(1e5 / bodies, 0.25) * (1.0 + row.few_bodies_gain * (1000.0 / bodies).powi(2));
        ExpansionSettings {
            order: row.order,
            opening: MAX_OPENING,
            share: row.share * target * number_factor,
            leaf: if bodies < 3e4 { 40 } else { 48 },
            // Beyond this fraction of the radii, rounded positions spoil no pair by more than half the target error.
            single: (error > 2.0 * MIN_FMM_ERROR).then_some(2e-7 / error),
            pair: match error {
                4e-4.. => PairPrecision::Coarse,
                5e-5.. => PairPrecision::Medium,
                _ => PairPrecision::Fine,
            },
        }
    }
}
