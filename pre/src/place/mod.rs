//! Where the grains of one body of grains go.
//!
//! | module | |
//! |---|---|
//! | [`room`] | ball, ellipsoid, box: volume, and what lies inside |
//! | [`lattice`] | sites of a face-centred cubic lattice |
//! | [`sequential`] | one grain after the other at random |
//! | [`cells`] | neighbours, for grains of any mixture of sizes |

pub mod cells;
pub mod lattice;
pub mod room;
pub mod sequential;

use nalgebra::{Matrix3, Vector3};

use crate::random::{Purpose, Random};
use crate::scene::{Grains, Place, Rotation};
use crate::sizes::{Until, volume};
use crate::{round_point, scene};
use room::Room;

/// Grains at rest; positions and radii have the digits of the files.
#[derive(Debug, Clone, PartialEq)]
pub struct Placed {
    /// m
    pub radii: Vec<f64>,
    /// m, fixed axes
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

/// Sizes and positions of the grains of one (checked) body of grains, the `group`-th of the scene.
///
/// Grains in an envelope come in Z-order, so that neighbours in space are near in number too.
/// Errors: the envelope has no room for them.
pub fn place(grains: &Grains, seed: u64, group: usize) -> Result<Placed, Misfit> {
    let mut random = Random::new(seed, group, Purpose::Place);
    let turn = rotation(&grains.orientation);
    let centre = Vector3::from(grains.centre);
    let to_fixed_axes = |points: Vec<Vector3<f64>>| points.iter().map(|p| round_point(&(turn * p + centre))).collect();
    let draw = |until| {
        let in_order = matches!(grains.place, Place::List { .. });
        grains.sizes.draw(until, in_order, &mut Random::new(seed, group, Purpose::Sizes))
    };
    let envelope = match &grains.place {
        Place::List { positions, .. } => {
            let points = positions.iter().map(|&p| p.into()).collect();
            let radii = draw(Until::Number(positions.len()));
            return Ok(Placed { radii, positions: to_fixed_axes(points), room: None });
        }
        Place::JitteredLattice { envelope, .. } | Place::RandomSequential { envelope } => envelope,
    };

    let (mut room, sized) = envelope.room();
    let until = match (grains.number, grains.solid_fraction) {
        (None, Some(share)) => Until::Volume(share * room.volume()),
        (number, _) => Until::Number(number.unwrap_or(0)),
    };
    let mut radii = draw(until);
    if let (false, Some(share)) = (sized, grains.solid_fraction) {
        room = room.scaled_to(radii.iter().copied().map(volume).sum::<f64>() / share);
    }
    // Positions are rounded to 8 digits after they were found: by at most sqrt(3) 5e-8 of the largest
    // coordinate. Grains keep a little more than that from each other and from the envelope.
    let margin = 1e-7 * (room.halves().norm() + centre.amax());
    let in_envelope = match &grains.place {
        Place::JitteredLattice { jitter, .. } => jittered_lattice(&room, &radii, margin, *jitter, &mut random)?,
        _ => random_sequential(&room, &mut radii, margin, &mut random)?,
    };
    Ok(Placed { radii, positions: to_fixed_axes(in_envelope), room: Some(room) })
}

/// Grain k, of radius `radii[k]`, anywhere in its site's ball up to the share `jitter` of its free room.
fn jittered_lattice(
    room: &Room,
    radii: &[f64],
    margin: f64,
    jitter: f64,
    random: &mut Random,
) -> Result<Vec<Vector3<f64>>, Misfit> {
    let largest = radii.iter().copied().fold(0.0, f64::max);
    let closest = 2.0 * (largest + margin);
    let (mut sites, distance) = lattice::sites(room, radii.len(), closest, random).map_err(|sites| Misfit {
        found: format!(
            "{} grains, the largest of radius {largest:?} m, in {room}: the lattice has {sites} sites",
            radii.len()
        ),
        expected: "fewer or smaller grains, a larger envelope, or RandomSequential for grains of very unequal size",
    })?;
    let order = z_order(room, &sites);
    sites = order.into_iter().map(|k| sites[k]).collect();
    let move_in_ball = |(site, radius): (&Vector3<f64>, &f64)| {
        site + random.in_ball() * (jitter * (0.5 * distance - radius - margin).max(0.0))
    };
    Ok(sites.iter().zip(radii).map(move_in_ball).collect())
}

/// Reorders the radii as it orders the positions that it returns.
fn random_sequential(
    room: &Room,
    radii: &mut Vec<f64>,
    margin: f64,
    random: &mut Random,
) -> Result<Vec<Vector3<f64>>, Misfit> {
    radii.sort_by(|a, b| b.total_cmp(a));
    let padded: Vec<f64> = radii.iter().map(|radius| radius + margin).collect();
    let centres = sequential::centres(room, &padded, random).map_err(|placed| Misfit {
        found: format!(
            "{placed} of {} grains (largest first) could be placed in {room} before {} tries found no room for the next",
            radii.len(),
            sequential::ATTEMPTS
        ),
        expected: "fewer or smaller grains, or a larger envelope",
    })?;
    let order = z_order(room, &centres);
    *radii = order.iter().map(|&k| radii[k]).collect();
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
