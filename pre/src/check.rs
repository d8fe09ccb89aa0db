//! Checks of the values of a scene. All faults are reported at once, before any grain is placed.

use std::cmp::Ordering;
use std::collections::{HashMap, HashSet};

use cd_formats::compute::{Compute, ContactSolver, Event, EventAction, ExternalField, ROTATION_ABOUT_PERIOD};
use cd_formats::law_table::{LawModel, PairStrength, is_law_of_points};
use cd_formats::names::{count_text, number_text, vector_text};
use cd_formats::report::{FaultReport, MAX_MAGNITUDE, is_beyond_range, is_rounded_to_zero};
use nalgebra::Vector3;

use crate::radial::check_radial;
use crate::scene::{
    ContactSurface, Envelope, GrainOrientations, GrainPlacement, GrainShape, Grains, Law, ModelScale, RadiusKind,
    Revolution, Rotation, Scene, SceneWall, SizeDistribution, TimeFunction,
};
use crate::shapes::clump::{BallsError, MAX_CLUMP_BALLS, check_balls};
use crate::shapes::union::ClumpBall;
use crate::sizes::{MAX_BODIES, normal_share};

/// Smallest positive number in DATBOX: exponents in its files have two digits, and smaller numbers become 0.
pub(crate) const SMALLEST_FILE_NUMBER: f64 = 1e-99;

/// Whether DATBOX can hold a mass or a moment of inertia, which may be larger than numbers of a scene.
pub(crate) fn is_moment(x: f64) -> bool {
    (SMALLEST_FILE_NUMBER..1.0 / SMALLEST_FILE_NUMBER).contains(&x)
}

/// Whether cd-solve accepts a number of DATBOX.
pub(crate) fn fits_files(x: f64) -> bool {
    x.abs() < MAX_MAGNITUDE
}

/// Whether a number is positive in DATBOX.
pub(crate) fn is_positive(x: f64) -> bool {
    x >= SMALLEST_FILE_NUMBER && fits_files(x)
}

/// Expectation `expected` about a number, with the bound of DATBOX where only that is violated.
fn expected_in_files(x: f64, expected: &str) -> String {
    if x.is_finite() && !fits_files(x) {
        format!("{expected}, below {MAX_MAGNITUDE:e} in magnitude")
    } else if x > 0.0 && x < SMALLEST_FILE_NUMBER {
        format!("{expected}, at least {SMALLEST_FILE_NUMBER:e}")
    } else {
        expected.to_string()
    }
}

/// Reports the number `x` at `path`, as it is written there, unless `holds`.
fn require_in_files(report: &mut FaultReport, holds: bool, path: &str, x: f64, expected: &str) {
    let found = report.number_text(path, x);
    // Digits of a number that f64 cannot hold have the fault of a large or small one.
    let magnitude = if is_rounded_to_zero(&found, x) {
        f64::MIN_POSITIVE
    } else if is_beyond_range(&found, x) {
        f64::MAX
    } else {
        x
    };
    report.require(holds, path, found, &expected_in_files(magnitude, expected));
}

/// Reports the number `x` at `path` unless it is positive in DATBOX; `expected` is such as `a length > 0 m`.
pub(crate) fn check_positive(report: &mut FaultReport, path: &str, x: f64, expected: &str) {
    require_in_files(report, is_positive(x), path, x, expected);
}

/// Adds every fault of `scene` to `report`.
pub fn check_scene(scene: &Scene, report: &mut FaultReport) {
    check_vector(report, "gravity", &scene.gravity, "m/s^2");
    check_names(report, "materials", scene.materials.iter().map(|material| &material.name));
    report.require(!scene.materials.is_empty(), "materials", "an empty list", "at least one");
    for (k, material) in scene.materials.iter().enumerate() {
        let path = format!("materials.{k}.density");
        check_positive(report, &path, material.density, "a density > 0 kg/m^3");
    }
    check_names(report, "laws", scene.laws.iter().map(|law| &law.name));
    report.require(!scene.laws.is_empty(), "laws", "an empty list", "at least one");
    for (k, law) in scene.laws.iter().enumerate() {
        check_law(report, &format!("laws.{k}"), law);
        check_given_packing(report, &format!("laws.{k}.bulk_strength"), law);
    }
    report.require(!scene.grains.is_empty(), "grains", "an empty list", "at least one group of grains");
    for (k, grains) in scene.grains.iter().enumerate() {
        let path = format!("grains.{k}");
        check_material_and_colour(scene, report, &path, &grains.material, &grains.colour);
        check_grains(report, &path, grains);
        let may_rotate = grains.is_single_body() || scene.compute.allows_rotation_about(&grains.spin);
        report.require(may_rotate, &format!("{path}.spin"), vector_text(&grains.spin), ROTATION_ABOUT_PERIOD);
    }
    for (k, wall) in scene.walls.iter().enumerate() {
        let path = format!("walls.{k}");
        check_material_and_colour(scene, report, &path, wall.material(), wall.colour());
        check_wall(report, &path, wall);
        check_radial(scene, wall, &format!("{path}.radial"), report);
    }
    check_contacts(scene, report);
    let is_some_free = scene.grains.is_empty() || scene.grains.iter().any(|grains| !grains.is_imposed());
    report.require(
        is_some_free,
        "grains",
        "none is free to move",
        "at least one group of grains whose motion is not all imposed",
    );
    scene.compute.check_in(report, "compute.");
    let expected = "radial of a hollow cylinder, of which cd-pre makes this option";
    report.require(scene.compute.radii.is_empty(), "compute.radii", "given in a scene", expected);
    if scene.compute.cell.is_some() {
        check_bodies_of_cell(scene, report);
    }
    if !scene.compute.impacts.is_simultaneous() {
        check_bodies_of_impacts(&scene.grains, &scene.walls, report);
    }
    check_rotating_frame(report, &scene.compute, partly_driven_paths(&scene.grains, &scene.walls));
    let is_used = |law: &&Law| scene.contacts.iter().any(|contact| contact.law.as_ref() == Some(&law.name));
    let laws: Vec<(&str, LawModel)> =
        scene.laws.iter().filter(is_used).map(|law| (law.name.as_str(), law.kind)).collect();
    check_laws_of_events(report, &scene.compute.events, &laws);
    check_moments(report, scene.compute.solver, &laws);
}

/// Reports walls and grains that are not free, in a scene whose cell deforms.
fn check_bodies_of_cell(scene: &Scene, report: &mut FaultReport) {
    let expected = "free grains without walls in a scene whose cell deforms";
    report.require(scene.walls.is_empty(), "walls", count_text(scene.walls.len(), "wall"), expected);
    for (k, grains) in scene.grains.iter().enumerate() {
        let is_driven = grains.driven.is_some() || grains.driven_spin.is_some();
        report.require(!is_driven, &format!("grains.{k}"), "imposed motion", expected);
    }
}

/// Reports bodies other than free spheres and bodies whose whole motion is imposed, in a scene with impacts in order.
pub(crate) fn check_bodies_of_impacts(grains: &[Grains], walls: &[SceneWall], report: &mut FaultReport) {
    let found = "neither free spheres nor bodies whose whole motion is imposed, with impacts: in_order";
    let expected = "impacts: simultaneous: the order of impacts is computed for spheres";
    for (k, grains) in grains.iter().enumerate() {
        let are_free_spheres = grains.are_spheres() && grains.imposed_components().iter().all(Option::is_none);
        report.require(are_free_spheres || grains.is_imposed(), &format!("grains.{k}"), found, expected);
    }
    for (k, wall) in walls.iter().enumerate() {
        let found = "a wall that moves by forces, with impacts: in_order";
        report.require(!wall.is_pushed(), &format!("walls.{k}"), found, expected);
    }
}

