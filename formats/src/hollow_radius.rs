//! Radii of hollow cylinders that change: the option `radii` of COMPUTE.RON, and the state of a radius in a run.

use serde::{Deserialize, Serialize};

use crate::deforming_cell::AxisControl;
use crate::names::rounded_number;
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
    /// Height of the inside between plates, or of the cylinder, in the contact configuration, m.
    pub height: f64,
    /// Radial speed Ṙ of the inside, m/s, > 0 outwards.
    pub speed: f64,
    /// Mean pressure of the servo, Pa.
    pub mean_stress: f64,
}

impl RadiusState {
    /// Returns the state at the start of a run with this radius and height, m.
    pub fn new(radius: f64, height: f64, control: &RadiusControl) -> RadiusState {
        let speed = radius * control.control.strain_rate(0.0);
        RadiusState { body: control.body, radius, height, speed, mean_stress: 0.0 }
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
        [self.radius, self.height, self.speed, self.mean_stress].iter().all(|x| x.is_finite()) && self.radius > 0.0
    }
}

/// Least radius of a hollow cylinder of this `height` (m) around bodies, m: that of the largest of the balls in them, and that
/// of a cylinder with their whole `volume`, m³. 0 without bodies.
///
/// Ten balls of the radius 1 m in a height of 3 m do not fit into a radius below 2.108 m.
pub fn least_radius(balls: impl Iterator<Item = f64>, volume: f64, height: f64) -> f64 {
    balls.fold((volume / (std::f64::consts::PI * height)).sqrt(), f64::max)
}

/// Bound on the radial speed in the time `span` (s) from a `radius` (m) on, m/s. A servo may reach its largest rate at the start;
/// its growth later is not counted.
pub fn largest_radial_speed(control: &AxisControl, radius: f64, span: f64) -> f64 {
    match *control {
        AxisControl::Rate(rate) => rate.abs() * radius * libm::exp((rate * span).max(0.0)),
        AxisControl::Stress { gain, max_rate, .. } => max_rate.unwrap_or(gain) * radius,
    }
}

/// Found and expected text of a fault if a control shrinks a `radius` (m) in the time `span` (s) to less than the `least` one, m.
/// None for servos, which stop at the bodies.
pub fn shrinkage_fault(control: &AxisControl, radius: f64, span: f64, least: f64) -> Option<(String, String)> {
    let AxisControl::Rate(rate) = *control else { return None };
    let end = radius * libm::exp(rate * span);
    (rate < 0.0 && end < least).then(|| {
        let [rate, radius, end, span, least] = [rate, radius, end, span, least].map(rounded_number);
        let found = format!("Rate({rate}) shrinks the radius from {radius} m to {end} m in {span} s");
        let expected =
            format!("at least {least} m, the size of the bodies inside: a slower rate, a shorter run, or Stress");
        (found, expected)
    })
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
            "the number, from 1, of a hollow cylinder, each at most once",
        );
        control.check_in(dt, &format!("{path}.control"), report);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_limit_the_rate_at_which_a_radius_shrinks() {
        let ball_volume = 4.0 / 3.0 * std::f64::consts::PI;
        let least = least_radius([1.0; 10].into_iter(), 10.0 * ball_volume, 3.0);
        assert!((least - (40.0f64 / 9.0).sqrt()).abs() < 1e-15, "{least}"); // 10 * 4/3 π = 3 π R²
        assert_eq!(least_radius([1.0].into_iter(), ball_volume, 100.0), 1.0);
        assert_eq!(least_radius(std::iter::empty(), 0.0, 1.0), 0.0);
        let fault = |control, span| shrinkage_fault(&control, 3.0, span, least);
        // 3 exp(-0.1 t) is 2.108 at t = 3.53.
        assert_eq!(fault(AxisControl::Rate(-0.1), 3.5), None);
        let (found, expected) = fault(AxisControl::Rate(-0.1), 4.0).unwrap();
        assert_eq!(found, "Rate(-0.1) shrinks the radius from 3 m to 2.010960138 m in 4 s");
        assert!(expected.starts_with("at least 2.108185107 m"), "{expected}");
        assert_eq!(fault(AxisControl::Rate(0.1), 1e9), None);
        let servo = AxisControl::Stress { value: 1.0, gain: 1.0, average: 0.0, max_rate: None };
        assert_eq!(fault(servo, 1e9), None);
        assert_eq!(largest_radial_speed(&servo, 3.0, 1e9), 3.0);
        assert_eq!(largest_radial_speed(&AxisControl::Rate(-0.5), 3.0, 1.0), 1.5);
        assert!((largest_radial_speed(&AxisControl::Rate(0.5), 3.0, 2.0) - 1.5 * libm::exp(1.0)).abs() < 1e-15);
    }

    #[test]
    fn a_strain_rate_changes_the_radius_exponentially() {
        let control = RadiusControl { body: 1, control: AxisControl::Rate(-0.5) };
        let mut radius = RadiusState::new(2.0, 1.0, &control);
        assert_eq!(radius.speed, -1.0);
        for _ in 0..10 {
            radius = radius.with_strain_rate(-0.5, 0.1).moved_by(0.1);
        }
        assert!((radius.radius - 2.0 * libm::exp(-0.5)).abs() < 1e-14, "{}", radius.radius); // ten roundings
    }
}
