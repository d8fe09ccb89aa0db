//! Where the grains of one body of grains go.
//!
//! | module | |
//! |---|---|
//! | [`room`] | ball, ellipsoid, box: volume, and what lies inside |
//! | [`inside`] | a closed surface as a room |
//! | [`lattice`] | sites of a face-centred cubic lattice |
//! | [`sequential`] | one grain after the other at random |
//! | [`fragments`] | a solid broken without gaps |
//! | [`cells`] | neighbours, for grains of any mixture of sizes |

pub mod cells;
pub mod fragments;
pub mod inside;
pub mod lattice;
pub mod room;
pub mod sequential;

use std::rc::Rc;

use nalgebra::{Matrix3, Vector3};

use crate::random::{Purpose, Random};
use crate::scene::{Grains, Place, Rotation, Sizes};
use crate::shapes::{Drawn, Polyhedron, Shapes, Solid};
use crate::sizes::{MOST_BODIES, Until, volume};
use crate::{round_point, round14, scene};
use inside::Inside;
use room::Room;

/// Grains at rest; positions and radii have the digits of the files.
#[derive(Debug, Clone, PartialEq)]
pub struct Placed {
    pub grains: Vec<Drawn>,
    /// Centres of mass, m, fixed axes.
    pub positions: Vec<Vector3<f64>>,
    /// The room they were put in, before it was moved and turned; none for listed positions.
    pub room: Option<Room>,
}

/// Grains that do not fit: what was found, what is expected instead.
#[derive(Debug, Clone, PartialEq)]
pub struct Misfit {
    pub found: String,
    pub expected: &'static str,
}

impl Misfit {
    fn shape(found: String) -> Misfit {
        Misfit { found, expected: "a shape that can be made" }
    }

    /// The same where grains are held apart by more than their sizes: by what the files round of their positions.
    fn far_out(self, margin: f64) -> Misfit {
        let found = format!("{}, kept {margin:.1e} m apart as files hold 8 digits of positions so far out", self.found);
        Misfit {
            found,
            expected: "a place nearer to the origin; cd-pre from-outbox moves to a `centre` with all digits",
        }
    }
}

/// Sizes, shapes and positions of the grains of one (checked) body of grains, the `group`-th of the scene.
///
/// Polyhedra are placed as the balls around them. Grains in an envelope come in Z-order, so that neighbours in space
/// are near in number too. Errors: the envelope has no room for them.
/// `room` is that of the envelope, if there is one.
pub fn place(
    grains: &Grains,
    shapes: &mut Shapes,
    room: Option<Room>,
    seed: u64,
    group: usize,
) -> Result<Placed, Misfit> {
    let mut random = Random::new(seed, group, Purpose::Place);
    let turn = rotation(&grains.orientation);
    let centre = Vector3::from(grains.centre);
    let polyhedral = grains.polyhedral();
    let in_file = |point: Vector3<f64>| if polyhedral { point.map(round14) } else { round_point(&point) };
    let to_fixed_axes = |points: Vec<Vector3<f64>>| points.iter().map(|p| in_file(turn * p + centre)).collect();
    let mut draw = |until| {
        let in_order = matches!(grains.place, Place::List { .. });
        draw(grains.sizes.as_ref(), until, in_order, shapes, &mut Random::new(seed, group, Purpose::Sizes))
    };
    let (mut room, sized) = match (&grains.place, room) {
        (Place::List { positions, .. }, _) => {
            let points = positions.iter().map(|&p| p.into()).collect();
            let grains = draw(Until::Number(positions.len()))?;
            return Ok(Placed { grains, positions: to_fixed_axes(points), room: None });
        }
        (Place::Fragments { relaxation, .. }, Some(room)) => {
            return broken(&room, grains.number.unwrap_or(0), *relaxation, &turn, &centre, &mut random);
        }
        (Place::JitteredLattice { envelope, .. } | Place::RandomSequential { envelope }, Some(room)) => {
            (room, envelope.sized())
        }
        (_, None) => return Err(Misfit { found: "no room".to_string(), expected: "an envelope" }),
    };

    let until = match (grains.number, grains.solid_fraction) {
        (None, Some(share)) => Until::Volume(share * room.volume()),
        (number, _) => Until::Number(number.unwrap_or(0)),
    };
    // No grain is larger than the ball of the largest radius.
    let least = match (until, &grains.sizes) {
        (_, Some(Sizes::List(_)) | None) | (Until::Number(_), _) => 0.0,
        (Until::Volume(wanted), Some(sizes)) => wanted / volume(sizes.range().1),
    };
    let mut drawn = if least > MOST_BODIES as f64 { Vec::new() } else { draw(until)? };
    let many = least > MOST_BODIES as f64 || drawn.len() > MOST_BODIES;
    if drawn.is_empty() || many {
        let count = if many { format!("more than {MOST_BODIES} grains") } else { "no grain".to_string() };
        let found = format!("{count} for a solid fraction of {:?} in {room}", grains.solid_fraction.unwrap_or(0.0));
        return Err(Misfit { found, expected: "another solid fraction, envelope or size of grains" });
    }
    if let (false, Some(share)) = (sized, grains.solid_fraction) {
        room = room.scaled_to(drawn.iter().map(Drawn::volume).sum::<f64>() / share);
    }
    // Positions are rounded to 8 digits after they were found: by at most sqrt(3) 5e-8 of the largest
    // coordinate. Grains keep a little more than that from each other and from the envelope.
    expect_smaller(&room, &drawn)?;
    let margin = 1e-7 * (room.halves().norm() + centre.amax());
    let in_envelope = match &grains.place {
        Place::JitteredLattice { jitter, .. } => jittered_lattice(&room, &drawn, margin, *jitter, &mut random),
        _ => random_sequential(&room, &mut drawn, margin, &mut random),
    };
    let in_envelope =
        in_envelope.map_err(|misfit| if margin < 0.1 * largest(&drawn) { misfit } else { misfit.far_out(margin) })?;
    Ok(Placed { grains: drawn, positions: to_fixed_axes(in_envelope), room: Some(room) })
}