/// Reports laws in use, with their names, whose moments `solver` does not support.
pub(crate) fn check_moments(report: &mut FaultReport, solver: ContactSolver, laws: &[(&str, LawModel)]) {
    let has_moments = matches!(solver, ContactSolver::Auto | ContactSolver::Nlgs);
    for (name, law) in laws.iter().filter(|(_, law)| law.has_moments()) {
        let found = format!("{solver} with law '{name}', {}", law.label());
        report.require(has_moments, "compute.solver", found, "auto or nlgs");
    }
}

/// Paths of the motions of grains and walls that are imposed in some components only.
pub(crate) fn partly_driven_paths<'a>(
    grains: &'a [Grains],
    walls: &'a [SceneWall],
) -> impl Iterator<Item = String> + use<'a> {
    let is_partly_driven =
        |grains: &Grains| !grains.is_imposed() && (grains.driven.is_some() || grains.driven_spin.is_some());
    let driven_grains = (0..).zip(grains).filter(move |(_, grains)| is_partly_driven(grains));
    let pushed_walls = (0..).zip(walls).filter(move |(_, wall)| wall.is_pushed());
    let motion_field = |grains: &Grains| if grains.driven.is_some() { "driven" } else { "driven_spin" };
    let load_field = |wall: &SceneWall| match wall.hinge_moment() {
        Some(_) => "revolution",
        None if wall.has_force() => "force",
        None => "moment",
    };
    driven_grains
        .map(move |(k, grains)| format!("grains.{k}.{}", motion_field(grains)))
        .chain(pushed_walls.map(move |(k, wall)| format!("walls.{k}.{}", load_field(wall))))
}

/// Rejects bodies with partly imposed motion, given by their paths, in rotating axes.
pub(crate) fn check_rotating_frame(
    report: &mut FaultReport,
    options: &Compute,
    paths: impl IntoIterator<Item = String>,
) {
    let rotates =
        |field: &ExternalField| matches!(field, ExternalField::RotatingFrame { rate, .. } if *rate != [0.0; 3]);
    if options.fields.iter().any(rotates) {
        let expected = "motion imposed along all axes or none: Coriolis' force on such a body is not computed";
        paths.into_iter().for_each(|path| report.add_fault(&path, "driven in part in a rotating frame", expected));
    }
}

/// Reports events that change a law that is not in `laws` (the laws in use, with their names), or the cohesion of a law
/// without one.
pub(crate) fn check_laws_of_events(report: &mut FaultReport, events: &[Event], laws: &[(&str, LawModel)]) {
    for (k, event) in events.iter().enumerate() {
        let (EventAction::SetFriction(name, _) | EventAction::SetCohesion(name, _)) = &event.action else { continue };
        let path = format!("compute.events.{k}.action.0");
        match laws.iter().find(|(known, _)| known == name) {
            None => {
                let names: Vec<&str> = laws.iter().map(|(name, _)| *name).collect();
                let known = KnownNames { noun: "a law of contacts", names: &names };
                known.report_unknown(report, &path, format!("law '{name}' is not in use"), name);
            }
            Some((_, law)) => {
                let holds = law.has_settable_cohesion() || matches!(event.action, EventAction::SetFriction(..));
                report.require(holds, &path, format!("law '{name}' has no cohesion"), "a law with cohesion");
            }
        }
    }
}

/// Checks the names of a list: one to five printable ASCII characters each, without repetition.
pub(crate) fn check_names<'a>(report: &mut FaultReport, list: &str, names: impl Iterator<Item = &'a String>) {
    let mut known: HashSet<&str> = HashSet::new();
    for (k, name) in names.enumerate() {
        let path = format!("{list}.{k}.name");
        check_name_length(report, &path, name);
        if !known.insert(name) {
            report.add_fault(&path, format!("'{name}' occurs twice"), "a name of its own");
        }
    }
}

/// Rejects names of materials and colours that do not fit the files of LMGC90.
pub(crate) fn check_name_length(report: &mut FaultReport, path: &str, name: &str) {
    report.require(is_valid_name(name), path, format!("'{name}'"), "1 to 5 printable ASCII characters without blanks");
}

fn is_valid_name(name: &str) -> bool {
    (1..=5).contains(&name.len()) && name.bytes().all(|byte| byte.is_ascii_graphic())
}

/// Number of faults of a scene after which no nearest names are searched for: more faults than are printed.
const MAX_SUGGESTIONS: usize = 1000;

/// Names among which a scene refers to one.
pub(crate) struct KnownNames<'a> {
    /// Description of one of them, for messages: `a material`.
    pub noun: &'static str,
    pub names: &'a [&'a str],
}

impl KnownNames<'_> {
    /// Reports that `name`, the value at `path`, is none of these names.
    pub fn report_unknown(&self, report: &mut FaultReport, path: &str, found: String, name: &str) {
        let KnownNames { noun, names } = self;
        if report.faults.0.len() > MAX_SUGGESTIONS {
            return report.add_fault(path, found, format!("{noun} that is defined"));
        }
        let valid: Vec<&str> = names.iter().copied().filter(|name| is_valid_name(name)).collect();
        if names.is_empty() {
            report.add_fault(path, found, format!("{noun}: none is defined"));
        } else if valid.is_empty() {
            report.add_fault(path, found, format!("{noun}: none is defined under a valid name"));
        } else {
            report.add_unknown_name(path, found, name, &valid);
        }
    }
}

/// Checks the material and the colour of the object at `path`.
fn check_material_and_colour(scene: &Scene, report: &mut FaultReport, path: &str, material: &str, colour: &str) {
    let names: Vec<&str> = scene.materials.iter().map(|material| material.name.as_str()).collect();
    if !names.contains(&material) {
        let known = KnownNames { noun: "a material", names: &names };
        known.report_unknown(report, &format!("{path}.material"), format!("'{material}' is not defined"), material);
    }
    check_name_length(report, &format!("{path}.colour"), colour);
}

/// Reports the number `x` at `path` unless it satisfies `holds` and DATBOX can hold it.
fn check_value(report: &mut FaultReport, path: &str, x: f64, holds: bool, expected: &str) {
    if holds {
        require_in_files(report, fits_files(x), path, x, expected);
    } else {
        report.require_number(false, path, x, expected);
    }
}

/// Checks a condition on each number of a list or tuple at `path`.
fn check_each(report: &mut FaultReport, path: &str, numbers: &[f64], holds: impl Fn(f64) -> bool, expected: &str) {
    for (k, x) in numbers.iter().enumerate() {
        require_in_files(report, holds(*x), &format!("{path}.{k}"), *x, expected);
    }
}

/// Checks that the components are finite.
pub(crate) fn check_vector(report: &mut FaultReport, path: &str, vector: &[f64; 3], unit: &str) {
    check_each(report, path, vector, fits_files, &format!("a finite number ({unit})"));
}

/// Rejects laws with parameters out of their limits, and laws that scenes cannot have.
pub(crate) fn check_law(report: &mut FaultReport, path: &str, law: &Law) {
    check_bulk_strength(report, path, law);
    let (path, law) = (&format!("{path}.kind"), &law.kind);
    if is_law_of_points(law.label()) {
        let expected = "another law: it acts between points PT3Dx, which scenes do not have";
        report.add_fault(path, law.label(), expected);
    }
    for (parameter, x) in law.parameter_values() {
        let path = format!("{path}.{}", parameter.name());
        check_value(report, &path, x, parameter.accepts(x), &parameter.expected());
    }
    for fault in law.relation_faults() {
        report.add_fault(&format!("{path}.{}", fault.parameter.name()), fault.found, fault.expected);
    }
}

