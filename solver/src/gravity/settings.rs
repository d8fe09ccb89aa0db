//! What an error asked for takes: order, opening and share of error, from a table of measurements.

/// Orders of an expansion.
pub const LOWEST_ORDER: usize = 2;
pub const HIGHEST_ORDER: usize = 8;

/// Smallest error that the fast multipole method is made for.
pub const MIN_FMM_ERROR: f64 = 1e-6;

/// Cells are never farther apart than this says: beyond it expansions converge slowly.
const MAX_OPENING: f64 = 0.9;

/// Settings of the fast multipole method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpansionSettings {
    /// Total order p of the expansions.
    pub order: usize,
    /// Opening theta: cells are far only if the sum of their radii is below theta times the distance of their centres.
    pub opening: f64,
    /// Largest error of one expansion as its orders tell, as a share of the pull that there is.
    pub share: f64,
    /// Most bodies in a leaf.
    pub leaf: usize,
    /// Pairs in single precision, but for sources nearer than this part of the leaves' radii.
    pub single: Option<f64>,
    /// How exact a pair in single precision is.
    pub pair: PairPrecision,
}

/// Relative error of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PairPrecision {
    /// 1.7e-4 without a potential, 2.5e-5 with it.
    Coarse,
    /// 2.5e-5
    Rough,
    /// 3e-7
    Fine,
}

struct SettingsRow {
    error: f64,
    order: usize,
    /// Largest error of one expansion over the error asked for, for 1e5 bodies.
    share: f64,
    /// By how much more that may be for a thousand, which have few cells far enough away to err.
    few: f64,
    /// Number of bodies from which on this is faster than the direct sum.
    crossover: usize,
}

/// Found on uniform balls, jittered lattices and pairs of these of 1000 to 100 000 bodies: there the RMS relative error,
/// sqrt(sum |da|^2 / sum |a|^2), is an eighth to 0.94 of what was asked for, of pairs of lattices the most. Of the orders
/// that reach an error the fastest was taken.
const SETTINGS: [SettingsRow; 5] = [
    SettingsRow { error: 1e-2, order: 3, share: 0.7, few: 0.8, crossover: 500 },
    SettingsRow { error: 1e-3, order: 5, share: 0.7, few: 0.7, crossover: 600 },
    SettingsRow { error: 1e-4, order: 7, share: 0.58, few: 1.5, crossover: 800 },
    SettingsRow { error: 1e-5, order: 8, share: 0.49, few: 2.2, crossover: 1000 },
    SettingsRow { error: 1e-6, order: 8, share: 0.32, few: 4.0, crossover: 6000 },
];

/// The row of the largest error that is not above the one asked for.
fn settings_row(error: f64) -> &'static SettingsRow {
    SETTINGS.iter().find(|row| row.error <= error).unwrap_or(&SETTINGS[SETTINGS.len() - 1])
}

/// Number of bodies from which on the fast method is the faster.
pub fn crossover_bodies(error: f64) -> usize {
    if error < MIN_FMM_ERROR { usize::MAX } else { settings_row(error).crossover }
}

impl ExpansionSettings {
    /// Settings that bring the RMS relative error asked for.
    pub fn for_error(error: f64, bodies: usize) -> Self {
        let row = settings_row(error);
        let reached = error.clamp(row.error, 10.0 * row.error);
        let bodies = bodies.max(1000) as f64;
        // The errors of many cells cancel in part, but more cells are met by more bodies.
        let by_number = (1e5 / bodies).powf(0.25) * (1.0 + row.few * (1000.0 / bodies).powi(2));
        ExpansionSettings {
            order: row.order,
            opening: MAX_OPENING,
            share: row.share * reached * by_number,
            leaf: if bodies < 3e4 { 40 } else { 48 },
            // Above this part of the radii, rounded positions spoil no pair by more than half the error asked for.
            single: (error > 2.0 * MIN_FMM_ERROR).then_some(2e-7 / error),
            pair: match error {
                4e-4.. => PairPrecision::Coarse,
                5e-5.. => PairPrecision::Rough,
                _ => PairPrecision::Fine,
            },
        }
    }
}
