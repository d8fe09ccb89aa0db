//! Hollow cylinders whose radius changes: the option `radii`.

use std::path::Path;

use cd_formats::error::{Fault, Faults};
use cd_formats::hollow_radius::{RadiusControl, RadiusState};

use crate::math::Vec3;
use crate::scene::{BodyId, ChangingRadius, ContactorShape, Scene};

/// Adds the hollow cylinders of the option `radii` to the scene. Faults: bodies whose radius cannot change.
pub fn set_changing_radii(datbox: &Path, scene: &mut Scene, faults: &mut Faults) {
    for (k, control) in scene.options.radii.clone().into_iter().enumerate() {
        match changing_radius(scene, control) {
            Ok(changing) => {
                let drives = scene.drives.iter_mut().filter(|drive| drive.body == changing.body);
                drives.for_each(|drive| drive.changes_radius = true);
                scene.radii.push(changing);
            }
            Err((found, expected)) => {
                let object = format!("radii, row {}, body {}", k + 1, control.body);
                faults.push(Fault::new(&datbox.join("COMPUTE.RON"), None, object, found, expected));
            }
        }
    }
}

/// Hollow cylinder with this control. Errors: found and expected text of a fault.
fn changing_radius(scene: &Scene, control: RadiusControl) -> Result<ChangingRadius, (&'static str, &'static str)> {
    let hollow = "expected a body with one contactor DNLYC besides PT3Dx, whose motion is all imposed";
    let index = control.body.wrapping_sub(1);
    if index >= scene.bodies.len() || !scene.has_parts() {
        return Err(("no hollow cylinder", hollow));
    }
    let body = BodyId::new(index);
    let [part] = scene.all_parts_of(body) else { return Err(("not one hollow cylinder", hollow)) };
    let ContactorShape::Cylinder { half_height, hollow: true, .. } = part.geometry else {
        return Err(("no hollow cylinder", hollow));
    };
    if !scene.bodies[index].is_imposed() {
        return Err(("a hollow cylinder that forces move", hollow));
    }
    let classes = 0..scene.visibility.classes as u16;
    if !classes.into_iter().any(|class| scene.visibility.interaction_rule(class, part.class).is_some()) {
        let expected = "expected a law in TACT_BEHAV.DAT for it: nothing inside would resist";
        return Err(("a hollow cylinder without contacts", expected));
    }
    if !scene.options.impacts.is_simultaneous() {
        return Err(("a radius that changes, with impacts: in_order", "expected impacts: simultaneous"));
    }
    Ok(ChangingRadius { body, control, axis: part.axes * Vec3::z(), half_height })
}

/// Radii at the start of a run.
pub fn initial_radii(scene: &Scene) -> Vec<RadiusState> {
    let initial = |changing: &ChangingRadius| {
        let ContactorShape::Cylinder { radius, .. } = scene.all_parts_of(changing.body)[0].geometry else {
            unreachable!("a changing radius is that of a hollow cylinder")
        };
        RadiusState::new(radius, &changing.control)
    };
    scene.radii.iter().map(initial).collect()
}