/// Checks the strength of the bulk of a law, and that the law has the cohesion that it gives.
fn check_bulk_strength(report: &mut FaultReport, path: &str, law: &Law) {
    let Some(bulk) = law.bulk_strength else { return };
    let Some(pair) = law.kind.pair_cohesion() else {
        let expected = "a law with cohesion of pairs, such as IQS_COH_DS_CLB, or no bulk_strength";
        return report.add_fault(&format!("{path}.bulk_strength"), law.kind.label(), expected);
    };
    let field_path = |name: &str| format!("{path}.bulk_strength.{name}");
    let holds = bulk.tension >= 0.0 && fits_files(bulk.tension);
    require_in_files(report, holds, &field_path("tension"), bulk.tension, "a stress >= 0 Pa");
    if let Some(nu) = bulk.nu {
        report.require_number(nu > 0.0 && nu <= 1.0, &field_path("nu"), nu, "a solid fraction > 0 and <= 1");
    }
    if let Some(z) = bulk.z {
        check_positive(report, &field_path("z"), z, "a coordination number > 0");
    }
    match (pair.strength, bulk.diameter) {
        (PairStrength::VanDerWaals { .. }, None) => {
            report.add_fault(&format!("{path}.bulk_strength"), "no diameter", "diameter: the strength depends on it");
        }
        (PairStrength::VanDerWaals { .. }, Some(diameter)) => {
            check_positive(report, &field_path("diameter"), diameter, "a diameter > 0 m");
        }
        (PairStrength::Stress(_), Some(diameter)) => {
            let found = report.number_text(&field_path("diameter"), diameter);
            report.add_fault(&field_path("diameter"), found, "no diameter: the strength does not depend on it");
        }
        (PairStrength::Stress(_), None) => {}
    }
    if pair.strength_parameter() != 0.0
        && let Some((parameter, value)) = law.kind.parameter_values().first()
    {
        let path = format!("{path}.kind.{}", parameter.name());
        let found = format!("{} together with a bulk_strength", report.number_text(&path, *value));
        report.add_fault(&path, found, "0: it follows from bulk_strength");
    }
}

/// Checks that the strength of the bulk of a law in a scene, at `path`, has its packing, which nobody has measured.
fn check_given_packing(report: &mut FaultReport, path: &str, law: &Law) {
    if law.bulk_strength.is_some_and(|bulk| bulk.nu.is_none() || bulk.z.is_none()) {
        let expected = "both in a scene: cd-pre from-outbox alone takes them from the snapshot with which a run begins";
        report.add_fault(path, "no nu or z", expected);
    }
}

/// Checks a group of grains, but for names.
pub(crate) fn check_grains(report: &mut FaultReport, path: &str, grains: &Grains) {
    check_shape(report, path, grains);
    match &grains.sizes {
        Some(sizes) => check_sizes(report, &format!("{path}.sizes"), sizes),
        None => {
            let has_own_size = grains.shape.has_own_size();
            let has_given_sizes =
                matches!(grains.placement, GrainPlacement::Fragments { .. } | GrainPlacement::File { .. });
            let expected =
                "sizes, or a shape with a size of its own (Box, Cylinder, Capsule, Vertices, Model, Clump, ClumpFile)";
            report.require(has_own_size || has_given_sizes, path, "no sizes", expected);
        }
    }
    check_placement(report, &format!("{path}.placement"), &grains.placement);
    check_amount(report, path, grains);
    for (name, vector, unit) in
        [("centre", &grains.centre, "m"), ("velocity", &grains.velocity, "m/s"), ("spin", &grains.spin, "rad/s")]
    {
        check_vector(report, &format!("{path}.{name}"), vector, unit);
    }
    check_rotation(report, &format!("{path}.orientation"), &grains.orientation);
    let thermal = grains.thermal_velocity;
    let thermal_path = format!("{path}.thermal_velocity");
    let holds = thermal >= 0.0 && fits_files(thermal);
    require_in_files(report, holds, &thermal_path, thermal, "a speed >= 0 m/s");
    if grains.orbit.is_some() {
        let is_free = grains.driven.is_none();
        let is_alone = is_free && grains.centre == [0.0; 3] && grains.velocity == [0.0; 3];
        let found = "the grains have a centre, a velocity or an imposed motion as well";
        report.require(is_alone, &format!("{path}.orbit"), found, "an orbit alone: it gives position and velocity");
    }
    if let Some(driven) = &grains.driven {
        check_evolutions(report, &format!("{path}.driven"), driven.iter().map(Option::as_ref), "m/s");
        let at_rest = grains.velocity == [0.0; 3] && grains.spin == [0.0; 3] && thermal == 0.0;
        report.require(
            at_rest,
            &format!("{path}.driven"),
            "the grains have a velocity, spin or thermal_velocity as well",
            "their motion imposed or initial, not both",
        );
    }
    if let Some(spin) = &grains.driven_spin {
        let path = format!("{path}.driven_spin");
        check_evolutions(report, &path, spin.iter().map(Option::as_ref), "rad/s");
        let at_rest = grains.driven.is_some() || grains.spin == [0.0; 3];
        report.require(at_rest, &path, "the grains have a spin as well", "their rotation imposed or initial, not both");
    }
}

/// Smallest and largest number of vertices or sides of a shape: a plane needs three, and the cost of a pair of polyhedra
/// grows with the square.
const CORNER_RANGE: std::ops::RangeInclusive<usize> = 3..=1000;

/// Whether the scene leaves orientation and size convention of polyhedra at their defaults.
fn has_default_orientation_and_radius(grains: &Grains) -> bool {
    grains.grain_orientation == GrainOrientations::default() && grains.radius == RadiusKind::default()
}