/// The fragments of a solid where they are in it, the solid turned about its middle and moved to `centre`.
fn broken(
    room: &Room,
    number: usize,
    relaxation: usize,
    turn: &Matrix3<f64>,
    centre: &Vector3<f64>,
    random: &mut Random,
) -> Result<Placed, Misfit> {
    let solid = fragments::solid(room, number).map_err(|misfit| Misfit::shape(misfit.to_string()))?;
    let cells = fragments::fragments(&solid, number, relaxation, random).map_err(Misfit::shape)?;
    let solids = cells.iter().map(Solid::convex).collect::<Result<Vec<Solid>, _>>();
    let solids = solids.map_err(|misfit| Misfit::shape(misfit.to_string()))?;
    let centres: Vec<Vector3<f64>> = solids.iter().map(|solid| solid.shift).collect();
    let order = z_order(room, &centres);
    let positions = order.iter().map(|&k| (turn * centres[k] + centre).map(round14)).collect();
    let drawn = |k: usize| Drawn::of(Polyhedron::new(Rc::new(solids[k].clone()), 1.0, turn));
    let grains = order.iter().map(|&k| drawn(k)).collect();
    let room = if let Room::Inside(_) = room {
        Room::Inside(Inside::new(&solid).map_err(Misfit::shape)?)
    } else {
        room.clone()
    };
    Ok(Placed { grains, positions, room: Some(room) })
}

/// Grains with their sizes, drawn one after the other; without `sizes` all of the shape's own.
fn draw(
    sizes: Option<&Sizes>,
    until: Until,
    in_order: bool,
    shapes: &mut Shapes,
    random: &mut Random,
) -> Result<Vec<Drawn>, Misfit> {
    let mut next = |size| shapes.next(size).map_err(Misfit::shape);
    match sizes {
        Some(sizes) => sizes.draw(until, in_order, random, next, Drawn::volume),
        None => match until {
            Until::Number(number) => (0..number).map(|_| next(None)).collect(),
            Until::Volume(wanted) => {
                let first = next(None)?;
                let number = libm::round(wanted / first.volume()).min(MOST_BODIES as f64 + 1.0) as usize;
                if number == 0 {
                    Ok(Vec::new())
                } else {
                    std::iter::once(Ok(first)).chain((1..number).map(|_| next(None))).collect()
                }
            }
        },
    }
}

