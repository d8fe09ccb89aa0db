//! Deforming cell: the option `cell` of COMPUTE.RON, and the state of the cell in a run.
//!
//! H is the matrix of the edges of [`PeriodicCell`], upper triangular, and L = Ḣ H⁻¹ the velocity gradient of the cell.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::geometry::periodic_cell::PeriodicCell;
use crate::report::FaultReport;
use crate::ron_file::option_from_flag;

/// Control of the period along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum AxisControl {
    /// Rate of the logarithmic strain, 1/s, > 0 in extension.
    Rate(f64),
    /// Servo on the measured normal stress σ, > 0 in compression: the rate is gain (σ/value - 1), at most `max_rate` in size.
    Stress {
        /// Stress that is held, Pa, > 0.
        value: f64,
        /// Gain, 1/s, > 0: the cell closes at this rate without stress, or at `max_rate` if that is smaller.
        gain: f64,
        /// Time constant of the mean of the measured stress, s; 0: the stress of the last step.
        #[serde(default)]
        average: f64,
        /// Largest rate, 1/s; default: the gain.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        max_rate: Option<f64>,
    },
}

impl Default for AxisControl {
    fn default() -> Self {
        AxisControl::Rate(0.0)
    }
}

impl AxisControl {
    /// Rate of the logarithmic strain with the mean stress `stress` (Pa, > 0 in compression), 1/s.
    ///
    /// At twice the value that is held a servo opens the cell at the rate `gain`, or at `max_rate` if that is smaller.
    pub fn strain_rate(&self, stress: f64) -> f64 {
        match *self {
            AxisControl::Rate(rate) => rate,
            AxisControl::Stress { value, gain, max_rate, .. } => {
                let limit = max_rate.unwrap_or(gain);
                (gain * (stress / value - 1.0)).clamp(-limit, limit)
            }
        }
    }

    /// Mean of the stress after a step of the length `h` (s) with the stress `step_stress`, Pa; `mean`: the mean before.
    pub fn mean_stress(&self, mean: f64, step_stress: f64, h: f64) -> f64 {
        match *self {
            AxisControl::Rate(_) => step_stress,
            AxisControl::Stress { average, .. } => mean + (step_stress - mean) * (h / (h + average)),
        }
    }

    /// Reports values at `path` that no run could use in steps of `dt` (s).
    pub fn check_in(&self, dt: f64, path: &str, report: &mut FaultReport) {
        let is_positive = |x: f64| x.is_finite() && x > 0.0;
        match *self {
            AxisControl::Rate(rate) => check_rate(rate, dt, path, report),
            AxisControl::Stress { value, gain, average, max_rate } => {
                let mut number = |holds: bool, name: &str, x: f64, expected: &str| {
                    report.require_number(holds, &format!("{path}.{name}"), x, expected);
                };
                let stress = "a compressive stress > 0 Pa: a servo holds neither tension nor zero stress; use Rate";
                number(is_positive(value), "value", value, stress);
                number(is_positive(gain), "gain", gain, "a finite gain > 0 (1/s)");
                let is_time = average.is_finite() && average >= 0.0;
                number(is_time, "average", average, "a finite time >= 0 s for the mean of the stress");
                if let Some(rate) = max_rate {
                    number(is_positive(rate), "max_rate", rate, "a finite largest rate > 0 (1/s)");
                }
                let (name, largest) = max_rate.map_or(("gain", gain), |rate| ("max_rate", rate));
                let slow = "a largest rate times dt of at most 0.01: a smaller dt, gain or max_rate";
                number(is_slow(largest, dt), name, largest, slow);
            }
        }
    }
}

/// Largest strain of the cell in a step. Chosen: contacts are detected in the cell at one time of the step, and an image then
/// moves by at most a hundredth of a period from one detection to the next.
pub const MAX_STRAIN_PER_STEP: f64 = 0.01;

/// Whether a rate (1/s) deforms the cell by at most [`MAX_STRAIN_PER_STEP`] in steps of `dt` (s), or is not finite.
fn is_slow(rate: f64, dt: f64) -> bool {
    !rate.is_finite() || rate.abs() * dt <= MAX_STRAIN_PER_STEP
}