/// Checks the shape, and the orientation and size convention of its polyhedra.
fn check_shape(report: &mut FaultReport, path: &str, grains: &Grains) {
    let shape = format!("{path}.shape");
    match &grains.shape {
        &GrainShape::Random { vertices: (min, max), ratios, angularity } => {
            let fits = 4 <= min && min <= max && max <= *CORNER_RANGE.end();
            let expected = format!("4 to {}, the fewest first", CORNER_RANGE.end());
            report.require(fits, &format!("{shape}.vertices"), format!("{min} to {max}"), &expected);
            check_each(report, &format!("{shape}.ratios"), &ratios, is_positive, "a number > 0");
            let path = format!("{shape}.angularity");
            check_value(report, &path, angularity, (0.0..=1.0).contains(&angularity), "0 to 1");
        }
        GrainShape::Box { lengths } => {
            check_each(report, &format!("{shape}.lengths"), lengths, is_positive, "a length > 0 m");
        }
        &GrainShape::Cylinder { half_height: half_length, radius } | &GrainShape::Capsule { half_length, radius } => {
            let name = if grains.contactor() == "CYLND" { "half_height" } else { "half_length" };
            check_positive(report, &format!("{shape}.{name}"), half_length, "a length > 0 m");
            check_positive(report, &format!("{shape}.radius"), radius, "a radius > 0 m");
        }
        &GrainShape::Prism { sides, slenderness } => {
            let expected = format!("{} to {}", CORNER_RANGE.start(), CORNER_RANGE.end() / 2);
            let fits = (*CORNER_RANGE.start()..=CORNER_RANGE.end() / 2).contains(&sides);
            report.require(fits, &format!("{shape}.sides"), format!("{sides}"), &expected);
            check_positive(report, &format!("{shape}.slenderness"), slenderness, "a number > 0");
        }
        GrainShape::Vertices(vertices) => {
            for (k, vertex) in vertices.iter().enumerate() {
                check_vector(report, &format!("{shape}.0.{k}"), vertex, "m");
            }
            let fits = (4..=*CORNER_RANGE.end()).contains(&vertices.len());
            let expected = format!("4 to {}", CORNER_RANGE.end());
            report.require(fits, &shape, format!("{} vertices", vertices.len()), &expected);
        }
        GrainShape::Model { file: _, scale, contact_shape } => {
            check_scale(report, &shape, scale);
            if let &ContactSurface::Pieces { max_pieces, concavity, max_vertices } = contact_shape {
                let pieces = format!("{shape}.contact_shape");
                let path = format!("{pieces}.concavity");
                check_value(report, &path, concavity, (0.0..=1.0).contains(&concavity), "0 to 1");
                let expected = format!("1 to {MAX_PIECES}");
                report.require(
                    (1..=MAX_PIECES).contains(&max_pieces),
                    &format!("{pieces}.max_pieces"),
                    format!("{max_pieces}"),
                    &expected,
                );
                let expected = format!("8 to {}", CORNER_RANGE.end());
                let fits = (8..=*CORNER_RANGE.end()).contains(&max_vertices);
                report.require(fits, &format!("{pieces}.max_vertices"), format!("{max_vertices}"), &expected);
            }
            if let &ContactSurface::Balls { max_balls, max_error } = contact_shape {
                let balls = format!("{shape}.contact_shape");
                let path = format!("{balls}.max_error");
                let expected = format!("{} to {}", BALL_ERROR_RANGE.start(), BALL_ERROR_RANGE.end());
                check_value(report, &path, max_error, BALL_ERROR_RANGE.contains(&max_error), &expected);
                let fits = (2..=MAX_CLUMP_BALLS).contains(&max_balls);
                let expected = format!("2 to {MAX_CLUMP_BALLS}");
                report.require(fits, &format!("{balls}.max_balls"), format!("{max_balls}"), &expected);
            }
            if let ContactSurface::Files(files) = contact_shape {
                report.require(
                    !files.is_empty(),
                    &format!("{shape}.contact_shape"),
                    "no files of pieces",
                    "at least one",
                );
            }
        }
        GrainShape::Clump(balls) => check_clump(report, &shape, balls),
        GrainShape::ClumpFile { file: _, scale } => check_scale(report, &shape, scale),
        GrainShape::Sphere if !matches!(grains.placement, GrainPlacement::Fragments { .. }) => {
            report.require(
                has_default_orientation_and_radius(grains),
                path,
                "grain_orientation or radius given for spheres",
                "neither: they are for polyhedra, clumps, cylinders and capsules",
            );
        }
        GrainShape::Sphere
        | GrainShape::Tetrahedron
        | GrainShape::Cube
        | GrainShape::Octahedron
        | GrainShape::Dodecahedron
        | GrainShape::Icosahedron => {}
    }
    // The fault of spheres is reported above.
    let radius_has_sizes =
        grains.shape == GrainShape::Sphere || grains.sizes.is_some() || grains.radius == RadiusKind::default();
    report.require(radius_has_sizes, path, "radius given without sizes", "sizes, whose meaning it says");
    let orientation = format!("{path}.grain_orientation");
    match &grains.grain_orientation {
        GrainOrientations::Random => {}
        GrainOrientations::Same(turn) => check_rotation(report, &format!("{orientation}.0"), turn),
        GrainOrientations::List(turns) => {
            for (k, turn) in turns.iter().enumerate() {
                check_rotation(report, &format!("{orientation}.0.{k}"), turn);
            }
            let positions =
                if let GrainPlacement::List { positions, .. } = &grains.placement { positions.len() } else { 0 };
            let found = format!("{} rotations for {positions} listed positions", turns.len());
            report.require(turns.len() == positions, &orientation, found, "one for each listed position");
        }
    }
}

/// Range of the error of the balls of a model: points on the surface are too sparse for less;
/// with more a single ball covers most surfaces.
const BALL_ERROR_RANGE: std::ops::RangeInclusive<f64> = 0.02..=0.5;

/// Checks the balls of a clump.
fn check_clump(report: &mut FaultReport, path: &str, balls: &[[f64; 4]]) {
    let mut are_sound = true;
    for (k, ball) in balls.iter().enumerate() {
        let [x, y, z, radius] = *ball;
        check_vector(report, &format!("{path}.0.{k}"), &[x, y, z], "m");
        check_positive(report, &format!("{path}.0.{k}.3"), radius, "a radius > 0 m");
        are_sound &= is_positive(radius) && [x, y, z].into_iter().all(fits_files);
    }
    let balls: Vec<ClumpBall> = balls.iter().map(ClumpBall::from).collect();
    if are_sound && let Err(BallsError { found, expected }) = check_balls(&balls) {
        report.add_fault(path, found, expected);
    }
}

/// Largest number of convex pieces of a grain. The decomposition uses 64 voxels along a side: more pieces would be dust.
const MAX_PIECES: u32 = 1024;

/// Checks the size of a model; `path` is the path of the model in the scene.
fn check_scale(report: &mut FaultReport, path: &str, scale: &ModelScale) {
    let (name, x, expected) = match *scale {
        ModelScale::Factor(x) => ("Factor", x, "a number > 0"),
        ModelScale::Volume(x) => ("Volume", x, "a volume > 0 m^3"),
        ModelScale::Radius(x) => ("Radius", x, "a radius > 0 m"),
        ModelScale::Length(x) => ("Length", x, "a length > 0 m"),
    };
    let expected = expected_in_files(x, expected);
    let path = format!("{path}.scale");
    let found = report.number_text(&format!("{path}.0"), x);
    report.require(is_positive(x), &path, format!("{name} {found}"), &expected);
}

/// Checks a distribution of sizes.
fn check_sizes(report: &mut FaultReport, path: &str, sizes: &SizeDistribution) {
    if matches!(sizes, SizeDistribution::List(radii) if radii.is_empty()) {
        return report.add_fault(path, "an empty list", "at least one radius (m)");
    }
    let radii = match sizes {
        SizeDistribution::List(radii) => {
            (0..).zip(radii).map(|(k, &radius): (usize, _)| (format!("0.{k}"), radius)).collect()
        }
        SizeDistribution::Single(radius) => vec![("0".into(), *radius)],
        SizeDistribution::Uniform { min, max } => vec![("min".into(), *min), ("max".into(), *max)],
        SizeDistribution::PowerLaw { min, max, .. } => vec![("min".into(), *min), ("max".into(), *max)],
        SizeDistribution::LogNormal { median, min, max, .. } => {
            vec![("median".into(), *median), ("min".into(), *min), ("max".into(), *max)]
        }
    };
    for (name, radius) in &radii {
        check_positive(report, &format!("{path}.{name}"), *radius, "a radius > 0 m");
    }
    let (min, max) = sizes.radius_range();
    if min > max {
        let path = |name: &str| format!("{path}.{name}");
        let [min, max] = [("min", min), ("max", max)].map(|(name, x)| report.number_text(&path(name), x));
        return report.add_fault(&path("min"), format!("{min} is larger than max {max}"), "min <= max (m)");
    }
    match *sizes {
        SizeDistribution::PowerLaw { exponent, .. } => {
            check_value(report, &format!("{path}.exponent"), exponent, exponent > 0.0, "a number > 0");
        }
        SizeDistribution::LogNormal { median, sigma, .. } => {
            check_value(report, &format!("{path}.sigma"), sigma, sigma > 0.0, "a number > 0");
            let share = |r: f64| normal_share(libm::log(r / median) / sigma);
            // The difference of two shares near 1 then still has ten digits.
            if is_positive(sigma) && min < max && share(max) - share(min) < 1e-6 {
                let [min, max] = [min, max].map(number_text);
                let found = format!("min {min} and max {max} leave less than a millionth of the distribution");
                report.add_fault(path, found, "cut-offs about the median (m)");
            }
        }
        _ => {}
    }
}

