//! Servos of walls in DRV_DOF.DAT: pressures with their areas, strain rates, pivots and surface velocities.

use std::f64::consts::PI;
use std::path::Path;

use cd_formats::drv_dof::{DrivenComponent, DrivenKind, DrvDof, Evolution};
use cd_formats::error::{Fault, Faults};
use cd_formats::geometry::plates::opposite_extent;
use cd_formats::probe::ProbeQuantity;

use super::bodies::InitialMotion;
use crate::math::{Twist, Vec3};
use crate::scene::{
    AreaSide, BodyId, BodyPart, BodyShape, ContactorShape, ImposedVelocity, PressedArea, Scene, StrainDrive, WallArea,
    WallPivot,
};

/// Largest component of a normal across the axis of its servo, and largest ratio of a distance that counts as 0: rounding of
/// files.
const AXIS_ROUNDING: f64 = 1e-6;

/// Found and expected text of a fault.
type FaultTexts = (&'static str, &'static str);

/// Adds the servos of DRV_DOF.DAT to the imposed motion of the scene, and the velocities that they impose at the start to
/// `motion`. Faults: servos of bodies or along axes that cannot have them.
pub fn set_servo_walls(
    datbox: &Path,
    driven: &DrvDof,
    scene: &mut Scene,
    start_time: f64,
    motion: &mut InitialMotion,
    faults: &mut Faults,
) {
    let file = datbox.join("DRV_DOF.DAT");
    let servos = driven.0.iter().filter(|row| row.body < scene.bodies.len());
    for row in servos.filter(|row| !matches!(row.kind, DrivenKind::Velocity | DrivenKind::Force)).collect::<Vec<_>>() {
        if let Err((found, expected)) = set_servo(row, driven, scene, motion) {
            faults.push(Fault::new(&file, Some(row.line), format!("body {}", row.body + 1), found, expected));
        }
    }
    let time_before = (1.0 - scene.options.theta) * scene.options.dt;
    for drive in scene.drives.iter().filter(|drive| drive.depends_on_position()) {
        let i = drive.body.index();
        let pushed = Twist { v: motion.v[i], w: motion.w[i] };
        let imposed = scene.imposed_motion(drive, start_time, &motion.x, &motion.q, time_before, &pushed);
        (motion.v[i], motion.w[i]) = (imposed.v, imposed.w);
    }
    set_ends_of_cylinders(scene, motion);
    set_wall_areas(&datbox.join("COMPUTE.RON"), scene, motion, faults);
}

/// Adds one servo. Errors: the texts of the fault if the body, or its other components, do not allow it.
fn set_servo(
    row: &DrivenComponent,
    driven: &DrvDof,
    scene: &mut Scene,
    motion: &InitialMotion,
) -> Result<(), FaultTexts> {
    let body = BodyId::new(row.body);
    let Ok(drive) = scene.drives.binary_search_by_key(&body, |drive| drive.body) else {
        return Err(("a servo of a body without imposed motion", "expected vlocy lines for its other components"));
    };
    match row.kind {
        DrivenKind::Velocity | DrivenKind::Force => {}
        DrivenKind::Pressure => {
            let area = pressed_area(row.component, scene, &scene.drives[drive], motion)?;
            let loads = &mut scene.loads;
            let load = loads.iter_mut().find(|load| load.body == body && load.component == row.component);
            load.into_iter().for_each(|load| load.area = Some(area.clone()));
        }
        DrivenKind::StrainRate => {
            let strain = strain_drive(row, scene, &scene.drives[drive], motion)?;
            scene.drives[drive].strain = Some(Box::new(strain));
        }
        DrivenKind::Pivot => {
            let pivot = wall_pivot(driven, &scene.drives[drive], motion)?;
            if scene.bodies[row.body].can_rotate() {
                scene.drives[drive].hinged_centre = Some(hinged_centre(scene, &pivot, body)?);
            } else {
                scene.drives[drive].pivot = Some(pivot);
            }
        }
        DrivenKind::SurfaceVelocity if !scene.walls[row.body] => {
            let expected = "expected a wall: a body with PLANx, or whose motion is all imposed";
            return Err(("a surface velocity of a grain", expected));
        }
        DrivenKind::SurfaceVelocity => {
            let surface = scene.drives[drive].surface.get_or_insert_default();
            surface[row.component] = Some(row.evolution.clone());
        }
    }
    Ok(())
}

