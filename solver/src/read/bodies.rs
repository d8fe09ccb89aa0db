//! BODIES.DAT, DRV_DOF.DAT and DOF.INI to bodies, drives and motion.

use std::f64::consts::PI;
use std::path::Path;

use cd_formats::bodies::{self, Bodies};
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::compute::Compute;
use cd_formats::dof::Dof;
use cd_formats::drv_dof::{DrivenKind, DrvDof, Evolution};
use cd_formats::error::{Fault, Faults};
use cd_formats::snapshot::MaterialName;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use crate::math::{Quat, Vec3};
use crate::scene::{Body, Drive, Load, Scene, Shape, Visibility};

/// The scene without its laws.
pub fn scene(
    datbox: &Path,
    records: &Bodies,
    bulk: &BulkBehav,
    driven: &DrvDof,
    options: Compute,
    faults: &mut Faults,
) -> Scene {
    let file = datbox.join("BODIES.DAT");
    let mut colours: Vec<String> = Vec::new();
    let mut bodies = Vec::new();
    for (index, record) in records.0.iter().enumerate() {
        match body(record, bulk, &mut colours) {
            Ok(body) => bodies.push(body),
            Err((found, expected)) => {
                faults.push(Fault::new(&file, Some(record.line), format!("body {}", index + 1), found, expected));
                bodies.push(placeholder());
            }
        }
    }
    let (drives, loads) = motion_imposed(datbox, driven, &mut bodies, faults);
    for (index, body) in bodies.iter().enumerate() {
        if matches!(body.shape, Shape::Plane { .. }) && !body.driven {
            let expected = "expected six vlocy lines in DRV_DOF.DAT: plates are walls, all their motion is imposed";
            let line = Some(records.0[index].line);
            faults.push(Fault::new(
                &file,
                line,
                format!("body {}", index + 1),
                "a PLANx that may move freely",
                expected,
            ));
        }
    }

    let indices = |chosen: &dyn Fn(&Body) -> bool| -> Vec<u32> {
        bodies.iter().enumerate().filter(|(_, body)| chosen(body)).map(|(i, _)| i as u32).collect()
    };
    let free = indices(&|body| !body.driven);
    let spheres = indices(&Body::is_sphere);
    let planes = indices(&|body| !body.is_sphere());
    let radii: Vec<f64> = free.iter().filter_map(|&i| radius(&bodies[i as usize])).collect();
    let mut events = options.events.clone();
    events.sort_by(|a, b| a.time.total_cmp(&b.time));
    Scene {
        drives,
        loads,
        laws: Vec::new(),
        visibility: Visibility::default(),
        events,
        options,
        start: (0, 0.0),
        materials: bulk.materials.iter().map(|m| MaterialName { name: m.name.clone(), density: m.density }).collect(),
        colours,
        law_names: Vec::new(),
        reference: records.0.iter().map(|body| Vec3::from(body.position)).collect(),
        free,
        spheres,
        planes,
        general: false,
        turning: Vec::new(),
        mean_radius: radii.iter().sum::<f64>() / radii.len().max(1) as f64,
        listing_range: 0.0,
        bodies,
    }
}

fn radius(body: &Body) -> Option<f64> {
    match body.shape {
        Shape::Sphere { radius } => Some(radius),
        Shape::Plane { .. } => None,
    }
}

/// Stands in for a body that was refused, so that the rest can be checked.
fn placeholder() -> Body {
    let shape = Shape::Sphere { radius: 1.0 };
    Body { shape, mass: 1.0, inertia: [1.0; 3], driven: false, material: 0, colour: 0, class: 0 }
}

/// What stands there and what was expected.
type Refusal = (String, String);

