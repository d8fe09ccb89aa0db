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
    /// Servo on the measured normal stress σ, > 0 in compression: the rate is gain (σ/value - 1), at most `max_rate`.
    Stress {
        /// Stress that is held, Pa, > 0.
        value: f64,
        /// Gain, 1/s, > 0: the cell closes at this rate without stress.
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
    /// At twice the value that is held a servo opens the cell at the rate `gain`.
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

    /// Largest rate that the control can choose, 1/s.
    fn largest_rate(&self) -> f64 {
        match *self {
            AxisControl::Rate(rate) => rate.abs(),
            AxisControl::Stress { gain, max_rate, .. } => max_rate.unwrap_or(gain),
        }
    }
}

/// Largest strain of the cell in a step: contacts are detected in the cell at one time of the step.
pub const MAX_STRAIN_PER_STEP: f64 = 0.01;

/// Option `cell`: deformation of a cell with three periods.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CellControl {
    pub x: AxisControl,
    pub y: AxisControl,
    pub z: AxisControl,
    /// Shear rates ∂v_x/∂y, ∂v_x/∂z and ∂v_y/∂z, 1/s.
    pub shear_xy: f64,
    pub shear_xz: f64,
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
        let is_positive = |x: f64| x.is_finite() && x > 0.0;
        let mut number = |holds: bool, name: &str, x: f64, expected: &str| {
            report.require_number(holds, &format!("{path}.{name}"), x, expected);
        };
        let is_slow = |rate: f64| !rate.is_finite() || rate.abs() * dt <= MAX_STRAIN_PER_STEP;
        let slow = "a rate times dt of at most 0.01: a smaller dt or rate";
        for (name, axis) in ["x", "y", "z"].into_iter().zip(self.axes()) {
            match axis {
                AxisControl::Rate(rate) => number(rate.is_finite(), name, rate, "a finite rate (1/s)"),
                AxisControl::Stress { value, gain, average, max_rate } => {
                    number(is_positive(value), name, value, "a stress > 0 Pa: the cell has no walls that pull");
                    number(is_positive(gain), name, gain, "a finite gain > 0 (1/s)");
                    let is_time = average.is_finite() && average >= 0.0;
                    number(is_time, name, average, "a finite time >= 0 s for the mean of the stress");
                    if let Some(rate) = max_rate {
                        number(is_positive(rate), name, rate, "a finite largest rate > 0 (1/s)");
                    }
                }
            }
            number(is_slow(axis.largest_rate()), name, axis.largest_rate(), slow);
        }
        let shears = [("shear_xy", self.shear_xy), ("shear_xz", self.shear_xz), ("shear_yz", self.shear_yz)];
        for (name, rate) in shears {
            number(rate.is_finite(), name, rate, "a finite rate (1/s)");
            number(is_slow(rate), name, rate, slow);
        }
    }
}

/// Deforming cell at the end of a step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellState {
    /// Periods along x, y and z, m.
    pub periods: [f64; 3],
    /// Shears s_xy, s_xz and s_yz of [`PeriodicCell`], m. They are reduced by whole periods: such cells repeat alike.
    pub shears: [f64; 3],
    /// Rates of the periods and of the shears, m/s.
    pub period_rates: [f64; 3],
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

    /// The cell as that of a periodic scene.
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
    /// and z, and their rates from those of these edges.
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

    /// Logarithmic strains ln(L/L_0) of the periods.
    pub fn log_strains(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| libm::log(self.periods[axis] / self.start_periods[axis]))
    }

    /// Velocity of a body at `x` (m) about the affine field, v - L x, m/s. It is the same for all images of a body.
    pub fn fluctuation(&self, x: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
        v - self.gradient() * x
    }

    /// Whether all numbers are finite and all periods are more than 0.
    pub fn is_sound(&self) -> bool {
        let CellState { periods, shears, period_rates, shear_rates, mean_stress, .. } = self;
        let all = [shears, period_rates, shear_rates, mean_stress].into_iter().flatten();
        all.chain(&self.shear_strains).all(|x| x.is_finite()) && periods.iter().all(|x| x.is_finite() && *x > 0.0)
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
}
