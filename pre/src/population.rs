//! Makes the bodies of a scene, grains and walls with their initial motion, and checks that they do not overlap and that the
//! files can hold their numbers.

use std::ops::ControlFlow;
use std::path::Path;

use cd_formats::bodies::ShapeRecord;
use cd_formats::compute::{Compute, PERIOD_NAMES};
use cd_formats::geometry::plates::opposite_extent;
use cd_formats::names::{number_text, rounded_number};
use cd_formats::report::{FaultReport, MAX_MAGNITUDE};
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::grain::{Grain, Population};
use crate::overlaps::{Obstacles, ShapedGrain, TOUCHING_TOLERANCE};
use crate::particles::{self, ParticleState};
use crate::placement::cells::SphereGrid;
use crate::placement::{self, PlacedGrains, PlacementInput};
use crate::random::{RandomStream, StreamPurpose};
use crate::scene::{GrainPlacement, Grains, Scene, TimeFunction};
use crate::shapes::read::report_file_faults;
use crate::shapes::{GrainSampler, SampledGrain, ShapeError};
use crate::sizes::MAX_BODIES;
use crate::sphere::sphere_volume;
use crate::walls::WallBody;
use crate::{check, motion, orbits, walls, write};

/// Largest number of overlaps that are reported one by one.
const MAX_REPORTED_OVERLAPS: usize = 5;

/// Number of overlaps after which no more are searched for: the overlaps of n grains at one point would be n²/2.
const MAX_SEARCHED_OVERLAPS: usize = 1000;

/// Number of near grains of a grain that are compared with it first: all are, if it overlaps none of these.
const MAX_FIRST_NEIGHBOURS: usize = 100;

/// Number of grains whose neighbours are searched for at a time. Chosen: enough for all threads.
const SEARCHED_GRAINS: usize = 4096;

/// Makes the bodies of a (checked) scene. Grains that do not fit and bodies that overlap go into the report.
///
/// Paths of files are relative to `folder`.
pub fn populate(scene: &Scene, folder: &Path, report: &mut FaultReport) -> Population {
    let walls = walls::wall_bodies(&scene.walls, folder, report);
    let mut population = Population { grains: Vec::new(), walls, regions: Vec::new(), file_summaries: Vec::new() };
    let periods = scene.compute.periods();
    let shifts = periodic_shifts(periods);
    for (group, grains) in scene.grains.iter().enumerate() {
        let shapes = GrainSampler::from_grains(grains, folder, scene.seed, group);
        let shapes = shapes.map_err(|error| match error {
            ShapeError::File(faults) => report_file_faults(faults, &format!("grains.{group}.shape"), report),
            ShapeError::Shape(misfit) => {
                report.add_fault(&format!("grains.{group}.shape"), misfit.to_string(), "a non-degenerate convex solid");
            }
        });
        let region = grains.placement.envelope().map(|envelope| envelope.to_region(folder)).transpose();
        let region = region.map_err(|faults| report_file_faults(faults, &format!("grains.{group}.placement"), report));
        let particles = file_particles(scene, group, folder, report);
        let (Ok(mut shapes), Ok(region), Some((particles, particle_summary))) = (shapes, region, particles) else {
            continue;
        };
        let (region, file_summary) = region.map_or((None, String::new()), |(region, summary)| (Some(region), summary));
        // A group on an orbit gets its position later.
        let may_overlap = |grain: &&Grain| scene.grains[grain.group].placement.allows_overlap();
        let fixed: Vec<&Grain> = population.grains.iter().filter(|grain| !may_overlap(grain)).collect();
        let obstacles = grains
            .orbit
            .is_none()
            .then(|| Obstacles::new(fixed, &population.walls, &scene.compute, &shifts))
            .filter(|obstacles| !obstacles.is_empty());
        let input = PlacementInput { region, particles, periods, obstacles };
        match placement::place_grains(grains, &mut shapes, input, scene.seed, group) {
            Ok(placed) => {
                let is_single = placed.grains.len() == 1 && grains.thermal_velocity > 0.0;
                let expected = "several grains, or 0: a single grain has no motion about the mean";
                report.require(
                    !is_single,
                    &format!("grains.{group}.thermal_velocity"),
                    "given for one grain",
                    expected,
                );
                let summaries = [shapes.file_summary(), &file_summary, &particle_summary]
                    .into_iter()
                    .filter(|summary| !summary.is_empty());
                population.file_summaries.push(summaries.collect::<Vec<_>>().join(", "));
                population.regions.push(placed.region.clone());
                let mut moving = grains_in_motion(scene, group, grains, placed);
                orbits::place_on_orbit(scene, folder, group, &mut moving, &population.grains, report);
                population.grains.extend(moving);
            }
            Err(misfit) => report.add_fault(&format!("grains.{group}.placement"), misfit.found, misfit.expected),
        }
    }
    let bodies = population.grains.len() + population.walls.len();
    report.require(bodies <= MAX_BODIES, "grains", format!("{bodies} bodies"), &format!("at most {MAX_BODIES}"));
    (0..3).for_each(|axis| check_extent_along(&scene.compute, axis, &population.grains, report));
    check_numbers(scene, &population, report);
    check_inclined_plates(scene, &population, report);
    if report.faults.0.is_empty() {
        check_overlaps(scene, &population, report);
    }
    if report.faults.0.is_empty() {
        check_drums(scene, &population, report);
    }
    population
}