fn body(record: &bodies::Body, bulk: &BulkBehav, colours: &mut Vec<String>) -> Result<Body, Refusal> {
    let [contactor] = record.contactors.as_slice() else {
        let found = format!("{} contactors", record.contactors.len());
        return Err((found, "expected one: clusters are not computed".into()));
    };
    let Some(material) = bulk.materials.iter().position(|m| m.name == record.material) else {
        let names: Vec<&str> = bulk.materials.iter().map(|m| m.name.as_str()).collect();
        return Err((
            format!("material '{}' is not defined", record.material),
            format!("defined are {}", names.join(", ")),
        ));
    };
    let density = bulk.materials[material].density;
    if density <= 0.0 {
        return Err((
            format!("material '{}' has the density {density}", record.material),
            "expected more than 0".into(),
        ));
    }
    let framed = contactor.local_frame.as_ref().is_some_and(|frame| {
        frame.offset != [0.0; 3] || frame.axes != [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    });
    if framed {
        let found = format!("contactor {} with a localframe", contactor.shape.name());
        return Err((found, "expected the frame in DOF.INI (axes a, b, g)".into()));
    }
    let (shape, volume, inertia) = match contactor.shape {
        bodies::Shape::Sphere { radius: r } => {
            let volume = 4.0 / 3.0 * PI * r.powi(3);
            (Shape::Sphere { radius: r }, volume, [0.4 * volume * r * r; 3])
        }
        bodies::Shape::Plane { half_lengths: [a, b, c] } => {
            let volume = 8.0 * a * b * c;
            let inertia = [b * b + c * c, a * a + c * c, a * a + b * b].map(|square| volume / 3.0 * square);
            (Shape::Plane { half_lengths: Vec3::new(a, b, c) }, volume, inertia)
        }
        ref other => return Err((format!("contactor {}", other.name()), "computed are SPHER and PLANx".into())),
    };
    if let (bodies::Shape::Sphere { radius }, avrd) = (&contactor.shape, record.equivalent_radius) {
        // The files hold 7 or 8 digits.
        if avrd != 0.0 && (avrd - radius).abs() > 1e-6 * radius {
            let expected =
                format!("expected 0 or the contactor's radius {radius}: a sphere's mass follows from its own size");
            return Err((format!("avrd {avrd}"), expected));
        }
    }
    let mass = density * volume;
    if !(mass.is_finite() && mass > 0.0 && inertia.iter().all(|i| (density * i).is_finite() && density * i > 0.0)) {
        return Err((format!("mass {mass} kg"), "expected mass and inertia that a number can hold".into()));
    }
    let colour = colours.iter().position(|c| *c == contactor.colour).unwrap_or_else(|| {
        colours.push(contactor.colour.clone());
        colours.len() - 1
    });
    Ok(Body {
        shape,
        mass,
        inertia: inertia.map(|i| density * i),
        driven: false,
        material: material as u16,
        colour: colour as u16,
        class: 0,
    })
}

fn motion_imposed(datbox: &Path, driven: &DrvDof, bodies: &mut [Body], faults: &mut Faults) -> (Vec<Drive>, Vec<Load>) {
    let file = datbox.join("DRV_DOF.DAT");
    let mut velocities: Vec<(usize, usize, [Option<Evolution>; 6])> = Vec::new();
    let mut loads = Vec::new();
    for row in &driven.0 {
        let mut refuse = |found: String, expected: &str| {
            faults.push(Fault::new(&file, Some(row.line), format!("body {}", row.body + 1), found, expected));
        };
        if row.body >= bodies.len() {
            refuse("does not exist".into(), &format!("expected 1 to {}", bodies.len()));
            continue;
        }
        match row.kind {
            DrivenKind::Force => {
                loads.push(Load { body: row.body, component: row.component, value: row.evolution.clone() });
            }
            DrivenKind::Velocity => {
                let slot = match velocities.iter().position(|(body, _, _)| *body == row.body) {
                    Some(k) => k,
                    None => {
                        velocities.push((row.body, row.line, Default::default()));
                        velocities.len() - 1
                    }
                };
                if velocities[slot].2[row.component].replace(row.evolution.clone()).is_some() {
                    refuse(format!("component {} is driven twice", row.component + 1), "expected once");
                }
            }
        }
    }
    let mut drives = Vec::new();
    for (body, line, components) in velocities {
        let missing: Vec<String> = (0..6).filter(|&k| components[k].is_none()).map(|k| (k + 1).to_string()).collect();
        if !missing.is_empty() {
            let found = format!("velocity components {} are free while others are driven", missing.join(", "));
            let expected = "expected all six or none: bodies driven in part are not computed";
            faults.push(Fault::new(&file, Some(line), format!("body {}", body + 1), found, expected));
            continue;
        }
        bodies[body].driven = true;
        drives.push(Drive { body, velocity: components.map(|c| c.unwrap_or_else(|| Evolution::constant(0.0))) });
    }
    drives.sort_by_key(|drive| drive.body);
    loads.retain(|load| !bodies[load.body].driven); // a force on a body whose motion is imposed moves nothing
    (drives, loads)
}

/// Positions, orientations, velocities and angular velocities (world frame).
pub fn motion(
    datbox: &Path,
    records: &Bodies,
    dof: &Dof,
    scene: &Scene,
    faults: &mut Faults,
) -> (Vec<Vec3>, Vec<Quat>, Vec<Vec3>, Vec<Vec3>) {
    let file = datbox.join("DOF.INI");
    let count = records.0.len();
    let mut x: Vec<Vec3> = records.0.iter().map(|body| Vec3::from(body.position)).collect();
    let mut q = vec![Quat::identity(); count];
    let mut v = vec![Vec3::zeros(); count];
    let mut w = vec![Vec3::zeros(); count];
    for row in &dof.bodies {
        let mut refuse = |found: String, expected: &str| {
            faults.push(Fault::new(&file, Some(row.line), format!("body {}", row.body + 1), found, expected));
        };
        if row.body >= count {
            refuse("does not exist".into(), &format!("expected 1 to {count}"));
            continue;
        }
        let axes = Matrix3::from_fn(|i, j| row.axes[j][i]); // a, b, g are columns of body -> world
        let defect = (axes.transpose() * axes - Matrix3::identity()).norm();
        // Frames are written with 7 digits and drift by less than that between writings.
        if defect > 1e-4 || axes.determinant() < 0.0 {
            refuse(
                format!("axes a, b, g that miss a right-handed unit triad by {defect:.1e}"),
                "expected less than 1e-4",
            );
            continue;
        }
        let i = row.body;
        x[i] += Vec3::from_row_slice(&row.displacement[..3]);
        q[i] =
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_eps(&axes, 1e-15, 100, Rotation3::identity()));
        v[i] = Vec3::from_row_slice(&row.velocity[..3]);
        w[i] = q[i] * Vec3::from_row_slice(&row.velocity[3..]);
    }
    debug_assert_eq!(scene.bodies.len(), count);
    (x, q, v, w)
}
