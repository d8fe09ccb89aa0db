//! Options `probes` and `until` of COMPUTE.RON: probes follow chosen quantities of a run step by step, conditions end it.

mod region;

use serde::{Deserialize, Serialize};

use self::region::REGION_COLUMNS;
pub use self::region::RegionMeans;
use crate::names::{is_file_name, number_text};
use crate::region::SpaceRegion;
use crate::report::FaultReport;
use crate::ron_text;

/// Series of a quantity, in the file `POSTPRO/probe-NAME.csv`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Probe {
    /// Letters, digits, `-` and `_`.
    pub name: String,
    /// Number of steps between two rows.
    #[serde(default = "every_step", skip_serializing_if = "is_every_step")]
    pub every: u64,
    pub quantity: ProbeQuantity,
}

/// Default of [`Probe::every`].
fn every_step() -> u64 {
    1
}

fn is_every_step(every: &u64) -> bool {
    *every == every_step()
}

/// Quantity of a probe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum ProbeQuantity {
    /// Force (N) of other bodies on the bodies `on` at contacts, and its torque (N m) about the point `about` (m), by
    /// default the centre of mass of these bodies.
    Force {
        on: BodySelection,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        about: Option<[f64; 3]>,
    },
    /// Area (m²) of the wall `on` on which a pressure acts, and pressure (Pa) of the contacts on it.
    Pressure { on: BodySelection },
    /// Position of the centre of mass (m), its velocity (m/s), and the angular velocity (rad/s) of a rigid body with the
    /// angular momentum and inertia of the bodies `of`.
    Motion { of: BodySelection },
    /// Kinetic energy of translation and of rotation (J), largest speed of a point of a body (m/s), and mass (kg) of the
    /// bodies `of`.
    Energy { of: BodySelection },
    /// Means over the bodies `of` in the region `inside`: solid fraction, velocity with its gradient, granular temperature,
    /// stress, and numbers that follow from these, see [`RegionMeans`].
    Region { of: BodySelection, inside: SpaceRegion },
    /// Number, mass (kg), momentum (kg m/s) and kinetic energy (J) of these bodies whose centres of mass pass through a
    /// surface in the steps of a row, less those that pass through it in the other direction.
    Crossing { of: BodySelection, through: CountingSurface },
    /// Sums as of `Bodies` over the bodies that leave by the sink of this name.
    Removed { by: String },
    /// Sums as of `Bodies` over the bodies that enter from the source of this name.
    Entered { from: String },
}

/// Surface through which bodies are counted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum CountingSurface {
    /// Plane through `point` (m); bodies that pass along `normal` count as positive.
    Plane { point: [f64; 3], normal: [f64; 3] },
    /// Sphere about `centre` (m) with the radius `radius` (m); bodies that pass outwards count as positive.
    Sphere { centre: [f64; 3], radius: f64 },
}

impl CountingSurface {
    /// Whether the position `x` (m) is on the side to which bodies pass that count as positive.
    pub fn is_beyond(&self, x: &[f64; 3]) -> bool {
        let offset_from = |origin: &[f64; 3]| -> [f64; 3] { std::array::from_fn(|k| x[k] - origin[k]) };
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        match self {
            CountingSurface::Plane { point, normal } => dot(offset_from(point), *normal) >= 0.0,
            CountingSurface::Sphere { centre, radius } => {
                dot(offset_from(centre), offset_from(centre)) >= radius * radius
            }
        }
    }

    /// Requirement that the numbers do not meet.
    fn invalid_value(&self) -> Option<&'static str> {
        let are_finite = |v: &[f64; 3]| v.iter().all(|x| x.is_finite());
        match self {
            CountingSurface::Plane { point, normal } => {
                let length = normal.iter().map(|x| x * x).sum::<f64>();
                let sound = are_finite(point) && length.is_finite() && length > 0.0;
                (!sound).then_some("a finite point and a normal other than 0")
            }
            CountingSurface::Sphere { centre, radius } => {
                let sound = are_finite(centre) && radius.is_finite() && *radius > 0.0;
                (!sound).then_some("a finite centre and a radius > 0 m")
            }
        }
    }
}