/// Particles of the placement `File` of a group, none for other placements, and a note on them; `None` after a fault, which
/// goes into the report.
fn file_particles(
    scene: &Scene,
    group: usize,
    folder: &Path,
    report: &mut FaultReport,
) -> Option<(Option<ParticleState>, String)> {
    let grains = &scene.grains[group];
    let GrainPlacement::File { path, format, .. } = &grains.placement else { return Some((None, String::new())) };
    let read = particles::read_particles(&folder.join(path), *format);
    let particles =
        read.map_err(|faults| report_file_faults(faults, &format!("grains.{group}.placement.path"), report)).ok()?;
    let has_motion = particles.velocities.is_some() || particles.spins.is_some();
    if has_motion && (grains.driven.is_some() || grains.driven_spin.is_some()) {
        let found = format!("{path} has velocities, and the motion is imposed as well");
        report.add_fault(&format!("grains.{group}.placement"), found, "a file without velocities, or free grains");
        return None;
    }
    let mut note = [path.as_str(), particles.part.as_str()].join(" ").trim_end().to_string();
    let density = scene.materials.iter().find(|m| m.name == grains.material).map_or(1.0, |m| m.density);
    if let Some(difference) = particles.mass_difference(density) {
        note += &format!(": masses are those of the density {density} kg/m^3; those of the file differ by up to");
        note += &format!(" {:.2} %", 100.0 * difference);
    }
    Some((Some(particles), note))
}

/// Checks hollow cylinders, which push inwards only: bodies that touch one must be inside.
fn check_drums(scene: &Scene, population: &Population, report: &mut FaultReport) {
    for drum in &population.walls {
        if !matches!(drum.shape, ShapeRecord::Cylinder { hollow: true, .. }) {
            continue;
        }
        let has_law = |colour: &str| {
            scene.contacts.iter().any(|contact| {
                let (a, b) = (contact.between.0.as_str(), contact.between.1.as_str());
                contact.law.is_some() && ((a, b) == (colour, &drum.colour) || (b, a) == (colour, &drum.colour))
            })
        };
        let outside = population.grains.iter().enumerate().find(|(_, grain)| {
            let local = drum.axes * (grain.position - drum.centre);
            let group = &scene.grains[grain.group];
            drum.shape.is_outside_hollow(local.into()) && group.driven.is_none() && has_law(&group.colour)
        });
        if let Some((k, grain)) = outside {
            let found = format!("body {} is outside of wall {}, a hollow cylinder", k + 1, drum.wall + 1);
            let expected = "grains that can touch it inside: it is closed and has contacts on its inside only";
            report.add_fault(&format!("grains.{}.placement", grain.group), found, expected);
        }
    }
}