/// Whether a component of the velocity is imposed as 0.
fn is_held(drive: &ImposedVelocity, component: usize) -> bool {
    drive.velocity[component] == Some(Evolution::constant(0.0))
}

/// Unit vector of the fixed axis of a servo, if `normal` is along it.
fn servo_axis(component: usize, normal: &Vec3) -> Result<Vec3, FaultTexts> {
    let across = (0..3).filter(|k| *k != component).map(|k| normal[k].abs()).fold(0.0, f64::max);
    if across > AXIS_ROUNDING {
        let expected = "expected a plate whose normal, or a cylinder whose axis, is along the axis of the servo";
        return Err(("a servo along an axis that is not that of the wall", expected));
    }
    Ok(Vec3::ith(component, 1.0))
}

/// The only part of a body; none in a scene without parts.
fn only_part(scene: &Scene, body: BodyId) -> Option<&BodyPart> {
    match scene.all_parts_of(body) {
        [part] => Some(part),
        _ => None,
    }
}

/// Sets the areas of the walls whose pressure probes follow. Faults: probes of other bodies.
fn set_wall_areas(file: &Path, scene: &mut Scene, motion: &InitialMotion, faults: &mut Faults) {
    let mut areas: Vec<WallArea> = Vec::new();
    for probe in &scene.options.probes {
        let ProbeQuantity::Pressure { on } = &probe.quantity else { continue };
        let found_area = match scene.selected_bodies(on)[..] {
            [body] if body.index() < scene.bodies.len() => wall_area(body, scene, motion),
            _ => Err(("several bodies", "expected one wall")),
        };
        match found_area {
            Ok(area) => areas.push(area),
            Err((found, expected)) => {
                faults.push(Fault::new(file, None, format!("probe '{}'", probe.name), found, expected));
            }
        }
    }
    scene.wall_areas = areas;
}

/// Sets the plates between which hollow cylinders whose radius changes have their pressure: those that their axis meets from
/// their centre, if the axis keeps its direction.
fn set_ends_of_cylinders(scene: &mut Scene, motion: &InitialMotion) {
    let mut radii = std::mem::take(&mut scene.radii);
    for changing in &mut radii {
        let q = &motion.q[changing.body.index()];
        let drive = scene.drives.iter().find(|drive| drive.body == changing.body);
        let is_upright = drive.is_some_and(|drive| is_held(drive, 3) && is_held(drive, 4) && drive.pivot.is_none());
        for end in &mut changing.ends {
            end.direction = q * end.direction;
            let plate = nearest_plate(scene, changing.body, motion, &end.direction).filter(|_| is_upright);
            end.neighbour = plate.map(|(body, _, half_thickness)| (body, half_thickness));
        }
    }
    scene.radii = radii;
}

/// Area of a wall and the axis of its normal.
fn wall_area(body: BodyId, scene: &Scene, motion: &InitialMotion) -> Result<WallArea, FaultTexts> {
    let Ok(drive) = scene.drives.binary_search_by_key(&body, |drive| drive.body) else {
        return Err(("a body without imposed motion", "expected a wall"));
    };
    if let Some(changing) = scene.radii.iter().find(|changing| changing.body == body) {
        return Ok(WallArea { body, axis: 2, area: PressedArea::Inside(*changing) });
    }
    let axis =
        (motion.q[body.index()] * only_part(scene, body).map_or(Vec3::z(), |part| part.axes * Vec3::z())).iamax();
    Ok(WallArea { body, axis, area: pressed_area(axis, scene, &scene.drives[drive], motion)? })
}