/// Bodies of a probe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum BodySelection {
    /// Body of this number in BODIES.DAT, from 1.
    Body(usize),
    /// All bodies with a contactor of this colour.
    Colour(String),
    /// All bodies whose motion is not imposed.
    Free,
}

/// Condition that ends a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum EndCondition {
    /// For `during` (s) no point of a free body has been faster than `speed` (m/s), or the kinetic energy of the free bodies
    /// has been at most `kinetic_over_potential` times their potential energy; one of the two is given. No body waits to
    /// enter.
    AtRest {
        #[serde(default, skip_serializing_if = "Option::is_none")]
        speed: Option<f64>,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        kinetic_over_potential: Option<f64>,
        during: f64,
    },
    /// The centres of mass of two selections are farther from each other than `distance` (m).
    Separation { between: (BodySelection, BodySelection), distance: f64 },
    /// A column of a probe is larger than `value` after a step.
    Above { probe: String, column: String, value: f64 },
    /// A column of a probe is smaller than `value` after a step.
    Below { probe: String, column: String, value: f64 },
    /// The run has taken this long on the clock, s. It stops as by Ctrl-C, and `--resume` continues it.
    WallTime(f64),
}

/// Name, unit and meaning of every column of the files of probes. A component y or z has the meaning of its x.
pub const PROBE_COLUMNS: [(&str, &str, &str); 61] = [
    ("step", "1", "step, the last of the row"),
    ("time", "s", "time"),
    ("h", "s", "length of the steps of the row"),
    ("force_x", "N", "force of contacts along x, with other bodies, mean over the row"),
    ("force_y", "N", "force of contacts along y, with other bodies, mean over the row"),
    ("force_z", "N", "force of contacts along z, with other bodies, mean over the row"),
    ("torque_x", "N m", "torque of contacts along x, with other bodies, mean over the row"),
    ("torque_y", "N m", "torque of contacts along y, with other bodies, mean over the row"),
    ("torque_z", "N m", "torque of contacts along z, with other bodies, mean over the row"),
    ("area", "m^2", "area of a wall between its neighbours, mean over the row"),
    ("wall_pressure", "Pa", "force of contacts along the normal over the area"),
    ("x", "m", "centre of mass along x"),
    ("y", "m", "centre of mass along y"),
    ("z", "m", "centre of mass along z"),
    ("v_x", "m/s", "velocity of the centre of mass along x"),
    ("v_y", "m/s", "velocity of the centre of mass along y"),
    ("v_z", "m/s", "velocity of the centre of mass along z"),
    ("angular_x", "rad/s", "angular velocity along x, as one rigid body"),
    ("angular_y", "rad/s", "angular velocity along y, as one rigid body"),
    ("angular_z", "rad/s", "angular velocity along z, as one rigid body"),
    ("kinetic_energy", "J", "kinetic energy of translation"),
    ("rotational_energy", "J", "kinetic energy of rotation"),
    ("largest_speed", "m/s", "largest speed, |v| + |w| R"),
    ("mass", "kg", "mass"),
    ("number", "1", "bodies that pass, leave or enter in the steps of the row"),
    ("passed_mass", "kg", "mass that passes, leaves or enters in the steps of the row"),
    ("passed_momentum_x", "kg m/s", "momentum along x that passes, leaves or enters in the steps of the row"),
    ("passed_momentum_y", "kg m/s", "momentum along y that passes, leaves or enters in the steps of the row"),
    ("passed_momentum_z", "kg m/s", "momentum along z that passes, leaves or enters in the steps of the row"),
    (
        "passed_energy",
        "J",
        "kinetic energy that passes, leaves or enters in the steps of the row, with that of rotation",
    ),
    ("grains", "1", "grains with their centre in the region"),
    ("nu", "1", "solid fraction of the region"),
    ("density", "kg/m^3", "mass in the region over its volume"),
    ("diameter", "m", "mean diameter of the grains in the region"),
    ("temperature", "m^2/s^2", "granular temperature, about the mean field of the region"),
    ("sigma_xx", "Pa", "stress xx of the contacts in the region"),
    ("sigma_yy", "Pa", "stress yy of the contacts in the region"),
    ("sigma_zz", "Pa", "stress zz of the contacts in the region"),
    ("sigma_xy", "Pa", "stress xy of the contacts in the region"),
    ("sigma_xz", "Pa", "stress xz of the contacts in the region"),
    ("sigma_yz", "Pa", "stress yz of the contacts in the region"),
    ("kinetic_xx", "Pa", "stress xx of the motion about the mean field of the region"),
    ("kinetic_yy", "Pa", "stress yy of the motion about the mean field of the region"),
    ("kinetic_zz", "Pa", "stress zz of the motion about the mean field of the region"),
    ("kinetic_xy", "Pa", "stress xy of the motion about the mean field of the region"),
    ("kinetic_xz", "Pa", "stress xz of the motion about the mean field of the region"),
    ("kinetic_yz", "Pa", "stress yz of the motion about the mean field of the region"),
    ("gradient_xx", "1/s", "gradient xx of the velocity in the region, first its component, then the axis"),
    ("gradient_xy", "1/s", "gradient xy of the velocity in the region, first its component, then the axis"),
    ("gradient_xz", "1/s", "gradient xz of the velocity in the region, first its component, then the axis"),
    ("gradient_yx", "1/s", "gradient yx of the velocity in the region, first its component, then the axis"),
    ("gradient_yy", "1/s", "gradient yy of the velocity in the region, first its component, then the axis"),
    ("gradient_yz", "1/s", "gradient yz of the velocity in the region, first its component, then the axis"),
    ("gradient_zx", "1/s", "gradient zx of the velocity in the region, first its component, then the axis"),
    ("gradient_zy", "1/s", "gradient zy of the velocity in the region, first its component, then the axis"),
    ("gradient_zz", "1/s", "gradient zz of the velocity in the region, first its component, then the axis"),
    ("pressure", "Pa", "pressure of the contacts in the region"),
    ("pressure_kinetic", "Pa", "pressure of the motion in the region"),
    ("shear_rate", "1/s", "shear rate in the region"),
    ("mu", "1", "shear stress over pressure"),
    ("inertial_number", "1", "inertial number of the region"),
];

