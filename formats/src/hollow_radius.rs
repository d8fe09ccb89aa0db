//! Radii of hollow cylinders that change: the option `radii` of COMPUTE.RON, and the state of a radius in a run.

use serde::{Deserialize, Serialize};

use crate::deforming_cell::AxisControl;
use crate::report::FaultReport;

/// Control of the radius of a hollow cylinder.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RadiusControl {
    /// Number of its body, from 1.
    pub body: usize,
    /// Rate of ln R, or a servo on the pressure of the contacts on the inside.
    pub control: AxisControl,
}

/// Radius of a hollow cylinder at the end of a step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RadiusState {
    /// Number of its body, from 1.
    pub body: usize,
    /// Radius R, m.
    pub radius: f64,
    /// Radial speed Ṙ of the inside, m/s, > 0 outwards.
    pub speed: f64,
    /// Mean pressure of the servo, Pa.
    pub mean_stress: f64,
}

impl RadiusState {
    /// Returns the state at the start of a run with this radius, m.
    pub fn new(radius: f64, control: &RadiusControl) -> RadiusState {
        let speed = radius * control.control.strain_rate(0.0);
        RadiusState { body: control.body, radius, speed, mean_stress: 0.0 }
    }

    /// Returns the radius after the time `span` (s) with its speed.
    pub fn moved_by(self, span: f64) -> RadiusState {
        RadiusState { radius: self.radius + self.speed * span, ..self }
    }

    /// Returns the radius with the speed that changes it by the factor exp(rate h) in the time `h`, s; for h = 0 rate times
    /// radius.
    ///
    /// At the rate -0.5 1/s and h = 1 s a radius of 2 m gets the speed -0.787 m/s.
    pub fn with_strain_rate(self, rate: f64, h: f64) -> RadiusState {
        let speed = self.radius * if h > 0.0 { libm::expm1(rate * h) / h } else { rate };
        RadiusState { speed, ..self }
    }

    /// Whether all numbers are finite and the radius is more than 0.
    pub fn is_sound(&self) -> bool {
        [self.radius, self.speed, self.mean_stress].iter().all(|x| x.is_finite()) && self.radius > 0.0
    }
}

/// Reports controls at `path` that no run could use in steps of `dt` (s).
pub fn check_radii(radii: &[RadiusControl], dt: f64, path: &str, report: &mut FaultReport) {
    for (k, RadiusControl { body, control }) in radii.iter().enumerate() {
        let path = format!("{path}.{k}");
        let is_new = *body > 0 && radii[..k].iter().all(|other| other.body != *body);
        report.require(
            is_new,
            &format!("{path}.body"),
            format!("{body}"),
            "the number, from 1, of a body without a row",
        );
        control.check_in(dt, &format!("{path}.control"), report);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_strain_rate_changes_the_radius_exponentially() {
        let control = RadiusControl { body: 1, control: AxisControl::Rate(-0.5) };
        let mut radius = RadiusState::new(2.0, &control);
        assert_eq!(radius.speed, -1.0);
        for _ in 0..10 {
            radius = radius.with_strain_rate(-0.5, 0.1).moved_by(0.1);
        }
        assert!((radius.radius - 2.0 * libm::exp(-0.5)).abs() < 1e-14, "{}", radius.radius); // ten roundings
    }
}