/// Area on which a pressure along the fixed axis `component` acts on a plate, or on the end of a solid cylinder.
fn pressed_area(
    component: usize,
    scene: &Scene,
    drive: &ImposedVelocity,
    motion: &InitialMotion,
) -> Result<PressedArea, FaultTexts> {
    let (body, i) = (drive.body, drive.body.index());
    let q = &motion.q[i];
    let geometry = only_part(scene, body).map(|part| (&part.geometry, q * (part.axes * Vec3::z())));
    if let Some((&ContactorShape::Cylinder { radius, hollow: false, .. }, axis)) = geometry {
        servo_axis(component, &axis)?;
        return Ok(PressedArea::Constant(PI * radius * radius));
    }
    let BodyShape::Plane { half_lengths } = scene.bodies[i].shape else {
        return Err(("a pressure on a body other than a plate or a solid cylinder", "expected a force"));
    };
    servo_axis(component, &(q * Vec3::z()))?;
    if !(is_held(drive, 3) && is_held(drive, 4)) {
        let expected = "expected components 4 and 5 imposed as 0: the area is that of a plate that does not tilt";
        return Err(("a pressure on a plate that tilts", expected));
    }
    if let Some((radius, drum)) = enclosing_radius(scene, body, motion, &half_lengths) {
        let changes = scene.radii.iter().any(|changing| changing.body == drum);
        return Ok(if changes { PressedArea::Section(drum) } else { PressedArea::Constant(PI * radius * radius) });
    }
    let periods = scene.options.periods();
    let side = |direction: Vec3, half_length: f64| {
        let along_period = (0..3).filter(|&k| direction[k].abs() > 1.0 - AXIS_ROUNDING).find_map(|k| periods[k]);
        AreaSide {
            direction,
            half_length: along_period.map_or(half_length, |period| half_length.min(0.5 * period)),
            neighbour: nearest_plate(scene, body, motion, &direction)
                .map(|(body, _, half_thickness)| (body, half_thickness)),
        }
    };
    let sides = [0, 1].map(|k| {
        let axis = q * Vec3::ith(k, 1.0);
        [side(axis, half_lengths[k]), side(-axis, half_lengths[k])]
    });
    if !is_held(drive, 5) {
        let extent = |sides: &[AreaSide; 2]| sides[0].half_length + sides[1].half_length;
        return Ok(PressedArea::Constant(extent(&sides[0]) * extent(&sides[1])));
    }
    Ok(PressedArea::Rectangle(Box::new(sides)))
}