/// Whether a probe writes a file of this name.
pub fn is_probe_file(name: &str) -> bool {
    name.strip_prefix("probe-").and_then(|rest| rest.strip_suffix(".csv")).is_some_and(is_file_name)
}

impl ProbeQuantity {
    /// Columns after `step`, `time` and `h`.
    pub fn columns(&self) -> &'static [&'static str] {
        match self {
            ProbeQuantity::Force { .. } => &["force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z"],
            ProbeQuantity::Pressure { .. } => &["area", "wall_pressure"],
            ProbeQuantity::Motion { .. } => {
                &["x", "y", "z", "v_x", "v_y", "v_z", "angular_x", "angular_y", "angular_z"]
            }
            ProbeQuantity::Energy { .. } => &["kinetic_energy", "rotational_energy", "largest_speed", "mass"],
            ProbeQuantity::Region { .. } => &REGION_COLUMNS,
            ProbeQuantity::Crossing { .. } | ProbeQuantity::Removed { .. } | ProbeQuantity::Entered { .. } => &[
                "number",
                "passed_mass",
                "passed_momentum_x",
                "passed_momentum_y",
                "passed_momentum_z",
                "passed_energy",
            ],
        }
    }

    /// Bodies of the quantity, if it selects some.
    pub fn bodies(&self) -> Option<&BodySelection> {
        match self {
            ProbeQuantity::Force { on: bodies, .. }
            | ProbeQuantity::Pressure { on: bodies }
            | ProbeQuantity::Motion { of: bodies }
            | ProbeQuantity::Energy { of: bodies }
            | ProbeQuantity::Region { of: bodies, .. }
            | ProbeQuantity::Crossing { of: bodies, .. } => Some(bodies),
            ProbeQuantity::Removed { .. } | ProbeQuantity::Entered { .. } => None,
        }
    }

    /// Name of the field with the bodies.
    fn bodies_field(&self) -> &'static str {
        match self {
            ProbeQuantity::Force { .. } | ProbeQuantity::Pressure { .. } => "on",
            _ => "of",
        }
    }
}

impl EndCondition {
    /// Text of the condition as in COMPUTE.RON.
    pub fn to_text(&self) -> String {
        ron_text::ron_options().to_string(self).unwrap_or_default()
    }
}