/// Errors: grains that are larger than the room itself.
fn expect_smaller(room: &Room, grains: &[Drawn]) -> Result<(), Misfit> {
    let half = room.halves().min();
    let sizes = grains.iter().map(|grain| grain.reach);
    let (smallest, largest) = (sizes.clone().fold(f64::INFINITY, f64::min), sizes.fold(0.0, f64::max));
    let larger = |which: &str, radius: f64| Misfit {
        found: format!("the {which} grain, of radius {radius:?} m, is larger than {room}"),
        expected: "smaller grains or a larger envelope, lengths in m",
    };
    if smallest > half {
        Err(larger("smallest", smallest))
    } else if largest > half {
        Err(larger("largest", largest))
    } else {
        Ok(())
    }
}

fn largest(grains: &[Drawn]) -> f64 {
    grains.iter().map(|grain| grain.reach).fold(0.0, f64::max)
}

/// Grain k anywhere in its site's ball up to the share `jitter` of its free room.
fn jittered_lattice(
    room: &Room,
    grains: &[Drawn],
    margin: f64,
    jitter: f64,
    random: &mut Random,
) -> Result<Vec<Vector3<f64>>, Misfit> {
    let largest = largest(grains);
    let closest = 2.0 * (largest + margin);
    let (mut sites, distance) = lattice::sites(room, grains.len(), closest, random).map_err(|sites| Misfit {
        found: format!(
            "{} grains, the largest of radius {largest:?} m, in {room}: the lattice has {sites} sites",
            grains.len()
        ),
        expected: "fewer or smaller grains, a larger envelope (a smaller solid fraction), or RandomSequential for very unequal grains",
    })?;
    let order = z_order(room, &sites);
    sites = order.into_iter().map(|k| sites[k]).collect();
    let move_in_ball = |(site, grain): (&Vector3<f64>, &Drawn)| {
        site + random.in_ball() * (jitter * (0.5 * distance - grain.reach - margin).max(0.0))
    };
    Ok(sites.iter().zip(grains).map(move_in_ball).collect())
}

/// Reorders the grains as it orders the positions that it returns.
fn random_sequential(
    room: &Room,
    grains: &mut Vec<Drawn>,
    margin: f64,
    random: &mut Random,
) -> Result<Vec<Vector3<f64>>, Misfit> {
    grains.sort_by(|a, b| b.reach.total_cmp(&a.reach));
    let padded: Vec<f64> = grains.iter().map(|grain| grain.reach + margin).collect();
    let centres = sequential::centres(room, &padded, random).map_err(|placed| Misfit {
        found: format!(
            "{placed} of {} grains (largest first) could be placed in {room} before {} tries found no room for the next",
            grains.len(),
            sequential::ATTEMPTS
        ),
        expected: "fewer or smaller grains, or a larger envelope (a smaller solid fraction)",
    })?;
    let order = z_order(room, &centres);
    *grains = order.iter().map(|&k| grains[k].clone()).collect();
    Ok(order.into_iter().map(|k| centres[k]).collect())
}

/// The order of the points along the Z-curve (Morton 1966) through the room's box.
fn z_order(room: &Room, points: &[Vector3<f64>]) -> Vec<usize> {
    const BITS: u32 = 20; // a millionth of the room's length
    let halves = room.halves();
    let code = |point: &Vector3<f64>| {
        let cell = |k: usize| ((0.5 + 0.5 * point[k] / halves[k]) * f64::from(1u32 << BITS)) as u64;
        let cells = [cell(0), cell(1), cell(2)];
        (0..3 * BITS).rev().fold(0u64, |code, bit| code << 1 | cells[(bit % 3) as usize] >> (bit / 3) & 1)
    };
    let mut order: Vec<(u64, usize)> = points.iter().map(code).zip(0..).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, k)| k).collect()
}