/// Reports a rate (1/s) at `path` that is not finite, or too large for steps of `dt` (s).
fn check_rate(rate: f64, dt: f64, path: &str, report: &mut FaultReport) {
    report.require_number(rate.is_finite(), path, rate, "a finite rate (1/s)");
    report.require_number(is_slow(rate, dt), path, rate, "a rate times dt of at most 0.01: a smaller dt or rate");
}

/// Option `cell`: deformation of a cell with three periods.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CellControl {
    /// Control of the period along x.
    pub x: AxisControl,
    /// Control of the period along y.
    pub y: AxisControl,
    /// Control of the period along z.
    pub z: AxisControl,
    /// Shear rate ∂v_x/∂y, 1/s.
    pub shear_xy: f64,
    /// Shear rate ∂v_x/∂z, 1/s.
    pub shear_xz: f64,
    /// Shear rate ∂v_y/∂z, 1/s.
    pub shear_yz: f64,
}

impl std::str::FromStr for CellControl {
    type Err = crate::ron_text::FlagError;
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        option_from_flag("cell", text)
    }
}

impl CellControl {
    /// Controls of the periods along x, y and z.
    pub fn axes(&self) -> [AxisControl; 3] {
        [self.x, self.y, self.z]
    }

    /// Whether a period follows the stress.
    pub fn has_servo(&self) -> bool {
        self.axes().iter().any(|axis| matches!(axis, AxisControl::Stress { .. }))
    }

    /// Velocity gradient of the cell with these mean normal stresses (Pa, > 0 in compression), 1/s.
    pub fn velocity_gradient(&self, stress: &[f64; 3]) -> Matrix3<f64> {
        let [x, y, z] = [0, 1, 2].map(|axis| self.axes()[axis].strain_rate(stress[axis]));
        Matrix3::new(x, self.shear_xy, self.shear_xz, 0.0, y, self.shear_yz, 0.0, 0.0, z)
    }

    /// Reports values that no run could use in steps of `dt` (s); `path` is that of the option.
    pub fn check_in(&self, dt: f64, path: &str, report: &mut FaultReport) {
        for (name, axis) in ["x", "y", "z"].into_iter().zip(self.axes()) {
            axis.check_in(dt, &format!("{path}.{name}"), report);
        }
        let shears = [("shear_xy", self.shear_xy), ("shear_xz", self.shear_xz), ("shear_yz", self.shear_yz)];
        for (name, rate) in shears {
            check_rate(rate, dt, &format!("{path}.{name}"), report);
        }
    }
}

/// Deforming cell at the end of a step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellState {
    /// Periods along x, y and z, m.
    pub periods: [f64; 3],
    /// Shears s_xy, s_xz and s_yz of [`PeriodicCell`], m. At most half a period: subtracting whole edges does not change the
    /// lattice.
    pub shears: [f64; 3],
    /// Rates of the periods, m/s.
    pub period_rates: [f64; 3],
    /// Rates of the shears, m/s.
    pub shear_rates: [f64; 3],
    /// Periods at the start, m.
    pub start_periods: [f64; 3],
    /// Shear strains xy, xz and yz since the start: sums of shear rates times steps.
    pub shear_strains: [f64; 3],
    /// Mean normal stresses of the servos, Pa, > 0 in compression: contacts and motion about the affine field.
    pub mean_stress: [f64; 3],
}

impl CellState {
    /// Returns the cell at the start of a run with these periods, m.
    pub fn new(periods: [f64; 3], control: &CellControl) -> CellState {
        let at_rest = CellState {
            periods,
            shears: [0.0; 3],
            period_rates: [0.0; 3],
            shear_rates: [0.0; 3],
            start_periods: periods,
            shear_strains: [0.0; 3],
            mean_stress: [0.0; 3],
        };
        at_rest.with_gradient(&control.velocity_gradient(&[0.0; 3]))
    }

    /// Edges of the cell, without rates.
    pub fn cell(&self) -> PeriodicCell {
        PeriodicCell { periods: self.periods.map(Some), shears: self.shears }
    }

