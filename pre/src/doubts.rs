//! Values of a scene that are allowed but probably mistakes: units, functions that are 0 at all times, unused laws.

use cd_formats::compute::ExternalField;
use cd_formats::doubts::{angle, density, law_parameter};
use cd_formats::orbit::OrbitSpec;
use cd_formats::report::FaultReport;

use crate::scene::{ColourPairLaw, GrainOrientations, Grains, Law, Material, Rotation, SceneWall, TimeFunction};

/// Reports the doubtful values of the parts of a scene.
pub fn report_doubts(
    materials: &[Material],
    laws: &[Law],
    grains: &[Grains],
    walls: &[SceneWall],
    report: &mut FaultReport,
) {
    // Walls may have any density: that of a plate under a force sets its mass, and a light one follows the grains at once.
    let is_of_walls_only = |name: &str| {
        walls.iter().any(|wall| wall.material() == name) && !grains.iter().any(|grains| grains.material == name)
    };
    for (k, material) in materials.iter().enumerate() {
        if let Some(question) = density(material.density).filter(|_| !is_of_walls_only(&material.name)) {
            let path = format!("materials.{k}.density");
            report.add_warning(&path, report.number_text(&path, material.density), &question);
        }
    }
    for (k, law) in laws.iter().enumerate() {
        for (parameter, value) in law.kind.parameter_values() {
            if let Some(question) = law_parameter(parameter, value) {
                let path = format!("laws.{k}.kind.{}", parameter.name());
                report.add_warning(&path, report.number_text(&path, value), &question);
            }
        }
    }
    for (k, grains) in grains.iter().enumerate() {
        report_imposed_motion(grains, &format!("grains.{k}"), report);
    }
    for (k, grains) in grains.iter().enumerate() {
        check_angle(report, &format!("grains.{k}.orientation"), &grains.orientation);
        let path = format!("grains.{k}.grain_orientation");
        match &grains.grain_orientation {
            GrainOrientations::Random => {}
            GrainOrientations::Same(turn) => check_angle(report, &format!("{path}.0"), turn),
            GrainOrientations::List(turns) => {
                (0..).zip(turns).for_each(|(n, turn): (usize, _)| check_angle(report, &format!("{path}.0.{n}"), turn));
            }
        }
    }
    for (k, wall) in walls.iter().enumerate() {
        if let SceneWall::Box { orientation, .. } | SceneWall::Mesh { orientation, .. } = wall {
            check_angle(report, &format!("walls.{k}.orientation"), orientation);
        }
        // Functions of each field by axes.
        let functions: Vec<(&str, Vec<Option<&TimeFunction>>)> = match wall {
            SceneWall::Plate { velocity, force, spin, moment, pressure, strain_rate, surface_velocity, .. } => vec![
                ("pressure", vec![pressure.as_deref()]),
                ("strain_rate", vec![strain_rate.as_deref()]),
                ("surface_velocity", surface_velocity.iter().map(Some).collect()),
                ("velocity", velocity.iter().map(Some).collect()),
                ("spin", spin.iter().map(Some).collect()),
                ("force", force.iter().map(Option::as_ref).collect()),
                ("moment", moment.iter().map(Option::as_ref).collect()),
            ],
            SceneWall::Cylinder { velocity, force, spin, moment, pressure, strain_rate, surface_spin, .. } => vec![
                ("pressure", vec![pressure.as_deref()]),
                ("strain_rate", vec![strain_rate.as_deref()]),
                ("surface_spin", vec![Some(surface_spin)]),
                ("velocity", velocity.iter().map(Some).collect()),
                ("spin", vec![Some(spin)]),
                ("force", force.iter().map(Option::as_ref).collect()),
                ("moment", vec![moment.as_ref()]),
            ],
            SceneWall::Box { velocity, .. } => vec![("velocity", velocity.iter().map(Some).collect())],
            SceneWall::Mesh { velocity, spin, .. } => {
                vec![("velocity", velocity.iter().map(Some).collect()), ("spin", spin.iter().map(Some).collect())]
            }
        };
        for (name, functions) in functions {
            for (axis, function) in functions.into_iter().enumerate().filter_map(|(axis, one)| Some((axis, one?))) {
                check_function(report, &format!("walls.{k}.{name}.{axis}"), function);
            }
        }
    }
}

/// Reports imposed motion of the grains at `path` that imposes nothing, or the rotation alone by omission, and functions that
/// are 0 at all times.
fn report_imposed_motion(grains: &Grains, path: &str, report: &mut FaultReport) {
    let has_no_function = |functions: &Option<[Option<TimeFunction>; 3]>| {
        functions.as_ref().is_some_and(|functions| functions.iter().all(Option::is_none))
    };
    let is_any_imposed = grains.imposed_components().iter().any(Option::is_some);
    if has_no_function(&grains.driven) && is_any_imposed && grains.driven_spin.is_none() {
        let advice = "write driven_spin: (Constant(0.0), Constant(0.0), Constant(0.0)) alone, or leave driven out";
        report.add_warning(&format!("{path}.driven"), "imposes no translation, but holds the rotation", advice);
    } else if !is_any_imposed && (has_no_function(&grains.driven) || has_no_function(&grains.driven_spin)) {
        let name = if grains.driven.is_some() { "driven" } else { "driven_spin" };
        report.add_warning(&format!("{path}.{name}"), "imposes nothing", "give a function, or leave it out");
    }
    for (name, functions) in [("driven", &grains.driven), ("driven_spin", &grains.driven_spin)] {
        for (axis, function) in functions.iter().flatten().enumerate() {
            function.iter().for_each(|function| check_function(report, &format!("{path}.{name}.{axis}"), function));
        }
    }
}