/// Radius of the narrowest hollow cylinder about the normal of a plate whose disc the plate covers, m, and its body.
fn enclosing_radius(
    scene: &Scene,
    plate: BodyId,
    motion: &InitialMotion,
    half_lengths: &Vec3,
) -> Option<(f64, BodyId)> {
    let (x, normal) = (&motion.x[plate.index()], motion.q[plate.index()] * Vec3::z());
    let covered_radius = |part: &BodyPart| {
        let ContactorShape::Cylinder { radius, hollow: true, .. } = part.geometry else { return None };
        let (centre, q) = (&motion.x[part.body.index()], &motion.q[part.body.index()]);
        let axis = q * (part.axes * Vec3::z());
        let from_axis = (x - (centre + q * part.offset)).cross(&axis).norm();
        let is_about_normal = axis.cross(&normal).norm() <= AXIS_ROUNDING && from_axis <= AXIS_ROUNDING * radius;
        let is_covered = half_lengths.xy().min() >= radius * (1.0 - AXIS_ROUNDING);
        (is_about_normal && is_covered).then_some((radius, part.body))
    };
    scene.parts.iter().filter_map(covered_radius).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// The nearest plate across the line from the centre of `plate` along `direction`, the distance of its face from that centre,
/// and half of its thickness, m.
fn nearest_plate(scene: &Scene, plate: BodyId, motion: &InitialMotion, direction: &Vec3) -> Option<(BodyId, f64, f64)> {
    let start = &motion.x[plate.index()];
    let candidate = |&other: &BodyId| {
        let BodyShape::Plane { half_lengths } = scene.bodies[other.index()].shape else { return None };
        let axes = motion.q[other.index()].to_rotation_matrix().matrix().transpose();
        let distance = opposite_extent(start, direction, (&motion.x[other.index()], &axes, &half_lengths))?;
        (other != plate).then_some((other, distance, half_lengths.z))
    };
    scene.planes.iter().filter_map(candidate).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Strain rate of `row` of a plate or a solid cylinder, with the plate opposite to it: the nearer one along its normal or axis.
fn strain_drive(
    row: &DrivenComponent,
    scene: &Scene,
    drive: &ImposedVelocity,
    motion: &InitialMotion,
) -> Result<StrainDrive, FaultTexts> {
    let half_height = match (scene.bodies[drive.body.index()].shape, only_part(scene, drive.body)) {
        (BodyShape::Plane { half_lengths }, _) => half_lengths.z,
        (_, Some(BodyPart { geometry: ContactorShape::Cylinder { half_height, hollow: false, .. }, .. })) => {
            *half_height
        }
        _ => return Err(("a strain rate of a body other than a plate or a solid cylinder", "expected a velocity")),
    };
    let axis = servo_axis(row.component, &(motion.q[drive.body.index()] * Vec3::z()))?;
    if !(is_held(drive, 3) && is_held(drive, 4)) {
        return Err(("a strain rate of a wall that tilts", "expected components 4 and 5 imposed as 0"));
    }
    let opposite = [axis, -axis].into_iter().filter_map(|direction| {
        let (other, distance, half_thickness) = nearest_plate(scene, drive.body, motion, &direction)?;
        let thickness = half_height + half_thickness;
        // The axis points from the opposite plate to this wall, or against that.
        Some((other, distance, -direction[row.component] * thickness))
    });
    let Some((opposite, _, closed_distance)) = opposite.min_by(|a, b| a.1.total_cmp(&b.1)) else {
        let expected = "expected a second plate across the line along its normal from its centre";
        return Err(("a strain rate without a plate opposite to the wall", expected));
    };
    let opposite_drive = scene.drives.iter().find(|drive| drive.body == opposite);
    let is_plain = |drive: &ImposedVelocity| {
        drive.velocity[row.component].is_some() && drive.strain.is_none() && drive.pivot.is_none()
    };
    if !opposite_drive.is_some_and(is_plain) {
        let expected = "expected vlocy along the axis for the plate opposite to the wall";
        return Err(("a strain rate relative to a plate whose motion is not imposed along the axis", expected));
    }
    Ok(StrainDrive { component: row.component, rate: row.evolution.clone(), opposite, closed_distance })
}

/// Pivot of a wall, of its three rows.
fn wall_pivot(driven: &DrvDof, drive: &ImposedVelocity, motion: &InitialMotion) -> Result<WallPivot, FaultTexts> {
    let i = drive.body.index();
    let coordinate = |k: usize| {
        let mut rows = driven.0.iter().filter(|row| row.body == i && row.kind == DrivenKind::Pivot);
        rows.find(|row| row.component == k).map(|row| row.evolution.value_at(0.0))
    };
    let [Some(x), Some(y), Some(z)] = [0, 1, 2].map(coordinate) else {
        return Err(("a pivot without all coordinates", "expected three lines pivot, of components 1 to 3"));
    };
    if !(0..3).all(|k| is_held(drive, k)) || drive.strain.is_some() {
        let expected = "expected vlocy of components 1 to 3 imposed as 0: the rotation moves the centre";
        return Err(("a pivot of a wall that also moves along an axis", expected));
    }
    let point = Vec3::new(x, y, z);
    Ok(WallPivot { point, offset: motion.q[i].inverse_transform_vector(&(motion.x[i] - point)) })
}

/// Centre of mass, in the axes of the body, m, of a wall with a `pivot` that turns freely about one or more of its axes.
/// Errors: the texts of the fault if its position is not at the pivot, or it has several contactors.
fn hinged_centre(scene: &Scene, pivot: &WallPivot, body: BodyId) -> Result<Vec3, FaultTexts> {
    let Some(part) = only_part(scene, body) else {
        return Err(("a hinge of a body of several contactors", "expected one contactor besides PT3Dx"));
    };
    if pivot.offset.norm() > AXIS_ROUNDING * part.bounding_radius {
        let expected =
            "expected the position of the body at the pivot, and its contactor about it, or vlocy of components 4 to 6";
        return Err(("a pivot away from the position of a wall that turns freely", expected));
    }
    Ok(part.offset)
}