/// Largest number of Lloyd relaxations. After that many, cells hardly change.
const MAX_RELAXATIONS: usize = 100;

/// Checks a placement, with its envelope.
fn check_placement(report: &mut FaultReport, path: &str, placement: &GrainPlacement) {
    let (envelope, jitter) = match placement {
        GrainPlacement::List { positions, .. } => {
            report.require(!positions.is_empty(), path, "an empty list", "at least one position (m)");
            for (k, position) in positions.iter().enumerate() {
                check_vector(report, &format!("{path}.positions.{k}"), position, "m");
            }
            return;
        }
        GrainPlacement::File { path: file, .. } => {
            return report.require(!file.is_empty(), &format!("{path}.path"), "no name", "the name of a file");
        }
        GrainPlacement::JitteredLattice { envelope, jitter } => (envelope, *jitter),
        GrainPlacement::RandomSequential { envelope } | GrainPlacement::DensePacking { envelope } => (envelope, 0.0),
        GrainPlacement::Fragments { envelope, relaxation } => {
            let expected = format!("0 to {MAX_RELAXATIONS}");
            let path = format!("{path}.relaxation");
            report.require(*relaxation <= MAX_RELAXATIONS, &path, format!("{relaxation}"), &expected);
            (envelope, 0.0)
        }
    };
    check_value(report, &format!("{path}.jitter"), jitter, (0.0..=1.0).contains(&jitter), "0 to 1");
    check_envelope(report, &format!("{path}.envelope"), envelope);
}

/// Checks the lengths of an envelope.
fn check_envelope(report: &mut FaultReport, path: &str, envelope: &Envelope) {
    let check_length = |report: &mut FaultReport, name: &str, length: f64| {
        check_positive(report, &format!("{path}.{name}"), length, "a length > 0 m");
    };
    let check_lengths = |report: &mut FaultReport, name: &str, lengths: &Option<[f64; 3]>| {
        let lengths = lengths.as_ref().map_or(&[][..], |lengths| lengths);
        check_each(report, &format!("{path}.{name}"), lengths, is_positive, "a length > 0 m");
    };
    match envelope {
        Envelope::Ball { radius } => radius.iter().for_each(|radius| check_length(report, "radius", *radius)),
        Envelope::Ellipsoid { semi_axes: lengths, ratios } | Envelope::Box { lengths, ratios } => {
            let name = if let Envelope::Ellipsoid { .. } = envelope { "semi_axes" } else { "lengths" };
            check_lengths(report, name, lengths);
            check_lengths(report, "ratios", ratios);
            let are_both_given = lengths.is_some() && ratios.is_some();
            report.require(!are_both_given, path, "both its size and ratios", "one of them");
        }
        Envelope::Cylinder { half_height, radius } => {
            check_length(report, "radius", *radius);
            check_length(report, "half_height", *half_height);
        }
        Envelope::Model { scale, .. } => scale.iter().for_each(|scale| check_scale(report, path, scale)),
    }
}

/// Largest number of fragments. The cost is quadratic: each fragment is compared with the seeds of all others.
const MAX_FRAGMENTS: usize = 20_000;

/// Checks number, solid fraction and size of the envelope: two determine the third.
fn check_amount(report: &mut FaultReport, path: &str, grains: &Grains) {
    if let Some(number) = grains.number {
        let fits = (1..=MAX_BODIES).contains(&number);
        let expected = format!("1 to {MAX_BODIES} grains");
        report.require(fits, &format!("{path}.number"), format!("{number}"), &expected);
    }
    if let Some(share) = grains.solid_fraction {
        let path = format!("{path}.solid_fraction");
        report.require_number(share > 0.0 && share < 1.0, &path, share, "more than 0 and less than 1");
    }
    let radius_count = match &grains.sizes {
        Some(SizeDistribution::List(radii)) => Some(radii.len()),
        _ => None,
    };
    if let GrainPlacement::List { positions, .. } = &grains.placement {
        let count = positions.len();
        if let Some(radius_count) = radius_count.filter(|radius_count| *radius_count != count) {
            let expected = format!("one for each of {count} positions");
            report.add_fault(&format!("{path}.sizes"), format!("{radius_count} radii"), expected);
        }
        if let Some(number) = grains.number.filter(|number| *number != count) {
            let found = format!("{number} for {count} positions");
            report.add_fault(&format!("{path}.number"), found, "their number, or none");
        }
        let has_no_fraction = grains.solid_fraction.is_none();
        report.require(has_no_fraction, &format!("{path}.solid_fraction"), "given for listed positions", "none");
        return;
    }
    if let GrainPlacement::File { .. } = grains.placement {
        let holds = grains.are_spheres() && grains.number.is_none() && grains.solid_fraction.is_none();
        let found = "shape, number or solid_fraction given for the spheres of a file";
        return report.require(holds, path, found, "none of them: the file has them");
    }
    if let (Some(count), Some(number)) = (radius_count, grains.number)
        && count != number
    {
        report.add_fault(
            &format!("{path}.number"),
            format!("{number} for {count} listed radii"),
            "their number, or none",
        );
    }
    let has_envelope_size = grains.placement.envelope().is_none_or(Envelope::has_size);
    if let GrainPlacement::Fragments { .. } = grains.placement {
        let has_default_shape = grains.shape == GrainShape::Sphere && has_default_orientation_and_radius(grains);
        let holds = has_default_shape && grains.sizes.is_none() && grains.solid_fraction.is_none();
        let found = "shape, grain_orientation, radius, sizes or solid_fraction given for fragments";
        report.require(holds, path, found, "none of them: fragments fill the envelope");
        let has_number = grains.number.is_some_and(|number| number <= MAX_FRAGMENTS);
        let expected = format!("both, and at most {MAX_FRAGMENTS} fragments");
        report.require(
            has_number && has_envelope_size,
            path,
            "fragments without number or size of the envelope, or too many",
            &expected,
        );
        return;
    }
    let amounts = [
        (grains.number.is_some() || radius_count.is_some(), "number"),
        (grains.solid_fraction.is_some(), "solid_fraction"),
        (has_envelope_size, "size of the envelope"),
    ];
    let names: Vec<&str> = amounts.iter().filter(|(is_given, _)| *is_given).map(|(_, name)| *name).collect();
    if names.len() != 2 {
        let found = if names.is_empty() { "nothing".to_string() } else { names.join(", ") };
        report.add_fault(
            path,
            format!("{found} given"),
            "exactly two of number, solid_fraction and size of the envelope",
        );
    }
}