/// Checks plates that span a period: they must not be inclined along it, since their images would form stairs.
fn check_inclined_plates(scene: &Scene, population: &Population, report: &mut FaultReport) {
    let periods: Vec<(&str, Option<f64>)> = PERIOD_NAMES.into_iter().zip(scene.compute.periods()).collect();
    for plate in &population.walls {
        let ShapeRecord::Plane { half_lengths } = plate.shape else { continue };
        for (axis, &(name, period)) in periods.iter().enumerate() {
            let width = 2.0 * plate.axes.column(axis).abs().dot(&Vector3::from(half_lengths));
            let normal = plate.axes[(2, axis)];
            // Same test as in cd-solve: the files have 8 digits.
            if period.is_some_and(|period| width >= period * (1.0 - 1e-6)) && normal.abs() > 1e-6 {
                let found = format!(
                    "a plate spans {name}, but its normal has the component {normal:.4} along {}",
                    ["x", "y", "z"][axis]
                );
                let expected = format!(
                    "{} 0 of the normal: images of an inclined plate form stairs; incline gravity instead",
                    ["x", "y", "z"][axis]
                );
                report.add_fault(&format!("walls.{}", plate.wall), found, expected);
            }
        }
    }
}

/// Checks that walls of a scene with a strain rate have a plate opposite to them, whose motion along the axis is imposed.
pub fn check_strain_rates(walls: &[WallBody], report: &mut FaultReport) {
    for (k, wall) in walls.iter().enumerate() {
        let Some((axis, _)) = wall.servos.strain_rate else { continue };
        let distance_along = |other: &WallBody, sign: f64| {
            let ShapeRecord::Plane { half_lengths } = other.shape else { return None };
            let direction = Vector3::from_fn(|row, _| if row == axis { sign } else { 0.0 });
            opposite_extent(&wall.centre, &direction, (&other.centre, &other.axes, &half_lengths.into()))
        };
        let candidate = |(other, plate): (usize, &WallBody)| {
            // A wall that turns freely is no plate of its own.
            let is_other = other != k && plate.servos.hinge_axes.is_none();
            let distance = [1.0, -1.0].into_iter().find_map(|sign| distance_along(plate, sign)).filter(|_| is_other)?;
            Some((other, distance))
        };
        let opposite = walls.iter().enumerate().filter_map(candidate).min_by(|a, b| a.1.total_cmp(&b.1));
        let path = format!("walls.{}.strain_rate", wall.wall);
        let Some((opposite, _)) = opposite else {
            let expected = "a second plate across the line along its normal or axis from its centre";
            report.add_fault(&path, "without a plate opposite to the wall", expected);
            continue;
        };
        let WallBody { wall: number, loads, servos, .. } = &walls[opposite];
        let has_servo = |servo: &Option<(usize, TimeFunction)>| servo.as_ref().is_some_and(|(along, _)| *along == axis);
        let is_imposed = loads[axis].is_none() && !has_servo(&servos.pressure);
        let is_plain = is_imposed && servos.strain_rate.is_none() && servos.pivot.is_none();
        let found = format!("relative to wall {}, whose velocity along the axis is not imposed", number + 1);
        report.require(is_plain, &path, found, "a plate opposite to it at rest or with a velocity");
    }
}

/// Placed grains of a group with their masses, velocities and angular velocities.
fn grains_in_motion(scene: &Scene, group: usize, grains: &Grains, placed: PlacedGrains) -> Vec<Grain> {
    let density = scene.materials.iter().find(|m| m.name == grains.material).map_or(1.0, |m| m.density);
    let masses: Vec<f64> = placed.grains.iter().map(|grain| density * grain.volume()).collect();
    let (velocity, spin) = match &grains.driven {
        Some(driven) => {
            (Vector3::from_fn(|k, _| driven[k].as_ref().map_or(0.0, TimeFunction::initial_value)), Vector3::zeros())
        }
        None => (grains.velocity.into(), grains.spin.into()),
    };
    let rigid_velocities = motion::rigid_velocities(&velocity, &spin, &placed.positions, &masses);
    let mut random = RandomStream::new(scene.seed, group, StreamPurpose::Velocity);
    let thermal_velocities = motion::thermal_velocities(grains.thermal_velocity, &masses, &mut random);
    let imposed = grains.imposed_components();
    let imposed_spin_in_own_axes = Vector3::from_fn(|k, _| imposed[3 + k].map_or(0.0, TimeFunction::initial_value));
    let grain = |(k, sampled): (usize, SampledGrain)| {
        let mut grain = Grain {
            group,
            radius: sampled.radius,
            reach: sampled.reach,
            shape: sampled.shape,
            mass: masses[k],
            position: placed.positions[k],
            velocity: rigid_velocities[k] + thermal_velocities[k],
            spin,
        };
        if let Some(motions) = &placed.motions {
            grain.velocity += motions[k].velocity;
            grain.spin += motions[k].spin;
        }
        if grains.driven_spin.is_some() {
            grain.spin = grain.axes().tr_mul(&imposed_spin_in_own_axes);
        }
        grain
    };
    placed.grains.into_iter().enumerate().map(grain).collect()
}