    /// Velocity gradient L = Ḣ H⁻¹ by the rates of this state and the edges of `cell`, 1/s.
    ///
    /// An image that is the sum s of whole edges from its body moves by L s relative to it.
    pub fn gradient_in(&self, cell: &CellState) -> Matrix3<f64> {
        let [l_x, l_y, l_z] = cell.periods;
        let [xy, xz, yz] = cell.shears;
        let [rate_x, rate_y, rate_z] = self.period_rates;
        let [rate_xy, rate_xz, rate_yz] = self.shear_rates;
        let (g_x, g_y, g_z) = (rate_x / l_x, rate_y / l_y, rate_z / l_z);
        let g_xy = (rate_xy - g_x * xy) / l_y;
        let g_xz = (rate_xz - g_x * xz - g_xy * yz) / l_z;
        let g_yz = (rate_yz - g_y * yz) / l_z;
        Matrix3::new(g_x, g_xy, g_xz, 0.0, g_y, g_yz, 0.0, 0.0, g_z)
    }

    /// Velocity gradient of the cell, 1/s.
    pub fn gradient(&self) -> Matrix3<f64> {
        self.gradient_in(self)
    }

    /// Returns the cell with the rates Ḣ = L H of an upper triangular velocity gradient, 1/s.
    pub fn with_gradient(self, gradient: &Matrix3<f64>) -> CellState {
        let edges = [0, 1, 2].map(|axis| gradient * self.cell().edge(axis));
        CellState {
            period_rates: [edges[0].x, edges[1].y, edges[2].z],
            shear_rates: [edges[1].x, edges[2].x, edges[2].y],
            ..self
        }
    }

    /// Returns the cell after the time `span` (s) with its rates.
    pub fn moved_by(self, span: f64) -> CellState {
        let end_values = |values: [f64; 3], rates: [f64; 3]| [0, 1, 2].map(|k| values[k] + rates[k] * span);
        CellState {
            periods: end_values(self.periods, self.period_rates),
            shears: end_values(self.shears, self.shear_rates),
            ..self
        }
    }

    /// Returns the same lattice with shears of at most half of the periods: whole edges are subtracted from the edges along y
    /// and z, and from the rates likewise.
    pub fn reduced_cell(mut self) -> CellState {
        let steps = (self.shears[2] / self.periods[1]).round();
        if steps != 0.0 {
            self.shears =
                [self.shears[0], self.shears[1] - steps * self.shears[0], self.shears[2] - steps * self.periods[1]];
            self.shear_rates[1] -= steps * self.shear_rates[0];
            self.shear_rates[2] -= steps * self.period_rates[1];
        }
        for shear in [0, 1] {
            let steps = (self.shears[shear] / self.periods[0]).round();
            if steps != 0.0 {
                self.shears[shear] -= steps * self.periods[0];
                self.shear_rates[shear] -= steps * self.period_rates[0];
            }
        }
        self
    }

