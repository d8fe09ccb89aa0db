//! Checks of hollow cylinders whose radius changes.

use cd_formats::hollow_radius::{least_radius, shrinkage_fault};
use cd_formats::report::FaultReport;

use crate::grain::{Grain, Population};
use crate::scene::{Scene, SceneWall};
use crate::shapes::OrientedShape;

/// Reports the control at `path` of the radius of a wall, if it has one that no run could use.
pub fn check_radial(scene: &Scene, wall: &SceneWall, path: &str, report: &mut FaultReport) {
    let SceneWall::Cylinder { hollow, ends, radial: Some(control), colour, .. } = wall else { return };
    control.check_in(scene.compute.dt, path, report);
    scene.compute.check_options_of_radii(path, report);
    let is_touched = scene.grains.iter().any(|grains| has_law(scene, [colour, &grains.colour]) && !grains.is_imposed());
    let requirements = [
        (*hollow, "of a solid cylinder", "a hollow one"),
        (ends.is_none(), "given with ends, whose size is constant", "no ends: add two plates"),
        (!wall.has_load(), "given with a force or moment", "an imposed motion"),
        (
            is_touched,
            "of a cylinder without a law for grains that move",
            "such a row of contacts: nothing would resist",
        ),
    ];
    for (holds, found, expected) in requirements {
        report.require(holds, path, found, expected);
    }
}

/// Whether bodies of two colours have a law.
fn has_law(scene: &Scene, [a, b]: [&str; 2]) -> bool {
    let is_pair = |(first, second): &(String, String)| [first, second] == [a, b] || [first, second] == [b, a];
    scene.contacts.iter().any(|contact| contact.law.is_some() && is_pair(&contact.between))
}

/// Reports rates that shrink a radius in the run through the grains inside.
pub fn check_radial_rates(scene: &Scene, population: &Population, report: &mut FaultReport) {
    for (k, wall) in scene.walls.iter().enumerate() {
        let SceneWall::Cylinder { radial: Some(control), radius, half_height, colour, .. } = wall else { continue };
        let Some(steps) = scene.compute.last_step(0, (0, 0.0)) else { continue };
        let is_inside = |grain: &&Grain| {
            let grains = &scene.grains[grain.group];
            has_law(scene, [colour, &grains.colour]) && !grains.is_imposed()
        };
        let inside: Vec<&Grain> = population.grains.iter().filter(is_inside).collect();
        let balls = inside.iter().filter(|grain| grain.shape == OrientedShape::Sphere).map(|grain| grain.radius);
        // Sources and sinks change what is inside.
        let exchanges = !scene.compute.sources.is_empty() || !scene.compute.sinks.is_empty();
        let volume = if exchanges { 0.0 } else { inside.iter().map(|grain| grain.volume()).sum() };
        let least = least_radius(balls, volume, 2.0 * half_height);
        let fault = shrinkage_fault(control, *radius, steps as f64 * scene.compute.dt, least);
        if let Some((found, expected)) = fault {
            report.add_fault(&format!("walls.{k}.radial"), found, &expected);
        }
    }
}