/// Checks that the balls around grains, of centre and radius, m, of a periodic scene fit within a period along `axis` 0 to 2, so
/// that no grain overlaps another's image.
pub(crate) fn check_balls_extent(
    options: &Compute,
    axis: usize,
    balls: impl Iterator<Item = (Vector3<f64>, f64)>,
    report: &mut FaultReport,
) {
    report_extent(options, axis, extent_along(axis, balls), "the balls around the grains extend", report);
}

/// Checks that each grain of a periodic scene is within a period along `axis` 0 to 2, and so are the centres of all: then a
/// grain can overlap the nearest images of the others only.
fn check_extent_along(options: &Compute, axis: usize, grains: &[Grain], report: &mut FaultReport) {
    let Some(period) = options.periods()[axis] else { return };
    let centres = extent_along(axis, grains.iter().map(|grain| (grain.position, 0.0)));
    report_extent(options, axis, centres, "the centres of the grains extend", report);
    let is_large = |grain: &&Grain| 2.0 * grain.reach > period;
    let widest = grains.iter().filter(is_large).map(|grain| grain.extent_along(axis)).fold(0.0, f64::max);
    report_extent(options, axis, widest, "a grain extends", report);
}

/// Extent of balls of centre and radius, m, along `axis` 0 to 2, m.
fn extent_along(axis: usize, balls: impl Iterator<Item = (Vector3<f64>, f64)>) -> f64 {
    let ends = balls.flat_map(|(centre, radius)| [centre[axis] - radius, centre[axis] + radius]);
    let [low, high] = ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)]);
    high - low
}

/// Reports an extent, m, that is longer than the period along `axis` 0 to 2; `subject`: its body and verb in words.
fn report_extent(options: &Compute, axis: usize, extent: f64, subject: &str, report: &mut FaultReport) {
    let (name, period) = (PERIOD_NAMES[axis], options.periods()[axis]);
    if let Some(period) = period.filter(|period| extent > period * (1.0 + TOUCHING_TOLERANCE)) {
        let extent = rounded_number(extent);
        let found = format!("{}, but {subject} over {extent} m", number_text(period));
        report.add_fault(&format!("compute.{name}"), found, format!("a period of at least {extent} m"));
    }
}