/// Bodies that the probes and conditions name, with the paths of their values in COMPUTE.RON.
pub fn named_bodies<'a>(
    probes: &'a [Probe],
    conditions: &'a [EndCondition],
) -> impl Iterator<Item = (String, &'a BodySelection)> {
    let probe_bodies = probes.iter().enumerate().filter_map(|(k, probe)| {
        Some((format!("probes.{k}.quantity.{}", probe.quantity.bodies_field()), probe.quantity.bodies()?))
    });
    let condition_bodies = conditions.iter().enumerate().flat_map(|(k, condition)| {
        let bodies = match condition {
            EndCondition::Separation { between: (a, b), .. } => vec![a, b],
            EndCondition::AtRest { .. }
            | EndCondition::Above { .. }
            | EndCondition::Below { .. }
            | EndCondition::WallTime(_) => Vec::new(),
        };
        bodies.into_iter().enumerate().map(move |(side, bodies)| (format!("until.{k}.between.{side}"), bodies))
    });
    probe_bodies.chain(condition_bodies)
}

/// Names of the sinks and sources of a run.
#[derive(Debug, Clone, Copy)]
pub struct FlowNames<'a> {
    pub sinks: &'a [&'a str],
    pub sources: &'a [&'a str],
}

/// Reports the values of probes and conditions that no run could use; `prefix` begins their paths.
pub fn check_probes(
    probes: &[Probe],
    conditions: &[EndCondition],
    flows: FlowNames,
    prefix: &str,
    report: &mut FaultReport,
) {
    for (k, Probe { name, every, quantity }) in probes.iter().enumerate() {
        let path = format!("{prefix}probes.{k}");
        let is_unique = probes[..k].iter().all(|other| other.name != *name);
        let expected = "a name of its own, of letters, digits, - and _";
        report.require(is_file_name(name) && is_unique, &format!("{path}.name"), format!("'{name}'"), expected);
        report.require(*every > 0, &format!("{path}.every"), every.to_string(), "at least 1 step");
        let mut require_name = |field: &str, kind: &str, name: &String, known: &[&str]| {
            if !known.contains(&name.as_str()) {
                report.add_unknown_name(
                    &format!("{path}.quantity.{field}"),
                    format!("'{name}' is no {kind}"),
                    name,
                    known,
                );
            }
        };
        match quantity {
            ProbeQuantity::Force { about: Some(about), .. } => {
                let path = format!("{path}.quantity.about");
                let sound = about.iter().all(|x| x.is_finite());
                report.require(sound, &path, format!("{about:?}"), "finite coordinates (m)");
            }
            ProbeQuantity::Crossing { through, .. } => {
                if let Some(expected) = through.invalid_value() {
                    let path = format!("{path}.quantity.through");
                    let found = report.shown_text_or(&path, || format!("{through:?}"));
                    report.add_fault(&path, found, expected);
                }
            }
            ProbeQuantity::Region { inside, .. } => {
                let without_volume = inside.convex_region().is_none().then_some("a Ball, Box or Cylinder");
                if let Some(expected) = inside.invalid_value().or(without_volume) {
                    let path = format!("{path}.quantity.inside");
                    let found = report.shown_text_or(&path, || format!("{inside:?}"));
                    report.add_fault(&path, found, expected);
                }
            }
            ProbeQuantity::Removed { by } => require_name("by", "sink", by, flows.sinks),
            ProbeQuantity::Entered { from } => require_name("from", "source", from, flows.sources),
            ProbeQuantity::Force { about: None, .. }
            | ProbeQuantity::Pressure { .. }
            | ProbeQuantity::Motion { .. }
            | ProbeQuantity::Energy { .. } => {}
        }
    }
    let is_positive = |x: f64| x.is_finite() && x > 0.0;
    for (k, condition) in conditions.iter().enumerate() {
        let path = format!("{prefix}until.{k}");
        match condition {
            EndCondition::AtRest { speed, kinetic_over_potential, during } => {
                let is_one_given = speed.is_some() != kinetic_over_potential.is_some();
                report.require(is_one_given, &path, condition.to_text(), "either speed or kinetic_over_potential");
                for (field, value, expected) in [
                    ("speed", speed, "a finite speed > 0 m/s"),
                    ("kinetic_over_potential", kinetic_over_potential, "a finite ratio > 0"),
                ] {
                    if let Some(value) = value {
                        report.require_number(is_positive(*value), &format!("{path}.{field}"), *value, expected);
                    }
                }
                let expected = "a finite time > 0 s";
                report.require_number(is_positive(*during), &format!("{path}.during"), *during, expected);
                let is_first = !conditions[..k].iter().any(|other| matches!(other, EndCondition::AtRest { .. }));
                report.require(is_first, &path, condition.to_text(), "one AtRest");
            }
            EndCondition::Separation { between: (a, b), distance } => {
                let expected = "two different selections of bodies";
                report.require(a != b, &format!("{path}.between"), "of the same bodies", expected);
                let expected = "a finite distance > 0 m";
                report.require_number(is_positive(*distance), &format!("{path}.distance"), *distance, expected);
            }
            EndCondition::WallTime(seconds) => {
                report.require_number(is_positive(*seconds), &path, *seconds, "a finite time > 0 s");
            }
            EndCondition::Above { probe, column, value } | EndCondition::Below { probe, column, value } => {
                let expected = "a finite number";
                report.require_number(value.is_finite(), &format!("{path}.value"), *value, expected);
                match probes.iter().find(|known| known.name == *probe) {
                    None => {
                        let names: Vec<&str> = probes.iter().map(|known| known.name.as_str()).collect();
                        let found = format!("'{probe}' is no probe");
                        report.add_unknown_name(&format!("{path}.probe"), found, probe, &names);
                    }
                    Some(known) if !known.quantity.columns().contains(&column.as_str()) => {
                        let found = format!("'{column}' is no column of probe '{probe}'");
                        report.add_unknown_name(&format!("{path}.column"), found, column, known.quantity.columns());
                    }
                    Some(_) => {}
                }
            }
        }
    }
}