    /// Logarithmic strains ln(L_k/L_k0) of the periods L_k, with L_k0 at the start.
    pub fn log_strains(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| libm::log(self.periods[axis] / self.start_periods[axis]))
    }

    /// Velocity of a body at `x` (m) about the affine field, v - L x, m/s. It is the same for all images of a body.
    pub fn fluctuation(&self, x: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
        v - self.gradient() * x
    }

    /// Whether all numbers are finite and all periods are more than 0.
    pub fn is_sound(&self) -> bool {
        let CellState { periods, shears, period_rates, shear_rates, start_periods, shear_strains, mean_stress } = self;
        let mut all =
            [periods, shears, period_rates, shear_rates, start_periods, shear_strains, mean_stress].into_iter();
        all.all(|values| values.iter().all(|x| x.is_finite())) && periods.iter().chain(start_periods).all(|x| *x > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheared_cell() -> CellState {
        let control = CellControl {
            x: AxisControl::Rate(-0.25),
            y: AxisControl::Rate(0.5),
            z: AxisControl::Stress { value: 4.0, gain: 2.0, average: 0.0, max_rate: None },
            shear_xy: 1.5,
            shear_xz: -3.0,
            shear_yz: 0.75,
        };
        let cell = CellState { shears: [1.0, -1.5, 0.75], ..CellState::new([4.0, 3.0, 5.0], &control) };
        cell.with_gradient(&control.velocity_gradient(&[0.0, 0.0, 6.0]))
    }

    #[test]
    fn rates_and_gradient_are_inverse_to_each_other() {
        let expected = Matrix3::new(-0.25, 1.5, -3.0, 0.0, 0.5, 0.75, 0.0, 0.0, 1.0);
        assert!((sheared_cell().gradient() - expected).norm() < 1e-14); // some roundings
    }

    #[test]
    fn a_reduced_cell_is_the_same_lattice_with_the_same_gradient() {
        // Times in which no period vanishes; the shear xz changes by 15 m in a second.
        for span in [0.0, 0.5, -0.5, 1.5] {
            let before = sheared_cell().moved_by(span);
            let (after, cell) = (before.reduced_cell(), before.reduced_cell().cell());
            for axis in 0..3 {
                let steps = cell.lattice_coordinates(&before.cell().edge(axis));
                assert!((steps - steps.map(f64::round)).norm() < 1e-12, "{steps}"); // rounding of tens of edges
            }
            assert!((after.gradient() - before.gradient()).norm() < 1e-12 * before.gradient().norm());
            let [l_x, l_y, _] = after.periods;
            let [xy, xz, yz] = after.shears.map(f64::abs);
            assert!(xy <= 0.5 * l_x && xz <= 0.5 * l_x && yz <= 0.5 * l_y);
        }
    }

    #[test]
    fn a_servo_closes_opens_and_has_a_largest_rate() {
        let servo = AxisControl::Stress { value: 4.0, gain: 2.0, average: 3.0, max_rate: Some(1.5) };
        assert_eq!([0.0, 4.0, 5.0, 100.0].map(|stress| servo.strain_rate(stress)), [-1.5, 0.0, 0.5, 1.5]);
        // A quarter of the difference in a step of a third of the time constant.
        assert_eq!(servo.mean_stress(2.0, 6.0, 1.0), 3.0);
    }
    #[test]
    fn faults_are_those_of_the_values() {
        let text = "(cell: (x: Stress(value: 0.0, gain: 2.0), y: Stress(value: 1.0, gain: 0.5, max_rate: 4.0), shear_xz: 3.0))";
        let servo = |value, gain, max_rate| AxisControl::Stress { value, gain, average: 0.0, max_rate };
        let (x, y) = (servo(0.0, 2.0, None), servo(1.0, 0.5, Some(4.0)));
        let mut report = FaultReport::new(std::path::Path::new("COMPUTE.RON"), text);
        CellControl { x, y, shear_xz: 3.0, ..CellControl::default() }.check_in(0.0078125, "cell", &mut report);
        let found: Vec<String> = report.faults.0.iter().map(ToString::to_string).collect();
        let expected = [
            "COMPUTE.RON:1:26: cell, x, value: 0.0; expected a compressive stress > 0 Pa: a servo holds neither tension nor \
             zero stress; use Rate",
            "COMPUTE.RON:1:37: cell, x, gain: 2.0; expected a largest rate times dt of at most 0.01: a smaller dt, gain or \
             max_rate",
            "COMPUTE.RON:1:86: cell, y, max_rate: 4.0; expected a largest rate times dt of at most 0.01: a smaller dt, gain \
             or max_rate",
            "COMPUTE.RON:1:102: cell, shear_xz: 3.0; expected a rate times dt of at most 0.01: a smaller dt or rate",
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn a_state_is_sound_if_its_strains_are_defined() {
        let cell = CellState::new([4.0, 3.0, 5.0], &CellControl::default());
        assert!(cell.is_sound());
        for periods in [[4.0, 0.0, 5.0], [f64::INFINITY, 3.0, 5.0], [f64::NAN, 3.0, 5.0]] {
            assert!(
                !CellState { periods, ..cell }.is_sound() && !CellState { start_periods: periods, ..cell }.is_sound()
            );
        }
    }
}