/// The matrix of a rotation (Rodrigues): identity for an angle of 0.
pub fn rotation(rotation: &scene::Rotation) -> Matrix3<f64> {
    let Rotation { axis, angle } = *rotation;
    let axis = Vector3::from(axis).normalize();
    let (sin, cos) = libm::sincos(angle);
    Matrix3::identity() * cos + axis.cross_matrix() * sin + axis * axis.transpose() * (1.0 - cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::place::cells::Cells;
    use crate::scene::{Envelope, Radius, Shape, Standing};
    use crate::sizes::volume;
    use proptest::prelude::*;

    fn grains(number: Option<usize>, solid_fraction: Option<f64>, sizes: Sizes, place: Place) -> Grains {
        Grains {
            material: "ROCKx".into(),
            colour: "BLUEx".into(),
            number,
            solid_fraction,
            shape: Shape::Sphere,
            sizes: Some(sizes),
            radius: Radius::default(),
            standing: Standing::default(),
            place,
            centre: [0.0; 3],
            orientation: Rotation::default(),
            velocity: [0.0; 3],
            spin: [0.0; 3],
            thermal_velocity: 0.0,
            driven: None,
        }
    }

    fn spot(grains: &Grains, seed: u64, group: usize) -> Result<Placed, Misfit> {
        let folder = std::path::Path::new("");
        let room = grains.place.envelope().map(|envelope| envelope.room(folder).unwrap().0);
        place(grains, &mut Shapes::of(grains, folder, seed, group).unwrap(), room, seed, group)
    }

    #[test]
    fn a_place_too_far_out_for_the_files_is_told() {
        for place in [
            Place::RandomSequential { envelope: envelope(0) },
            Place::JitteredLattice { envelope: envelope(0), jitter: 0.5 },
        ] {
            let near = grains(Some(100), Some(0.25), Sizes::Single(1.0), place);
            assert!(spot(&near, 1, 0).is_ok());
            let far = Grains { centre: [6e7, 0.0, 0.0], ..near };
            let misfit = spot(&far, 1, 0).err().unwrap();
            assert!(misfit.expected.contains("from-outbox"), "{}; expected {}", misfit.found, misfit.expected);
        }
    }

    fn filled(placed: &Placed) -> f64 {
        placed.grains.iter().map(Drawn::volume).sum()
    }

    fn envelope(which: usize) -> Envelope {
        match which {
            0 => Envelope::Ball { radius: None },
            1 => Envelope::Ellipsoid { semi_axes: None, ratios: Some([3.0, 2.0, 1.0]) },
            _ => Envelope::Box { lengths: None, ratios: Some([1.0, 2.0, 3.0]) },
        }
    }

    /// Whole grains within the envelope, and no two overlapping, by the numbers that the files hold.
    fn sound(grains: &Grains, placed: &Placed) -> Result<(), TestCaseError> {
        let (turn, room) = (rotation(&grains.orientation), placed.room.clone().unwrap());
        let mut order: Vec<usize> = (0..placed.grains.len()).collect();
        order.sort_by(|&a, &b| placed.grains[b].reach.total_cmp(&placed.grains[a].reach));
        let mut cells = Cells::new(placed.grains[order[0]].reach);
        for k in order {
            let (position, radius) = (placed.positions[k], placed.grains[k].reach);
            prop_assert!(position == round_point(&position) && radius == crate::round8(radius));
            let local = turn.transpose() * (position - Vector3::from(grains.centre));
            prop_assert!(room.holds(&local, radius), "grain {k} reaches out of {room}");
            prop_assert!(cells.free(&position, radius), "grain {k} overlaps another");
            cells.add(position, radius);
        }
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn every_placement_has_its_number_keeps_inside_and_never_overlaps(
            number in 1..200usize,
            solid_fraction in 0.02..0.15f64,
            which in 0..3usize,
            lattice: bool,
            jitter in 0.0..=1.0f64,
            centre in prop::array::uniform3(-1e4..1e4f64), // far off, so that rounding tells
            angle in -3.0..3.0f64,
            seed: u64,
        ) {
            let envelope = envelope(which);
            let place = if lattice { Place::JitteredLattice { envelope, jitter } } else { Place::RandomSequential { envelope } };
            let sizes = Sizes::Uniform { min: 0.9, max: 1.1 };
            let mut grains = grains(Some(number), Some(solid_fraction), sizes, place);
            grains.centre = centre;
            grains.orientation = Rotation { axis: [1.0, -2.0, 0.5], angle };
            match spot(&grains, seed, 0) {
                Ok(placed) => {
                    prop_assert_eq!(placed.grains.len(), number);
                    prop_assert_eq!(placed.positions.len(), number);
                    let filled = filled(&placed);
                    // Round-off of a sum of up to 200 terms and of a cube root.
                    prop_assert!((filled / placed.room.as_ref().unwrap().volume() / solid_fraction - 1.0).abs() < 1e-12);
                    sound(&grains, &placed)?;
                }
                // Few grains in a flat envelope do not fit at all: thinner than a grain.
                Err(_) => prop_assert!(number < 60),
            }
        }
    }

    #[test]
    fn mixed_sizes_fill_given_envelopes() {
        let sizes = Sizes::PowerLaw { min: 1.0, max: 10.0, exponent: 2.5 };
        let place = Place::RandomSequential {
            envelope: Envelope::Ellipsoid { semi_axes: Some([60.0, 50.0, 40.0]), ratios: None },
        };
        let grains = grains(None, Some(0.35), sizes, place);
        let placed = spot(&grains, 1, 0).unwrap();
        sound(&grains, &placed).unwrap();
        let filled = filled(&placed);
        // Half of the largest grain at most is missing or too much.
        assert!((filled - 0.35 * placed.room.as_ref().unwrap().volume()).abs() <= 0.5 * volume(10.0));
    }

    #[test]
    fn a_seed_decides_all_and_groups_do_not_depend_on_each_other() {
        let lattice = Place::JitteredLattice { envelope: envelope(0), jitter: 1.0 };
        let grains = grains(Some(50), Some(0.1), Sizes::Uniform { min: 1.0, max: 2.0 }, lattice);
        let first = spot(&grains, 7, 0).unwrap();
        assert_eq!(spot(&grains, 7, 0).unwrap(), first);
        assert_ne!(spot(&grains, 8, 0).unwrap(), first);
        assert_ne!(spot(&grains, 7, 1).unwrap(), first);
    }

    #[test]
    fn neighbours_in_number_are_near_in_space() {
        let lattice = Place::JitteredLattice { envelope: envelope(0), jitter: 1.0 };
        let grains = grains(Some(4096), Some(0.3), Sizes::Single(1.0), lattice);
        let positions = spot(&grains, 1, 0).unwrap().positions;
        let steps: f64 = positions.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        // Neighbours are about 2.7 radii apart and the Z-curve makes a jump now and then; without order
        // two grains are about 36/35 of the ball's radius apart, 24 radii.
        assert!(steps / 4095.0 < 6.0, "{}", steps / 4095.0);
    }

    #[test]
    fn what_does_not_fit_is_told_with_counts() {
        let tight = |place| grains(Some(1000), None, Sizes::Single(1.0), place);
        let envelope = || Envelope::Ball { radius: Some(10.0) };
        let lattice = spot(&tight(Place::JitteredLattice { envelope: envelope(), jitter: 1.0 }), 1, 0).unwrap_err();
        assert!(
            lattice.found.starts_with("1000 grains, the largest of radius 1.0 m, in a ball of radius 10.0"),
            "{lattice:?}"
        );
        let random = spot(&tight(Place::RandomSequential { envelope: envelope() }), 1, 0).unwrap_err();
        assert!(random.found.contains(" of 1000 grains (largest first) could be placed"), "{random:?}");
        let empty = grains(None, Some(0.01), Sizes::Single(9.0), Place::RandomSequential { envelope: envelope() });
        assert!(spot(&empty, 1, 0).unwrap_err().found.starts_with("no grain for a solid fraction of 0.01"));
    }

    #[test]
    fn listed_positions_are_turned_and_moved_and_keep_their_order() {
        let place = Place::List { positions: vec![[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]], allow_overlap: false };
        let mut grains = grains(None, None, Sizes::List(vec![0.5, 0.25]), place);
        grains.centre = [10.0, 0.0, 0.0];
        grains.orientation = Rotation { axis: [0.0, 0.0, 3.0], angle: std::f64::consts::FRAC_PI_2 };
        let placed = spot(&grains, 1, 0).unwrap();
        assert_eq!(placed.grains.iter().map(|grain| grain.radius).collect::<Vec<_>>(), [0.5, 0.25]);
        let expected = [Vector3::new(10.0, 1.0, 0.0), Vector3::new(8.0, 0.0, 0.0)];
        for (position, expected) in placed.positions.iter().zip(expected) {
            assert!((position - expected).norm() < 1e-15); // cos(pi/2) is 6e-17
        }
    }
}
