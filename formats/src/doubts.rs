//! Values that are allowed but probably mistakes of units. cd-pre warns about those of a scene, cd-solve about those of
//! DATBOX.

use crate::compute::{Compute, Event, EventAction};
use crate::law_table::{LawParameter, ParameterQuantity};
use crate::names::{number_text, rounded_number};
use crate::report::FaultReport;

/// Bulk densities of solids, kg/m^3, with a margin: snow and foams have 100, osmium 22 600.
const DENSITIES: std::ops::RangeInclusive<f64> = 100.0..=30_000.0;

/// Largest friction coefficient that does not look like an angle in degrees: rubber has 1 to 2, interlocking rocks 3.
const FRICTION: f64 = 5.0;

/// Question about a density, kg/m^3, that no solid has.
///
/// ```
/// use cd_formats::doubts::density;
/// assert!(density(2.7).unwrap().contains("2.7 g/cm^3 are 2700 kg/m^3") && density(2700.0).is_none());
/// ```
pub fn density(density: f64) -> Option<String> {
    if DENSITIES.contains(&density) {
        return None;
    }
    let as_grams = 1000.0 * density;
    Some(if DENSITIES.contains(&as_grams) && density >= 0.5 {
        format!("did you mean kg/m^3? {density} g/cm^3 are {} kg/m^3", rounded_number(as_grams))
    } else {
        "did you mean kg/m^3? water has 1000, rock 2500 to 3500".into()
    })
}

/// Question about a friction coefficient that is larger than those of materials.
///
/// ```
/// use cd_formats::doubts::friction;
/// assert!(friction(40.0).unwrap().contains("0.839") && friction(0.8).is_none());
/// ```
pub fn friction(value: f64) -> Option<String> {
    (value > FRICTION).then(|| {
        if value < 90.0 {
            format!("did you mean an angle? {value} degrees are {:.3}", libm::tan(value.to_radians()))
        } else {
            "did you mean a coefficient? it is tangential over normal force".into()
        }
    })
}

/// Question about an angle, rad, of more than a full turn.
///
/// ```
/// use cd_formats::doubts::angle;
/// assert!(angle(-45.0).unwrap().contains("-45 degrees are -0.785") && angle(6.2832).is_none());
/// ```
pub fn angle(value: f64) -> Option<String> {
    // A full turn with four digits is longer than 2 pi.
    (value.abs() > 1.001 * std::f64::consts::TAU)
        .then(|| format!("did you mean degrees? {value} degrees are {:.3} rad", value.to_radians()))
}

/// Question about a parameter of a law, see [`friction`].
pub fn law_parameter(parameter: LawParameter, value: f64) -> Option<String> {
    (parameter.quantity() == ParameterQuantity::Friction).then(|| friction(value)).flatten()
}

/// Warns about the friction that events set; `prefix` begins their paths.
pub fn events(events: &[Event], prefix: &str, report: &mut FaultReport) {
    for (k, event) in events.iter().enumerate() {
        let EventAction::SetFriction(_, value) = event.action else { continue };
        if let Some(question) = friction(value) {
            report.add_warning(
                &format!("{prefix}events.{k}"),
                format!("SetFriction {}", number_text(value)),
                &question,
            );
        }
    }
}

/// Tolerance of the time of an event, as a fraction of a step: decimal numbers and their products are rounded.
pub const EVENT_SLACK: f64 = 1e-3;

/// Warns about events that no step reaches, in a run with `options` from a step and time (s); `prefix` is the prefix of their
/// paths.
pub fn late_events(options: &Compute, (step, time): (u64, f64), prefix: &str, report: &mut FaultReport) {
    let Some(last) = options.last_step(step, (step, time)).filter(|last| *last > step) else { return };
    let begin = time + (last - step - 1) as f64 * options.dt;
    for (k, event) in options.events.iter().enumerate() {
        if event.time > begin + EVENT_SLACK * options.dt {
            let found = format!(
                "no step begins at {} s or later, the last begins at {} s",
                number_text(event.time),
                rounded_number(begin)
            );
            report.add_warning(
                &format!("{prefix}events.{k}.time"),
                found,
                "give an earlier time, or a later end of the run",
            );
        }
    }
}