/// Rejects products of numbers of a scene that do not fit the files, whose exponents have two digits.
fn check_numbers(scene: &Scene, population: &Population, report: &mut FaultReport) {
    let grains = &population.grains;
    let mut reported_paths = Vec::new();
    let mut report_once = |path: String, found: String, expected: &str| {
        if !reported_paths.contains(&path) {
            report.add_fault(&path, found, expected);
            reported_paths.push(path);
        }
    };
    let number = |name: &str, x: f64| format!("{name} {}", number_text(x));
    let smallest = check::SMALLEST_FILE_NUMBER;
    let expected = format!("numbers below {MAX_MAGNITUDE:e}, and sizes of at least {smallest:e}");
    let expected_moment = format!("at least {smallest:e} and below {:e}", 1.0 / smallest);
    for (k, (body, state)) in
        write::bodies_file(scene, population).0.iter().zip(write::dof_file(population).bodies).enumerate()
    {
        let path = || population.scene_path(k);
        let density = scene.materials.iter().find(|m| m.name == body.material).map_or(1.0, |m| m.density);
        let mass = density * sphere_volume(body.equivalent_radius);
        let moments = body.inertia.unwrap_or([1.0; 3]);
        let [smallest, largest] =
            [moments.iter().fold(f64::INFINITY, |a, b| a.min(*b)), moments.iter().fold(0.0, |a: f64, b| a.max(*b))];
        if smallest <= f64::EPSILON * largest && check::is_moment(largest) {
            let found = "its moment of inertia about its long axis is lost in the rounding of the other two";
            report_once(path(), found.to_string(), "a shape at most 1e7 times as long as it is wide");
        }
        let inertia = moments.map(|moment| ("inertia", moment));
        let radius = body.equivalent_radius;
        if !check::is_positive(radius) {
            report_once(path(), number("radius", radius), &expected);
        }
        for (name, x) in [("mass", mass)].into_iter().chain(inertia).filter(|(_, x)| !check::is_moment(*x)) {
            report_once(path(), number(name, x), &expected_moment);
        }
        let position = body.position.map(|x| ("position", x));
        let velocity = state.velocity.map(|x| ("velocity", x));
        for (name, x) in position.into_iter().chain(velocity).filter(|(_, x)| !check::fits_files(*x)) {
            report_once(path(), number(name, x), &expected);
        }
    }
    let alert = write::default_alert(population);
    let is_alert_used =
        !grains.is_empty() && scene.contacts.iter().any(|contact| contact.law.is_some() && contact.alert.is_none());
    if is_alert_used && !check::is_positive(alert) {
        report_once("contacts".into(), number("alert", alert), &expected);
    }
}

/// Shifts, m, to the nearest images of a body with these periods: none first.
fn periodic_shifts(periods: [Option<f64>; 3]) -> Vec<Vector3<f64>> {
    let mut shifts = vec![Vector3::zeros()];
    for (axis, period) in periods.into_iter().enumerate() {
        let Some(period) = period else { continue };
        let unit = Vector3::from_fn(|row, _| if row == axis { period } else { 0.0 });
        shifts = shifts.iter().flat_map(|shift| [*shift, shift + unit, shift - unit]).collect();
    }
    shifts
}

/// Shifts, m, to the images that grains of a scene can overlap: none along an axis on which their balls fit within a period.
fn image_shifts(options: &Compute, grains: &[Grain]) -> Vec<Vector3<f64>> {
    let mut periods = options.periods();
    for (axis, period) in periods.iter_mut().enumerate() {
        let extent = extent_along(axis, grains.iter().map(|grain| (grain.position, grain.reach)));
        *period = period.filter(|period| extent > *period);
    }
    periodic_shifts(periods)
}

/// Advice for grains that overlap a wall around which their placement does not place them; `None` if it does.
fn wall_advice(placement: &GrainPlacement, shape: &ShapeRecord) -> Option<&'static str> {
    let is_hollow = matches!(shape, ShapeRecord::Cylinder { hollow: true, .. });
    (matches!(placement, GrainPlacement::DensePacking { .. }) && is_hollow).then_some(
        "an envelope within the hollow cylinder, such as a Cylinder: DensePacking places grains around all walls but \
         hollow cylinders",
    )
}

