//! The bodies that a scene asks for: grains and plates with their initial motion.

use nalgebra::Vector3;

use crate::motion;
use crate::place::cells::Cells;
use crate::place::room::Room;
use crate::place::{self, Placed};
use crate::random::{Purpose, Random};
use crate::report::Report;
use crate::scene::{Grains, Place, Scene};
use crate::sizes::{MOST_BODIES, volume};
use crate::walls::{Plate, plates};

/// Overlaps up to this share of the smaller radius are touching: what 8 digits leave of a contact that
/// the user has computed by hand.
const TOUCHING: f64 = 1e-6;

/// So many overlaps are told one by one.
const TOLD: usize = 5;

/// Bodies in the order of their numbers: grains, then plates.
#[derive(Debug, Clone, PartialEq)]
pub struct Population {
    pub grains: Vec<Grain>,
    pub plates: Vec<Plate>,
    /// The envelope of each body of grains.
    pub rooms: Vec<Option<Room>>,
}

/// One sphere; position and radius have the digits of the files.
#[derive(Debug, Clone, PartialEq)]
pub struct Grain {
    /// Which body of grains it belongs to, 0-based.
    pub group: usize,
    /// m
    pub radius: f64,
    /// kg
    pub mass: f64,
    /// m
    pub position: Vector3<f64>,
    /// m/s, fixed axes
    pub velocity: Vector3<f64>,
    /// rad/s, fixed axes, which are the grain's own at the start
    pub spin: Vector3<f64>,
}

/// The bodies of a (checked) scene; what does not fit or overlaps goes into the report.
pub fn populate(scene: &Scene, report: &mut Report) -> Population {
    let mut population = Population { grains: Vec::new(), plates: plates(&scene.walls), rooms: Vec::new() };
    for (group, grains) in scene.grains.iter().enumerate() {
        match place::place(grains, scene.seed, group) {
            Ok(placed) => {
                population.rooms.push(placed.room);
                population.grains.extend(in_motion(scene, group, grains, &placed));
            }
            Err(misfit) => report.fault(&format!("grains.{group}.place"), misfit.found, misfit.expected),
        }
    }
    let bodies = population.grains.len() + population.plates.len();
    report.expect(bodies <= MOST_BODIES, "grains", format!("{bodies} bodies"), &format!("at most {MOST_BODIES}"));
    if report.faults.0.is_empty() {
        check_overlaps(scene, &population, report);
    }
    population
}

fn in_motion(scene: &Scene, group: usize, grains: &Grains, placed: &Placed) -> Vec<Grain> {
    let density = scene.materials.iter().find(|m| m.name == grains.material).map_or(0.0, |m| m.density);
    let masses: Vec<f64> = placed.radii.iter().map(|&radius| density * volume(radius)).collect();
    let (velocity, spin) = match &grains.driven {
        Some(driven) => (Vector3::from_fn(|k, _| driven[k].at_start()), Vector3::zeros()),
        None => (grains.velocity.into(), grains.spin.into()),
    };
    let rigid = motion::rigid(&velocity, &spin, &placed.positions, &masses);
    let mut random = Random::new(scene.seed, group, Purpose::Velocity);
    let thermal = motion::thermal(grains.thermal_velocity, &masses, &mut random);
    let grain = |k: usize| Grain {
        group,
        radius: placed.radii[k],
        mass: masses[k],
        position: placed.positions[k],
        velocity: rigid[k] + thermal[k],
        spin,
    };
    (0..masses.len()).map(grain).collect()
}

/// No two grains, and no grain and plate, may overlap, unless a List allows it.
fn check_overlaps(scene: &Scene, population: &Population, report: &mut Report) {
    let grains = &population.grains;
    let allowed: Vec<bool> =
        scene.grains.iter().map(|g| matches!(g.place, Place::List { allow_overlap: true, .. })).collect();
    let firsts: Vec<usize> =
        (0..scene.grains.len()).map(|group| grains.partition_point(|grain| grain.group < group)).collect();
    let name = |k: usize| format!("grain {} of grains {}", k + 1 - firsts[grains[k].group], grains[k].group + 1);
    let mut overlaps: Vec<(usize, String)> = Vec::new();

    let mut order: Vec<usize> = (0..grains.len()).collect();
    order.sort_by(|&a, &b| grains[b].radius.total_cmp(&grains[a].radius).then(a.cmp(&b)));
    let mut cells = Cells::new(order.first().map_or(1.0, |&k| grains[k].radius));
    for &k in &order {
        let grain = &grains[k];
        cells.overlaps(&grain.position, grain.radius, |number, overlap| {
            let (a, b) = (k.min(order[number]), k.max(order[number]));
            if overlap > TOUCHING * grain.radius && !allowed[grains[a].group] && !allowed[grains[b].group] {
                overlaps.push((a, format!("{} and {} overlap by {overlap:.3e} m", name(a), name(b))));
            }
        });
        cells.add(grain.position, grain.radius);
        for plate in population.plates.iter().filter(|_| !allowed[grain.group]) {
            let overlap = plate.overlap(&grain.position, grain.radius);
            if overlap > TOUCHING * grain.radius {
                overlaps.push((k, format!("{} and wall {} overlap by {overlap:.3e} m", name(k), plate.wall + 1)));
            }
        }
    }
    overlaps.sort();
    let expected = "grains that touch at most (a List may have allow_overlap: true)";
    for (k, found) in overlaps.iter().take(TOLD) {
        report.fault(&format!("grains.{}.place", grains[*k].group), found, expected);
    }
    if overlaps.len() > TOLD {
        report.fault("grains", format!("{} more overlaps", overlaps.len() - TOLD), expected);
    }
}
