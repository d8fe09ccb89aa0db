//! Hollow cylinders whose radius changes: the option `radii`.

use std::f64::consts::PI;
use std::path::Path;

use cd_formats::error::{Fault, Faults};
use cd_formats::hollow_radius::{RadiusControl, RadiusState, largest_radial_speed, least_radius, shrinkage_fault};

use crate::math::Vec3;
use crate::scene::{AreaSide, BodyId, BodyPart, ChangingRadius, ContactorShape, Scene};

/// Adds the hollow cylinders of the option `radii` of `file` to the scene, for a run from the time `start`, s. Faults: bodies
/// whose radius cannot change, and rates that shrink one through the bodies inside.
pub fn set_changing_radii(file: &Path, scene: &mut Scene, start: f64, faults: &mut Faults) {
    for (k, control) in scene.options.radii.clone().into_iter().enumerate() {
        let span = scene.end_time() - start;
        match changing_radius(scene, control, span) {
            Ok(changing) => {
                let speed = largest_radial_speed(&control.control, initial_radius(scene, changing.body), span);
                let drives = scene.drives.iter_mut().filter(|drive| drive.body == changing.body);
                drives.for_each(|drive| drive.radial_speed = speed);
                scene.radii.push(changing);
            }
            Err((found, expected)) => {
                let object = format!("radii, row {}, body {}", k + 1, control.body);
                let expected = format!("expected {expected}");
                faults.push(Fault::new(file, None, object, found, expected));
            }
        }
    }
}

/// Hollow cylinder with this control in a run of the time `span`, s. Errors: found and expected text of a fault.
fn changing_radius(scene: &Scene, control: RadiusControl, span: f64) -> Result<ChangingRadius, (String, String)> {
    let fault = |found: &str, expected: &str| Err((found.to_string(), expected.to_string()));
    let hollow = "the number of a body with one contactor DNLYC besides PT3Dx, whose motion is all imposed";
    let index = control.body.wrapping_sub(1);
    if index >= scene.bodies.len() || !scene.has_parts() {
        return fault("no hollow cylinder", hollow);
    }
    let body = BodyId::new(index);
    let [part] = scene.all_parts_of(body) else { return fault("not one hollow cylinder", hollow) };
    let ContactorShape::Cylinder { half_height, radius, hollow: true } = part.geometry else {
        return fault("no hollow cylinder", hollow);
    };
    if !scene.bodies[index].is_imposed() {
        return fault("a hollow cylinder that forces move", hollow);
    }
    let is_inside = |inner: &&BodyPart| {
        let can_touch = scene.visibility.interaction_rule(inner.class, part.class).is_some();
        can_touch && scene.bodies[inner.body.index()].can_be_pushed()
    };
    let inner: Vec<&BodyPart> = scene.parts.iter().filter(is_inside).collect();
    if inner.is_empty() {
        let expected = "a law in TACT_BEHAV.DAT for it and a body that moves: nothing inside would resist";
        return fault("a hollow cylinder without contacts", expected);
    }
    // Plates are set with the servos of walls.
    let axis = part.axes * Vec3::z();
    let ends = [axis, -axis].map(|direction| AreaSide { direction, half_length: half_height, neighbour: None });
    let balls = inner.iter().map(|inner| inner.geometry.inner_radius());
    let mut bodies: Vec<BodyId> = inner.iter().map(|inner| inner.body).collect();
    bodies.dedup();
    let volumes = bodies.iter().map(|body| 4.0 / 3.0 * PI * scene.bodies[body.index()].radius.powi(3));
    // Sources and sinks change what is inside.
    let exchanges = !scene.options.sources.is_empty() || !scene.options.sinks.is_empty();
    let volume = if exchanges { 0.0 } else { volumes.sum() };
    let least = least_radius(balls, volume, 2.0 * half_height);
    match shrinkage_fault(&control.control, radius, span, least) {
        Some(fault) => Err(fault),
        None => Ok(ChangingRadius { body, control, axis, ends, least }),
    }
}

/// Radius at the start of a run of a hollow cylinder, m.
fn initial_radius(scene: &Scene, body: BodyId) -> f64 {
    let ContactorShape::Cylinder { radius, .. } = scene.all_parts_of(body)[0].geometry else {
        unreachable!("a changing radius is that of a hollow cylinder")
    };
    radius
}

/// Radii at the start of a run with bodies at `x`, m.
pub fn initial_radii(scene: &Scene, x: &[Vec3]) -> Vec<RadiusState> {
    let initial = |changing: &ChangingRadius| {
        RadiusState::new(initial_radius(scene, changing.body), changing.height(x), &changing.control)
    };
    scene.radii.iter().map(initial).collect()
}