/// Reports conditions on the potential energy in runs without one. `prefix` begins their paths; `has_potential`: whether the
/// run has uniform gravity or self-gravity.
pub fn check_energy_conditions(
    conditions: &[EndCondition],
    has_potential: bool,
    prefix: &str,
    report: &mut FaultReport,
) {
    for (k, condition) in conditions.iter().enumerate() {
        if let EndCondition::AtRest { kinetic_over_potential: Some(_), .. } = condition {
            let path = format!("{prefix}until.{k}.kinetic_over_potential");
            let expected = "uniform gravity, or self_gravity: true and two free bodies; else speed";
            report.require(has_potential, &path, "there is no potential energy", expected);
        }
    }
}

/// Fault of bodies that a scene of `count` bodies with these colours does not have: found and expected values.
pub fn unknown_bodies(bodies: &BodySelection, count: usize, colours: &[&str]) -> Option<(String, String)> {
    match bodies {
        BodySelection::Body(number) if (1..=count).contains(number) => None,
        BodySelection::Body(number) => {
            Some((number_text(*number as f64), format!("1 to {count}, a body of BODIES.DAT")))
        }
        BodySelection::Colour(colour) if colours.contains(&colour.as_str()) => None,
        BodySelection::Colour(colour) => {
            Some((format!("no body has the colour '{colour}'"), format!("one of {}", colours.join(", "))))
        }
        BodySelection::Free => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_the_columns_of_all_quantities_once() {
        let of = || BodySelection::Free;
        let inside = SpaceRegion::Ball { centre: [0.0; 3], radius: 1.0 };
        let quantities = [
            ProbeQuantity::Force { on: of(), about: None },
            ProbeQuantity::Pressure { on: of() },
            ProbeQuantity::Motion { of: of() },
            ProbeQuantity::Energy { of: of() },
            ProbeQuantity::Removed { by: "lost".into() },
            ProbeQuantity::Region { of: of(), inside },
        ];
        let mut all = vec!["step", "time", "h"];
        for column in quantities.iter().flat_map(|quantity| quantity.columns()) {
            if !all.contains(column) {
                all.push(column);
            }
        }
        assert_eq!(all, PROBE_COLUMNS.map(|(name, ..)| name));
        assert!(is_probe_file("probe-lid_1.csv") && !is_probe_file("probe-.csv") && !is_probe_file("probe-a/b.csv"));
    }
}
