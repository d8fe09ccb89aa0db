//! Values of a scene that are allowed, and probably mistakes: units, functions that are 0 at all times.

use cd_formats::report::Report;

use crate::scene::{Evolution, Grains, Law, Material, Wall};

/// Bulk densities of solids, kg/m^3, with a margin: snow and foams have 100, osmium 22 600.
const DENSITIES: std::ops::RangeInclusive<f64> = 100.0..=30_000.0;

/// The largest friction coefficient that is not taken for an angle in degrees: rubber has 1 to 2, interlocking rocks 3.
const FRICTION: f64 = 5.0;

/// Reports the doubtful values of the parts of a scene.
pub fn doubts(materials: &[Material], laws: &[Law], grains: &[Grains], walls: &[Wall], report: &mut Report) {
    for (k, material) in materials.iter().enumerate() {
        density(report, &format!("materials.{k}.density"), material.density);
    }
    for (k, law) in laws.iter().enumerate() {
        for (name, value) in law.kind.row().1 {
            if ["friction", "dynamic_friction", "static_friction"].contains(&name) && value > FRICTION {
                let question = if value < 90.0 {
                    format!("did you mean an angle? {value:?} degrees are {:.3}", libm::tan(value.to_radians()))
                } else {
                    "did you mean a coefficient? it is tangential over normal force".into()
                };
                report.ask(&format!("laws.{k}.kind.{name}"), format!("{value:?}"), &question);
            }
        }
    }
    for (k, grains) in grains.iter().enumerate() {
        for (axis, value) in grains.driven.iter().flatten().enumerate() {
            value.iter().for_each(|value| function(report, &format!("grains.{k}.driven.{axis}"), value));
        }
    }
    for (k, wall) in walls.iter().enumerate() {
        let (velocity, force, rotation): (&[Evolution], &[Option<Evolution>], &[Evolution]) = match wall {
            Wall::Plate { velocity, force, rotation, .. } => (velocity, &**force, rotation),
            Wall::Cylinder { velocity, force, rotation, .. } => (velocity, &**force, std::slice::from_ref(rotation)),
            Wall::Box { velocity, .. } => (velocity, &[], &[]),
        };
        let mut check = |name: &str, axis: usize, value: &Evolution| {
            function(report, &format!("walls.{k}.{name}.{axis}"), value);
        };
        velocity.iter().enumerate().for_each(|(axis, value)| check("velocity", axis, value));
        rotation.iter().enumerate().for_each(|(axis, value)| check("rotation", axis, value));
        let forces = force.iter().enumerate().filter_map(|(axis, value)| Some((axis, value.as_ref()?)));
        forces.for_each(|(axis, value)| check("force", axis, value));
    }
}

fn density(report: &mut Report, path: &str, density: f64) {
    if DENSITIES.contains(&density) {
        return;
    }
    let as_grams = 1000.0 * density;
    let question = if DENSITIES.contains(&as_grams) && density >= 0.5 {
        format!("did you mean kg/m^3? {density:?} g/cm^3 are {as_grams:?} kg/m^3")
    } else {
        "did you mean kg/m^3? water has 1000, rock 2500 to 3500".into()
    };
    report.ask(path, format!("{density:?}"), &question);
}

/// A function that is 0 at all times, unless it is written as a constant.
fn function(report: &mut Report, path: &str, function: &Evolution) {
    match function {
        &Evolution::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate } => {
            if ramp_start == Some(0.0) && ramp_rate == 0.0 {
                let found = "ramp_start 0 without ramp_rate: the function is 0 at all times";
                report.ask(path, found, "leave ramp_start out, or give a ramp_rate in 1/s");
            } else if constant == 0.0 && amplitude == 0.0 {
                report.ask(path, "the function is 0 at all times", "give an amplitude or a constant");
            } else if omega == 0.0 && (constant + amplitude * libm::cos(phase)).abs() <= f64::EPSILON * amplitude.abs()
            {
                report.ask(path, "omega 0: the function is 0 at all times", "give an omega in rad/s");
            }
        }
        Evolution::Table(points) if points.iter().all(|point| point.1 == 0.0) => {
            report.ask(path, "the function is 0 at all times", "give values, or Constant(0.0)");
        }
        Evolution::Constant(_) | Evolution::Table(_) => {}
    }
}