/// Checks that no two grains, and no grain and wall, overlap, unless a List or File allows it.
fn check_overlaps(scene: &Scene, population: &Population, report: &mut FaultReport) {
    let grains = &population.grains;
    let may_overlap: Vec<bool> = scene.grains.iter().map(|grains| grains.placement.allows_overlap()).collect();
    let group_starts: Vec<usize> =
        (0..scene.grains.len()).map(|group| grains.partition_point(|grain| grain.group < group)).collect();
    let name = |k: usize| format!("grain {} of grains {}", k + 1 - group_starts[grains[k].group], grains[k].group + 1);
    // Indices of the two grains, or of the grain and, after all grains, the wall, and text and advice, of each overlap.
    let mut overlaps: Vec<([usize; 2], String, &str)> = Vec::new();
    let expected = "grains that touch at most (a List or File may have allow_overlap: true)";
    let image_advice =
        "grains that touch the images of others at most, as in an envelope that is no longer than the periods";
    let shaped: Vec<ShapedGrain> = grains.iter().map(ShapedGrain::new).collect();
    let mut order: Vec<usize> = (0..grains.len()).filter(|&k| !may_overlap[grains[k].group]).collect();
    order.par_sort_unstable_by(|&a, &b| grains[b].reach.total_cmp(&grains[a].reach).then(a.cmp(&b)));
    let mut cells = SphereGrid::new(order.first().map_or(1.0, |&k| grains[k].reach));
    let mut numbers = vec![0; grains.len()];
    for (number, &k) in order.iter().enumerate() {
        cells.add(grains[k].position, grains[k].reach);
        numbers[k] = number;
    }
    let shifts = image_shifts(&scene.compute, grains);
    // Up to `limit` larger grains whose bounding balls overlap that of grain `k`, with its shift and the overlap.
    let neighbours = |k: usize, limit: usize| {
        let grain = &grains[k];
        let mut found: Vec<(usize, Vector3<f64>, f64)> = Vec::new();
        let _ = shifts.iter().try_for_each(|shift| {
            cells.visit_overlaps(&(grain.position + shift), grain.reach, |number, overlap| {
                if number < numbers[k] && overlap > TOUCHING_TOLERANCE * grain.radius {
                    found.push((order[number], *shift, overlap));
                }
                if found.len() < limit { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            })
        });
        found
    };
    // Adds the overlaps of grain `k` with near ones; returns their number.
    let mut add_overlaps = |k: usize, near: Vec<(usize, Vector3<f64>, f64)>| {
        let count = overlaps.len();
        for (other, shift, overlap) in near {
            let (a, b) = (k.min(other), k.max(other));
            let overlap = shaped[k].overlap_with(&shaped[other], shift, overlap);
            if overlap > TOUCHING_TOLERANCE * grains[a].radius.min(grains[b].radius) {
                let is_image = shift != Vector3::zeros();
                let (image, expected) =
                    if is_image { ("the periodic image of ", image_advice) } else { ("", expected) };
                overlaps.push((
                    [a, b],
                    format!("{} and {image}{} overlap by {overlap:.3e} m", name(a), name(b)),
                    expected,
                ));
            }
        }
        (overlaps.len() - count, overlaps.len())
    };
    let mut are_all_found = true;
    let searched: Vec<usize> = (0..grains.len()).filter(|&k| !may_overlap[grains[k].group]).collect();
    // Neighbours in the list of grains are mostly near in space.
    'search: for chunk in searched.chunks(SEARCHED_GRAINS) {
        let near: Vec<_> = chunk.par_iter().map(|&k| neighbours(k, MAX_FIRST_NEIGHBOURS)).collect();
        for (&k, near) in chunk.iter().zip(near) {
            let is_cut = near.len() == MAX_FIRST_NEIGHBOURS;
            let (mut found, mut total) = add_overlaps(k, near);
            if is_cut && found == 0 {
                (found, total) = add_overlaps(k, neighbours(k, usize::MAX));
            } else {
                are_all_found &= !is_cut;
            }
            if found > 0 && total > MAX_SEARCHED_OVERLAPS {
                are_all_found = false;
                break 'search;
            }
        }
    }
    for (k, grain) in grains.iter().enumerate() {
        if overlaps.len() > MAX_SEARCHED_OVERLAPS {
            are_all_found = false;
            break;
        }
        for (index, wall) in population.walls.iter().enumerate().filter(|_| !may_overlap[grain.group]) {
            let overlap = shaped[k].overlap_with_wall(wall, &scene.compute);
            if overlap > TOUCHING_TOLERANCE * grain.radius {
                let found = format!("{} and wall {} overlap by {overlap:.3e} m", name(k), wall.wall + 1);
                overlaps.push((
                    [k, grains.len() + index],
                    found,
                    wall_advice(&scene.grains[grain.group].placement, &wall.shape).unwrap_or(expected),
                ));
            }
        }
    }
    overlaps.sort();
    for ([k, _], found, expected) in overlaps.iter().take(MAX_REPORTED_OVERLAPS) {
        report.add_fault(&format!("grains.{}.placement", grains[*k].group), found, *expected);
    }
    if overlaps.len() > MAX_REPORTED_OVERLAPS {
        let further = overlaps.len() - MAX_REPORTED_OVERLAPS;
        let bound = if are_all_found { "" } else { "at least " };
        report.add_fault("grains", format!("{bound}{further} more overlaps"), expected);
    }
}