/// Asks about an angle of more than a full turn.
pub fn check_angle(report: &mut FaultReport, path: &str, rotation: &Rotation) {
    if let Some(question) = angle(rotation.angle) {
        let path = format!("{path}.angle");
        report.add_warning(&path, report.number_text(&path, rotation.angle), &question);
    }
}

/// Asks about angles of more than a full turn among the elements of the orbits of groups and primaries.
pub fn report_orbit_doubts(grains: &[Grains], fields: &[ExternalField], report: &mut FaultReport) {
    let grain_orbits = grains.iter().enumerate().filter_map(|(k, grains)| {
        let orbit = grains.orbit.as_ref()?;
        Some((format!("grains.{k}.orbit.path"), &orbit.path))
    });
    let field_orbits =
        fields.iter().enumerate().filter_map(|(k, field)| Some((format!("compute.fields.{k}.orbit"), field.orbit()?)));
    for (path, orbit) in grain_orbits.chain(field_orbits) {
        let OrbitSpec::Elements { inclination, node, argument, .. } = *orbit else { continue };
        for (name, value) in [("inclination", inclination), ("node", node), ("argument", argument)] {
            if let Some(question) = angle(value) {
                let path = format!("{path}.{name}");
                report.add_warning(&path, report.number_text(&path, value), &question);
            }
        }
    }
}

/// Reports plates with a force in a scene with other plates, which they pass through, unless a row of `contacts` declares
/// that the colours have no law. `other_plates`: colours of plates other than `walls`.
pub fn report_plate_presses<'a>(
    walls: &'a [SceneWall],
    other_plates: impl Iterator<Item = &'a str>,
    contacts: &[ColourPairLaw],
    report: &mut FaultReport,
) {
    let plates: Vec<(usize, &SceneWall)> = (0..).zip(walls).filter(|(_, wall)| wall.contactor() == "PLANx").collect();
    let other_plates: Vec<&str> = other_plates.collect();
    for &(k, press) in plates.iter().filter(|(_, wall)| wall.has_force()) {
        // Whether the scene says that the press and plates of a colour do not touch each other.
        let is_meant = |colour: &str| {
            let pairs = [(press.colour(), colour), (colour, press.colour())];
            contacts.iter().any(|row| row.law.is_none() && pairs.contains(&(&row.between.0, &row.between.1)))
        };
        let others = plates.iter().filter(|(other, _)| *other != k).map(|(_, wall)| wall.colour());
        if let Some(colour) = others.chain(other_plates.iter().copied()).find(|colour| !is_meant(colour)) {
            let advice = format!(
                "two plates never touch each other: press with a solid Cylinder or a Box of grains that is driven in \
                 part; if they cannot meet, write (between: (\"{}\", \"{colour}\"), law: None)",
                press.colour()
            );
            let found = format!("a plate that moves by a force, and another plate of the colour '{colour}'");
            report.add_warning(&format!("walls.{k}.force"), found, &advice);
        }
    }
}

/// Reports the laws that no contact uses.
pub fn report_unused_laws(laws: &[Law], is_used: impl Fn(&str) -> bool, report: &mut FaultReport) {
    for (k, law) in laws.iter().enumerate().filter(|(_, law)| !is_used(&law.name)) {
        let found = format!("no contact uses the law '{}'", law.name);
        report.add_warning(&format!("laws.{k}.name"), found, "name it in a row of contacts, or remove it");
    }
}

/// Reports a function that is 0 at all times, unless it is written as a constant.
fn check_function(report: &mut FaultReport, path: &str, function: &TimeFunction) {
    match function {
        &TimeFunction::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate } => {
            if ramp_start == Some(0.0) && ramp_rate == 0.0 {
                let found = "ramp_start 0 without ramp_rate: the function is 0 at all times";
                report.add_warning(path, found, "leave ramp_start out, or give a ramp_rate in 1/s");
            } else if constant == 0.0 && amplitude == 0.0 {
                report.add_warning(path, "the function is 0 at all times", "give an amplitude or a constant");
            } else if omega == 0.0 && (constant + amplitude * libm::cos(phase)).abs() <= f64::EPSILON * amplitude.abs()
            {
                report.add_warning(path, "omega 0: the function is 0 at all times", "give an omega in rad/s");
            }
        }
        TimeFunction::Table(points) if points.iter().all(|point| point.1 == 0.0) => {
            report.add_warning(path, "the function is 0 at all times", "give values, or Constant(0.0)");
        }
        TimeFunction::Constant(_) | TimeFunction::Table(_) => {}
    }
}