/// Rejects rotations without a finite axis and angle.
pub(crate) fn check_rotation(report: &mut FaultReport, path: &str, rotation: &Rotation) {
    check_direction(report, path, "axis", &rotation.axis);
    let angle = rotation.angle;
    require_in_files(report, fits_files(angle), &format!("{path}.angle"), angle, "a finite angle (rad)");
}

/// Checks the direction `name` of the value at `path`, a vector of any length but 0.
fn check_direction(report: &mut FaultReport, path: &str, name: &str, vector: &[f64; 3]) {
    let length = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    report.require(
        is_positive(length),
        &format!("{path}.{name}"),
        vector_text(vector),
        "a finite vector that is not 0",
    );
}

/// Checks a wall, but for names. Patterns without `..`, so that the compiler requires each field.
pub(crate) fn check_wall(report: &mut FaultReport, path: &str, wall: &SceneWall) {
    match wall {
        SceneWall::Cylinder {
            material: _,
            colour: _,
            centre,
            axis,
            half_height,
            radius,
            hollow,
            velocity,
            force,
            spin,
            moment,
            pressure,
            strain_rate,
            revolution,
            surface_spin,
            radial: _,
            ends,
        } => {
            check_vector(report, &format!("{path}.centre"), centre, "m");
            check_direction(report, path, "axis", axis);
            let is_still = is_zero(spin) && velocity.iter().all(is_zero) && strain_rate.is_none() && !wall.has_load();
            check_revolution(report, path, revolution.as_deref(), is_still);
            check_cylinder_hinge(report, path, wall);
            check_evolution(report, &format!("{path}.surface_spin"), surface_spin, "rad/s");
            let is_free = |k: usize| is_zero(&velocity[k]) && force[k].is_none() && revolution.is_none();
            check_along_axis(report, &format!("{path}.pressure"), pressure.as_deref(), ("Pa", axis), is_free);
            let is_free = |k: usize| is_free(k) && pressure.is_none();
            check_along_axis(report, &format!("{path}.strain_rate"), strain_rate.as_deref(), ("1/s", axis), is_free);
            let servos = [("pressure", pressure, "the pressure"), ("strain_rate", strain_rate, "the strain rate")];
            for (name, servo, noun) in servos {
                let expected =
                    format!("a solid one: {noun} is that of its end; radial controls the radius of a hollow one");
                let is_solid = servo.is_none() || !hollow;
                report.require(is_solid, &format!("{path}.{name}"), "of a hollow cylinder", &expected);
            }
            if let Some(ends) = ends {
                let end_path = format!("{path}.ends");
                check_evolution(report, &format!("{end_path}.spin"), &ends.spin, "rad/s");
                report.require(*hollow, &end_path, "of a solid cylinder", "a hollow one");
                let is_still = revolution.is_none() && !wall.has_force();
                report.require(
                    is_still,
                    &end_path,
                    "a cylinder that its ends cannot follow",
                    "no force and no revolution",
                );
            }
            for (name, length) in [("half_height", half_height), ("radius", radius)] {
                check_positive(report, &format!("{path}.{name}"), *length, "a length > 0 m");
            }
            check_velocity_or_force(report, path, velocity, force);
            check_evolution(report, &format!("{path}.spin"), spin, "rad/s");
            moment.iter().for_each(|moment| check_evolution(report, &format!("{path}.moment"), moment, "N m"));
            let found = format!("{}, and a moment about the axis", report.shown_text(&format!("{path}.spin")));
            let is_one_given = moment.is_none() || is_zero(spin);
            report.require(is_one_given, &format!("{path}.spin"), found, "one of the two");
        }
        SceneWall::Plate {
            material: _,
            colour: _,
            centre,
            normal,
            first_axis,
            half_lengths,
            velocity,
            force,
            spin,
            moment,
            pressure,
            strain_rate,
            revolution,
            surface_velocity,
        } => {
            check_vector(report, &format!("{path}.centre"), centre, "m");
            check_direction(report, path, "normal", normal);
            let is_still = velocity.iter().chain(spin).all(is_zero) && strain_rate.is_none() && !wall.has_load();
            check_revolution(report, path, revolution.as_deref(), is_still);
            check_evolutions(report, &format!("{path}.surface_velocity"), surface_velocity.iter(), "m/s");
            let tilts = !spin[..2].iter().all(is_zero) || moment[..2].iter().any(Option::is_some);
            let is_free = |k: usize| is_zero(&velocity[k]) && force[k].is_none() && revolution.is_none() && !tilts;
            check_along_axis(report, &format!("{path}.pressure"), pressure.as_deref(), ("Pa", normal), is_free);
            let is_free = |k: usize| is_free(k) && pressure.is_none();
            check_along_axis(report, &format!("{path}.strain_rate"), strain_rate.as_deref(), ("1/s", normal), is_free);
            if let Some(first) = first_axis {
                check_direction(report, path, "first_axis", first);
                let (first, normal) = (Vector3::from(*first), Vector3::from(*normal));
                // For axes closer to parallel, round-off decides the direction.
                let are_parallel = first.cross(&normal).norm() <= 1e-6 * first.norm() * normal.norm();
                let path = format!("{path}.first_axis");
                report.require(!are_parallel, &path, "parallel to normal", "two different directions");
            }
            check_each(report, &format!("{path}.half_lengths"), half_lengths, is_positive, "a length > 0 m");
            check_velocity_or_force(report, path, velocity, force);
            check_evolutions(report, &format!("{path}.spin"), spin, "rad/s");
            check_evolutions(report, &format!("{path}.moment"), moment.iter().map(Option::as_ref), "N m");
            for (k, spin) in spin.iter().enumerate().filter(|(k, _)| moment[*k].is_some()) {
                let path = format!("{path}.spin.{k}");
                let found = format!("{}, and a moment about the same axis", report.shown_text(&path));
                report.require(*spin == TimeFunction::default(), &path, found, "one of the two");
            }
        }
        SceneWall::Box { material: _, colour: _, centre, lengths, orientation, half_thickness, lid: _, velocity } => {
            check_vector(report, &format!("{path}.centre"), centre, "m");
            check_each(report, &format!("{path}.lengths"), lengths, is_positive, "a length > 0 m");
            check_rotation(report, &format!("{path}.orientation"), orientation);
            check_positive(report, &format!("{path}.half_thickness"), *half_thickness, "a length > 0 m");
            check_evolutions(report, &format!("{path}.velocity"), velocity, "m/s");
        }
        SceneWall::Mesh {
            material: _,
            colour: _,
            file: _,
            scale,
            position,
            orientation,
            side: _,
            velocity,
            spin,
            revolution,
            surface_velocity,
        } => {
            let is_still = velocity.iter().chain(spin).all(is_zero);
            check_revolution(report, path, revolution.as_deref(), is_still);
            let is_hinged = revolution.as_ref().is_some_and(|revolution| revolution.moment.is_some());
            let expected = "a rate: the motion of a surface is imposed";
            report.require(!is_hinged, &format!("{path}.revolution.moment"), "of a Mesh", expected);
            check_evolutions(report, &format!("{path}.surface_velocity"), surface_velocity.iter(), "m/s");
            check_positive(report, &format!("{path}.scale"), *scale, "a factor > 0");
            check_vector(report, &format!("{path}.position"), position, "m");
            check_rotation(report, &format!("{path}.orientation"), orientation);
            check_evolutions(report, &format!("{path}.velocity"), velocity, "m/s");
            check_evolutions(report, &format!("{path}.spin"), spin, "rad/s");
        }
    }
}

/// Whether a function is the default, 0.
fn is_zero(function: &TimeFunction) -> bool {
    *function == TimeFunction::default()
}

/// Checks a rotation about an axis; `is_still`: whether nothing else moves the wall.
fn check_revolution(report: &mut FaultReport, path: &str, revolution: Option<&Revolution>, is_still: bool) {
    let Some(Revolution { axis, point, rate, moment }) = revolution else { return };
    let path = format!("{path}.revolution");
    check_direction(report, &path, "axis", axis);
    check_vector(report, &format!("{path}.point"), point, "m");
    rate.iter().for_each(|rate| check_evolution(report, &format!("{path}.rate"), rate, "rad/s"));
    moment.iter().for_each(|moment| check_evolution(report, &format!("{path}.moment"), moment, "N m"));
    let found = if rate.is_some() { "a rate and a moment" } else { "neither a rate nor a moment" };
    report.require(rate.is_some() != moment.is_some(), &path, found, "one of the two");
    report.require(is_still, &path, "a wall that also moves otherwise", "no other velocity, spin, force or moment");
}

/// Checks a cylinder that turns freely about an axis elsewhere.
fn check_cylinder_hinge(report: &mut FaultReport, path: &str, wall: &SceneWall) {
    let SceneWall::Cylinder { hollow, surface_spin, .. } = wall else { return };
    if wall.hinge_moment().is_none() {
        return;
    }
    let path = format!("{path}.revolution.moment");
    report.require(!hollow, &path, "of a hollow cylinder", "a solid one, or a rate");
    let expected = "a rate, or no surface_spin: a wall that turns freely has other axes";
    report.require(is_zero(surface_spin), &path, "of a cylinder with a surface_spin", expected);
}

/// Component of a normal across the fixed axis of a servo up to which it is along that: rounding of directions written
/// by hand, equal to `AXIS_ROUNDING` of cd-solve.
const MAX_SERVO_TILT: f64 = 1e-6;

/// Checks a servo along `direction`, a normal or axis. `is_free`: whether nothing else moves the wall along this fixed axis, or
/// turns its normal.
fn check_along_axis(
    report: &mut FaultReport,
    path: &str,
    servo: Option<&TimeFunction>,
    (unit, direction): (&str, &[f64; 3]),
    is_free: impl Fn(usize) -> bool,
) {
    let Some(function) = servo else { return };
    check_evolution(report, path, function, unit);
    let normal = Vector3::from(*direction).normalize();
    let component = normal.iamax();
    let is_along = (0..3).all(|k| k == component || normal[k].abs() <= MAX_SERVO_TILT);
    report.require(is_along, path, "along an oblique direction", "a wall whose normal or axis is along x, y or z");
    let expected = "no other motion or load along the axis, and none that tilts the wall";
    report.require(!is_along || is_free(component), path, "a wall that also moves otherwise", expected);
}

/// Checks that each axis has a velocity or a force, not both.
fn check_velocity_or_force(
    report: &mut FaultReport,
    path: &str,
    velocity: &[TimeFunction; 3],
    force: &[Option<TimeFunction>; 3],
) {
    check_evolutions(report, &format!("{path}.velocity"), velocity, "m/s");
    check_evolutions(report, &format!("{path}.force"), force.iter().map(Option::as_ref), "N");
    for (k, velocity) in velocity.iter().enumerate().filter(|(k, _)| force[*k].is_some()) {
        let path = format!("{path}.velocity.{k}");
        let found = format!("{}, and a force along the same axis", report.shown_text(&path));
        report.require(*velocity == TimeFunction::default(), &path, found, "one of the two");
    }
}

/// Rejects functions of time as [`check_evolution`] does.
pub(crate) fn check_evolutions<'a>(
    report: &mut FaultReport,
    path: &str,
    evolutions: impl IntoIterator<Item = impl Into<Option<&'a TimeFunction>>>,
    unit: &str,
) {
    for (k, evolution) in evolutions.into_iter().enumerate() {
        if let Some(evolution) = evolution.into() {
            check_evolution(report, &format!("{path}.{k}"), evolution, unit);
        }
    }
}

/// Rejects a function of time with values (in `unit`) that files cannot hold, a table that does not rise in time, and a
/// ramp without effect.
fn check_evolution(report: &mut FaultReport, path: &str, evolution: &TimeFunction, unit: &str) {
    let values = match evolution {
        TimeFunction::Constant(value) => vec![*value],
        &TimeFunction::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate } => {
            let start = ramp_start.unwrap_or(0.0);
            let has_no_effect = ramp_rate > 0.0 && start >= 1.0;
            let [start_text, rate_text] = [start, ramp_rate].map(number_text);
            let found = format!("ramp_start {start_text} and ramp_rate {rate_text}, a factor of 1 at all times");
            report.require(!has_no_effect, path, found, "a start below 1, or no ramp");
            vec![constant, amplitude, omega, phase, start, ramp_rate]
        }
        TimeFunction::Table(points) => {
            let found = count_text(points.len(), "point");
            report.require(points.len() >= 2, path, found, "at least two points, their times rising (s)");
            let is_not_later = |k: &usize| points[*k].0.partial_cmp(&points[k - 1].0) != Some(Ordering::Greater);
            if let Some(k) = (1..points.len()).find(is_not_later) {
                let [time, before] = [points[k].0, points[k - 1].0].map(number_text);
                let found = format!("the time {time} of point {} after {before}", k + 1);
                report.add_fault(path, found, "times that rise from point to point (s)");
            }
            points.iter().flat_map(|&(t, v)| [t, v]).collect()
        }
    };
    if let Some(wrong) = values.into_iter().find(|value| !fits_files(*value)) {
        let found = report.shown_text(path);
        let magnitude = if wrong.is_infinite() && !found.contains("inf") { f64::MAX } else { wrong };
        report.add_fault(path, found, expected_in_files(magnitude, &format!("finite numbers ({unit})")));
    }
}

/// Sorts names and removes repetitions.
fn sorted_and_distinct<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut names: Vec<&str> = names.collect();
    names.sort_unstable();
    names.dedup();
    names
}

/// Expected value instead of a law between walls.
pub(crate) const NO_WALL_LAW: &str = "no law: walls touch each other only if one has a force or moment, and one is a solid \
                                      Cylinder, the other a Plate, Box or solid Cylinder";

/// Expected value instead of a law between bodies that contacts cannot push.
pub(crate) const NO_IMPOSED_LAW: &str =
    "no law: bodies whose motion is all imposed (of spheres: their translation) do not meet";

/// Whether cd-solve computes contacts between walls with these contactors.
pub(crate) fn is_computed_wall_pair(kinds: [&str; 2]) -> bool {
    kinds.contains(&"CYLND") && kinds.iter().all(|kind| ["CYLND", "PLANx"].contains(kind))
}

/// Whether contacts can push no body of a colour.
fn is_imposed(scene: &Scene, colour: &str) -> bool {
    let mut grains = scene.grains.iter().filter(|grains| grains.colour == colour);
    let mut walls = scene.walls.iter().filter(|wall| wall.colour() == colour);
    !grains.any(Grains::can_be_pushed) && !walls.any(SceneWall::is_pushed)
}

/// Whether some wall of the colour `a` can touch another one of the colour `b`.
fn walls_meet(walls: &[SceneWall], a: &str, b: &str) -> bool {
    let touch = |(j, one): (usize, &SceneWall)| {
        let mut others = walls.iter().enumerate().filter(|(k, wall)| *k != j && wall.colour() == b);
        one.colour() == a && others.any(|(_, other)| one.can_touch(other))
    };
    walls.iter().enumerate().any(touch)
}

/// Checks the rows of `contacts`, and that each two colours that can meet have one.
fn check_contacts(scene: &Scene, report: &mut FaultReport) {
    let grain_colours = sorted_and_distinct(scene.grains.iter().map(|grains| grains.colour.as_str()));
    let wall_colours = sorted_and_distinct(scene.walls.iter().map(SceneWall::colour));
    let all_colours = sorted_and_distinct(grain_colours.iter().chain(&wall_colours).copied());
    let sorted_pair = |a: &str, b: &str| [a.min(b).to_string(), a.max(b).to_string()];
    let mut known_pairs = HashSet::new();
    // Laws by their names; of several with one name, which is a fault, the first.
    let laws: HashMap<&str, &Law> = scene.laws.iter().rev().map(|law| (law.name.as_str(), law)).collect();
    let law_names: Vec<&str> = scene.laws.iter().map(|law| law.name.as_str()).collect();
    for (k, contact) in scene.contacts.iter().enumerate() {
        let path = format!("contacts.{k}");
        let (a, b) = &contact.between;
        for (side, colour) in [a].into_iter().chain((a != b).then_some(b)).enumerate() {
            if all_colours.binary_search(&colour.as_str()).is_err() {
                let path = format!("{path}.between.{side}");
                let found = format!("no grains and no wall have the colour '{colour}'");
                let known = KnownNames { noun: "a body of this colour", names: &all_colours };
                known.report_unknown(report, &path, found, colour);
            }
        }
        let found = format!("'{a}' and '{b}' are listed twice");
        let is_new = known_pairs.insert(sorted_pair(a, b));
        report.require(is_new, &format!("{path}.between"), found, "each pair once");
        let law = contact.law.as_ref().map(|name| (name, laws.get(name.as_str())));
        if let Some((name, None)) = law {
            let known = KnownNames { noun: "a law", names: &law_names };
            known.report_unknown(report, &format!("{path}.law"), format!("'{name}' is not defined"), name);
        }
        let is_of_walls =
            |colour: &String| wall_colours.contains(&&colour[..]) && !grain_colours.contains(&&colour[..]);
        let is_wall_law = contact.law.is_some() && is_of_walls(a) && is_of_walls(b) && !walls_meet(&scene.walls, a, b);
        report.require(!is_wall_law, &path, format!("a law between the walls '{a}' and '{b}'"), NO_WALL_LAW);
        let exist = [a, b].iter().all(|colour| all_colours.contains(&colour.as_str()));
        let are_imposed = exist && is_imposed(scene, a) && is_imposed(scene, b);
        // A scene in which nothing is free has another fault.
        let is_some_free = scene.grains.iter().any(|grains| !grains.is_imposed());
        let is_idle = contact.law.is_some() && are_imposed && !is_wall_law && is_some_free;
        report.require(!is_idle, &path, format!("a law between '{a}' and '{b}'"), NO_IMPOSED_LAW);
        if let Some(alert) = contact.alert {
            let path = format!("{path}.alert");
            report.require(contact.law.is_some(), &path, "alert without a law", "no alert, or a law");
            check_positive(report, &path, alert, "a distance > 0 m");
            if let Some((name, Some(law))) = law
                && is_positive(alert)
                && alert < law.kind.attraction_range()
            {
                let range = number_text(law.kind.attraction_range());
                let found = format!("{} is less than the range {range} of law '{name}'", number_text(alert));
                report.add_fault(&path, found, "at least the range (m), for beyond alert no law acts");
            }
        }
    }
    // A single body does not collide with itself, even if it has several pieces.
    let has_single_body = |colour: &str| {
        let mut grains = scene.grains.iter().filter(|grains| grains.colour == colour);
        let begins_with_single = grains.next().is_some_and(Grains::is_single_body);
        begins_with_single && grains.next().is_none()
    };
    for (k, a) in grain_colours.iter().enumerate() {
        let further_walls = wall_colours.iter().filter(|colour| !grain_colours[..k].contains(colour));
        for b in grain_colours[k..].iter().chain(further_walls) {
            let is_single = a == b && has_single_body(a) && !wall_colours.contains(a);
            let are_imposed = is_imposed(scene, a) && is_imposed(scene, b);
            if !(known_pairs.contains(&sorted_pair(a, b)) || is_single || are_imposed) {
                known_pairs.insert(sorted_pair(a, b));
                report.add_fault(
                    "contacts",
                    format!("no law between '{a}' and '{b}'"),
                    "one for each pair that can meet (law: None for none)",
                );
            }
        }
    }
}

impl SceneWall {
    /// Name of the material.
    pub fn material(&self) -> &str {
        match self {
            SceneWall::Plate { material, .. }
            | SceneWall::Box { material, .. }
            | SceneWall::Cylinder { material, .. }
            | SceneWall::Mesh { material, .. } => material,
        }
    }

    /// Name of the colour.
    pub fn colour(&self) -> &str {
        match self {
            SceneWall::Plate { colour, .. }
            | SceneWall::Box { colour, .. }
            | SceneWall::Cylinder { colour, .. }
            | SceneWall::Mesh { colour, .. } => colour,
        }
    }

    /// Whether a force or pressure acts on the wall along some axis.
    pub fn has_force(&self) -> bool {
        match self {
            SceneWall::Plate { force, pressure, .. } | SceneWall::Cylinder { force, pressure, .. } => {
                pressure.is_some() || force.iter().any(Option::is_some)
            }
            SceneWall::Box { .. } | SceneWall::Mesh { .. } => false,
        }
    }

    /// Moment about the axis about which the wall turns freely, if it has a revolution under a moment.
    pub fn hinge_moment(&self) -> Option<&TimeFunction> {
        let (SceneWall::Plate { revolution, .. }
        | SceneWall::Cylinder { revolution, .. }
        | SceneWall::Mesh { revolution, .. }) = self
        else {
            return None;
        };
        revolution.as_ref()?.moment.as_ref()
    }

    /// Whether a force or moment acts on the wall, so that not all of its motion is imposed.
    pub fn is_pushed(&self) -> bool {
        self.has_load() || self.hinge_moment().is_some()
    }

    /// Whether a force or moment other than that of a revolution acts on the wall.
    pub(crate) fn has_load(&self) -> bool {
        let has_moment = match self {
            SceneWall::Plate { moment, .. } => moment.iter().any(Option::is_some),
            SceneWall::Cylinder { moment, .. } => moment.is_some(),
            SceneWall::Box { .. } | SceneWall::Mesh { .. } => false,
        };
        has_moment || self.has_force()
    }

    /// Whether contacts with another wall are computed: one of the two moves by forces, and one is a solid cylinder. Two
    /// plates have none in LMGC90, and a hollow cylinder has contacts with grains alone.
    pub fn can_touch(&self, other: &SceneWall) -> bool {
        let kinds = [self.contactor(), other.contactor()];
        (self.is_pushed() || other.is_pushed()) && is_computed_wall_pair(kinds)
    }

    /// Name of its contactor in the files.
    pub fn contactor(&self) -> &'static str {
        match self {
            SceneWall::Plate { .. } | SceneWall::Box { .. } => "PLANx",
            SceneWall::Cylinder { hollow: false, .. } => "CYLND",
            SceneWall::Cylinder { hollow: true, .. } => "DNLYC",
            SceneWall::Mesh { .. } => "MESHx",
        }
    }
}
