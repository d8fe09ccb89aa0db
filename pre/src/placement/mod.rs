//! Positions of the grains of one group of grains.
//!
//! | module | |
//! |---|---|
//! | `region` | ball, ellipsoid, box, cylinder, surface: volume, containment |
//! | [`inside`] | interior of a closed surface as a region |
//! | [`lattice`] | sites of a face-centred cubic lattice |
//! | [`sequential`] | random sequential placement |
//! | [`dense`] | dense packings |
//! | [`packed_shapes`] | overlaps of shapes in a dense packing |
//! | [`neighbours`] | neighbours of the grains of a dense packing |
//! | [`rounded_hulls`] | shapes as convex hulls of points with a radius, and their distances |
//! | [`hulls`] | polyhedra compared by their shapes |
//! | [`fragments`] | fragmentation of a solid without gaps |
//! | `order` | order along the Z-curve |
//! | [`cells`] | neighbours, for grains of any mixture of sizes |

pub mod cells;
pub mod dense;
pub mod fragments;
pub mod hulls;
pub mod inside;
pub mod lattice;
pub mod neighbours;
mod order;
pub mod packed_shapes;
pub mod region;
pub mod rounded_hulls;
pub mod sequential;

use std::sync::Arc;

use cd_formats::names::number_text;
use nalgebra::{Matrix3, Vector3};

use crate::grain::Grain;
use crate::overlaps::{ObstacleSearch, Obstacles, TOUCHING_TOLERANCE};
use crate::particles::ParticleState;
use crate::random::{RandomStream, StreamPurpose};
use crate::rotation::rotation_matrix;
use crate::rounding::{round_14_columns, round_point};
use crate::scene::{Envelope, GrainOrientations, GrainPlacement, Grains, SizeDistribution};
use crate::shapes::{GrainSampler, OrientedPolyhedron, OrientedShape, PrincipalSolid, SampledGrain};
use crate::sizes::{MAX_BODIES, SampleTarget};
use crate::sphere::sphere_volume;
use dense::PackingError;
use hulls::GrainHulls;
use inside::SurfaceRegion;
use neighbours::PackingCell;
use order::z_order;
use packed_shapes::{FixedBody, PackingShapes};
use region::{GrainRegion, PositionShortage};
use rounded_hulls::{RoundedHull, hull_gap};
use sequential::SequentialGrains;

/// Grains at rest; positions and radii have the digits of the files.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedGrains {
    pub grains: Vec<SampledGrain>,
    /// Centres of mass, m, fixed axes.
    pub positions: Vec<Vector3<f64>>,
    /// Region in which they were placed, before it was moved and turned; none for listed positions.
    pub region: Option<GrainRegion>,
    /// Velocity, m/s, and angular velocity, rad/s, of each grain of a file that has them, fixed axes.
    pub motions: Option<Vec<GrainMotion>>,
}

/// Motion of a grain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GrainMotion {
    /// m/s
    pub velocity: Vector3<f64>,
    /// rad/s
    pub spin: Vector3<f64>,
}

/// Data of files and options by which a group of grains is placed.
#[derive(Debug, Clone, Default)]
pub struct PlacementInput<'a> {
    /// Region of the envelope, if there is one.
    pub region: Option<GrainRegion>,
    /// Particles of the placement `File`.
    pub particles: Option<ParticleState>,
    /// Periods of the scene along x, y and z, m.
    pub periods: [Option<f64>; 3],
    /// Bodies around which grains are placed.
    pub obstacles: Option<Obstacles<'a>>,
}

/// Grains that do not fit: the value found and the value expected.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacementError {
    pub found: String,
    pub expected: &'static str,
}

impl std::fmt::Display for PlacementError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}; expected {}", self.found, self.expected)
    }
}

impl std::error::Error for PlacementError {}

impl PlacementError {
    fn from_shape(error: impl std::error::Error) -> PlacementError {
        PlacementError { found: error.to_string(), expected: "a non-degenerate convex solid" }
    }

    /// Adds to the error the margin, m, by which grains are kept apart for the rounding of positions in the files.
    fn with_margin(self, margin: f64) -> PlacementError {
        let found =
            format!("{}, kept {margin:.1e} m apart, more than the rounding of positions in the text files", self.found);
        PlacementError {
            found,
            expected: "a position closer to the origin; cd-pre from-outbox moves bodies to a `centre` with all digits",
        }
    }
}

/// Sizes, shapes and positions of the grains of one (checked) group of grains, the `group`-th of the scene.
///
/// Grains other than spheres are placed as their bounding balls; polyhedra in `RandomSequential` by their shapes where these
/// do not fit; all in `DensePacking` by their shapes, which turn if `grain_orientation` is `Random`. Grains in an envelope are
/// returned in Z-order, so that neighbours in space have near numbers.
///
/// Errors: grains that do not fit into the envelope, no grain or too many, a degenerate shape, no envelope, radii from two
/// sources or none.
pub fn place_grains(
    grains: &Grains,
    shapes: &mut GrainSampler,
    PlacementInput { region, particles, periods, obstacles }: PlacementInput,
    seed: u64,
    group: usize,
) -> Result<PlacedGrains, PlacementError> {
    let mut random = RandomStream::new(seed, group, StreamPurpose::Positions);
    let rotation = rotation_matrix(&grains.orientation);
    let centre = Vector3::from(grains.centre);
    let are_polyhedra = grains.is_polyhedral();
    let rounded_point =
        |point: Vector3<f64>| if are_polyhedra { point.map(round_14_columns) } else { round_point(&point) };
    let to_fixed_axes =
        |points: Vec<Vector3<f64>>| points.iter().map(|p| rounded_point(rotation * p + centre)).collect();
    let mut draw = |target| {
        let in_order = matches!(grains.placement, GrainPlacement::List { .. } | GrainPlacement::File { .. });
        draw_grains(
            grains.sizes.as_ref(),
            target,
            in_order,
            shapes,
            &mut RandomStream::new(seed, group, StreamPurpose::Sizes),
        )
    };
    let (mut region, has_size) = match (&grains.placement, region) {
        (GrainPlacement::List { positions, .. }, _) => {
            let points = positions.iter().map(|&p| p.into()).collect();
            let grains = draw(SampleTarget::Number(positions.len()))?;
            return Ok(PlacedGrains { grains, positions: to_fixed_axes(points), region: None, motions: None });
        }
        (GrainPlacement::File { .. }, _) => {
            let particles = particles.unwrap_or_default();
            let drawn = match (&particles.radii, &grains.sizes) {
                (Some(radii), None) => radii.iter().map(|radius| SampledGrain::from_radius(*radius)).collect(),
                (None, Some(_)) => draw(SampleTarget::Number(particles.centres.len()))?,
                (Some(_), Some(_)) => {
                    let found = "the file has radii, and sizes are given".to_string();
                    return Err(PlacementError { found, expected: "no sizes" });
                }
                (None, None) => {
                    let found = "the file has no radii, and no sizes are given".to_string();
                    return Err(PlacementError { found, expected: "sizes" });
                }
            };
            if drawn.len() != particles.centres.len() {
                let found = format!("{} radii in sizes for {} particles", drawn.len(), particles.centres.len());
                return Err(PlacementError { found, expected: "one for each" });
            }
            let motions = particle_motions(&particles, &rotation);
            return Ok(PlacedGrains {
                grains: drawn,
                positions: to_fixed_axes(particles.centres),
                region: None,
                motions,
            });
        }
        (GrainPlacement::Fragments { relaxation, .. }, Some(region)) => {
            let pose = EnvelopePose { rotation, centre };
            return place_fragments(&region, grains.number.unwrap_or(0), *relaxation, pose, &mut random);
        }
        (
            GrainPlacement::JitteredLattice { envelope, .. }
            | GrainPlacement::RandomSequential { envelope }
            | GrainPlacement::DensePacking { envelope },
            Some(region),
        ) => (region, envelope.has_size()),
        (_, None) => return Err(PlacementError { found: "no envelope".to_string(), expected: "an envelope" }),
    };

    let target = match (grains.number, grains.solid_fraction) {
        (None, Some(fraction)) => SampleTarget::Volume(fraction * region.volume()),
        (number, _) => SampleTarget::Number(number.unwrap_or(0)),
    };
    // Lower bound of the number of grains: none is larger than the ball of the largest radius.
    let min_count = match (target, &grains.sizes) {
        (_, Some(SizeDistribution::List(_)) | None) | (SampleTarget::Number(_), _) => 0.0,
        (SampleTarget::Volume(volume), Some(sizes)) => volume / sphere_volume(sizes.radius_range().1),
    };
    let mut drawn = if min_count > MAX_BODIES as f64 { Vec::new() } else { draw(target)? };
    let is_too_many = min_count > MAX_BODIES as f64 || drawn.len() > MAX_BODIES;
    if drawn.is_empty() || is_too_many {
        let count = if is_too_many { format!("more than {MAX_BODIES} grains") } else { "no grain".to_string() };
        let found = format!("{count} for a solid fraction of {} in {region}", grains.solid_fraction.unwrap_or(0.0));
        return Err(PlacementError { found, expected: "another solid fraction, envelope or size of grains" });
    }
    if let (false, Some(fraction)) = (has_size, grains.solid_fraction) {
        region = region.scaled_to(drawn.iter().map(SampledGrain::volume).sum::<f64>() / fraction);
    }
    let periods = filled_periods(grains, periods);
    expect_smaller(&region, &drawn)?;
    // Positions of spheres are rounded to 8 digits, by at most sqrt(3) 5e-8 of the largest coordinate, those of polyhedra
    // to more. Grains keep slightly more than that from each other and from the envelope.
    let margin = 1e-7 * (region.half_extents().norm() + centre.amax());
    let pose = EnvelopePose { rotation, centre };
    let is_clear_of = |search: &Option<ObstacleSearch>, grain: &SampledGrain, local: &Vector3<f64>| {
        let position = rounded_point(rotation * local + centre);
        search.as_ref().is_none_or(|search| search.is_clear(&grain_at(grain, position)))
    };
    let obstacles = obstacles.filter(|obstacles| obstacles.are_near(&centre, region.half_extents().norm()));
    let positions = match &grains.placement {
        GrainPlacement::JitteredLattice { jitter, .. } => {
            let search = obstacles.map(|obstacles| obstacles.into_search(1.01 * region.half_extents().max()));
            let is_clear = |site: &Vector3<f64>, radius: f64| {
                // Grains keep the margin from the end of the ball, and bodies may overlap by the tolerance.
                let radius = (1.0 + TOUCHING_TOLERANCE) * (radius - margin);
                is_clear_of(&search, &SampledGrain { radius, reach: radius, shape: OrientedShape::Sphere }, site)
            };
            jittered_lattice(&region, &drawn, margin, *jitter, &is_clear, &mut random)
        }
        GrainPlacement::DensePacking { .. } => {
            let cell = PackingCell { region: &region, periods };
            let can_turn = grains.grain_orientation == GrainOrientations::Random;
            dense_packing(&cell, &mut drawn, margin, pose, can_turn, obstacles, &mut random)
        }
        _ => {
            let search = obstacles.map(|obstacles| obstacles.into_search(largest_reach(&drawn)));
            let is_clear = |grain: &SampledGrain, local: &Vector3<f64>| is_clear_of(&search, grain, local);
            random_sequential(&region, &mut drawn, &rotation, margin, &is_clear, &mut random)
        }
    };
    // A margin that is a tenth of the grains or more may be the reason why they do not fit.
    let positions = positions
        .map_err(|misfit| if margin < 0.1 * largest_reach(&drawn) { misfit } else { misfit.with_margin(margin) })?;
    Ok(PlacedGrains { grains: drawn, positions: to_fixed_axes(positions), region: Some(region), motions: None })
}

/// Motions of particles turned by `rotation`; none if the file has neither velocities nor spins.
fn particle_motions(particles: &ParticleState, rotation: &Matrix3<f64>) -> Option<Vec<GrainMotion>> {
    let (velocities, spins) = (&particles.velocities, &particles.spins);
    let rotated_vector = |vectors: &Option<Vec<Vector3<f64>>>, k: usize| {
        vectors.as_ref().map_or(Vector3::zeros(), |vectors| rotation * vectors[k])
    };
    let motion = |k: usize| GrainMotion { velocity: rotated_vector(velocities, k), spin: rotated_vector(spins, k) };
    (velocities.is_some() || spins.is_some()).then(|| (0..particles.centres.len()).map(motion).collect())
}

/// Periods, m, of a scene with these `periods` that the box of a dense packing fills exactly, without a rotation: it
/// has no walls along these axes.
fn filled_periods(grains: &Grains, periods: [Option<f64>; 3]) -> [Option<f64>; 3] {
    match &grains.placement {
        GrainPlacement::DensePacking { envelope: Envelope::Box { lengths: Some(lengths), .. } }
            if grains.orientation.angle == 0.0 =>
        {
            [0, 1, 2].map(|axis| periods[axis].filter(|period| *period == lengths[axis]))
        }
        _ => [None; 3],
    }
}

/// Rotation of an envelope about its centre, and its position, m.
#[derive(Debug, Clone, Copy)]
struct EnvelopePose {
    rotation: Matrix3<f64>,
    centre: Vector3<f64>,
}

/// Breaks a solid in `pose` into `number` fragments, whose seeds are moved `relaxation` times; returns them at their positions.
fn place_fragments(
    region: &GrainRegion,
    number: usize,
    relaxation: usize,
    pose: EnvelopePose,
    random: &mut RandomStream,
) -> Result<PlacedGrains, PlacementError> {
    let EnvelopePose { rotation, centre } = pose;
    let solid = fragments::region_polyhedron(region, number).map_err(PlacementError::from_shape)?;
    let cells = fragments::voronoi_fragments(&solid, number, relaxation, random).map_err(PlacementError::from_shape)?;
    let solids = cells.iter().map(PrincipalSolid::from_convex).collect::<Result<Vec<PrincipalSolid>, _>>();
    let solids = solids.map_err(PlacementError::from_shape)?;
    let centres: Vec<Vector3<f64>> = solids.iter().map(|solid| solid.shift).collect();
    let order = z_order(region, &centres);
    let positions = order.iter().map(|&k| (rotation * centres[k] + centre).map(round_14_columns)).collect();
    let grain =
        |k: usize| SampledGrain::from_polyhedron(OrientedPolyhedron::new(Arc::new(solids[k].clone()), 1.0, &rotation));
    let grains = order.iter().map(|&k| grain(k)).collect();
    let region = if let GrainRegion::Inside(_) = region {
        GrainRegion::Inside(SurfaceRegion::new(&solid).map_err(PlacementError::from_shape)?)
    } else {
        region.clone()
    };
    Ok(PlacedGrains { grains, positions, region: Some(region), motions: None })
}

/// Draws grains with their sizes one after the other; without `sizes` all have the shape's own size.
fn draw_grains(
    sizes: Option<&SizeDistribution>,
    target: SampleTarget,
    in_order: bool,
    shapes: &mut GrainSampler,
    random: &mut RandomStream,
) -> Result<Vec<SampledGrain>, PlacementError> {
    let mut next_grain = |size| shapes.next_grain(size).map_err(PlacementError::from_shape);
    match sizes {
        Some(sizes) => sizes.sample_radii(target, in_order, random, next_grain, SampledGrain::volume),
        None => match target {
            SampleTarget::Number(number) => (0..number).map(|_| next_grain(None)).collect(),
            SampleTarget::Volume(volume) => {
                let first = next_grain(None)?;
                let number = libm::round(volume / first.volume()).min(MAX_BODIES as f64 + 1.0) as usize;
                if number == 0 {
                    Ok(Vec::new())
                } else {
                    std::iter::once(Ok(first)).chain((1..number).map(|_| next_grain(None))).collect()
                }
            }
        },
    }
}

/// Checks that grains fit into the region one by one. Errors: grains that are larger than the region itself.
fn expect_smaller(region: &GrainRegion, grains: &[SampledGrain]) -> Result<(), PlacementError> {
    let half_width = region.half_extents().min();
    let sizes = grains.iter().map(|grain| grain.reach);
    let (smallest, largest) = (sizes.clone().fold(f64::INFINITY, f64::min), sizes.fold(0.0, f64::max));
    let error = |superlative: &str, radius: f64| PlacementError {
        found: format!("the {superlative} grain, of radius {} m, is larger than {region}", number_text(radius)),
        expected: "smaller grains or a larger envelope, lengths in m",
    };
    if smallest > half_width {
        Err(error("smallest", smallest))
    } else if largest > half_width {
        Err(error("largest", largest))
    } else {
        Ok(())
    }
}

/// Grain of density 1 at rest at `position`, m.
fn grain_at(sampled: &SampledGrain, position: Vector3<f64>) -> Grain {
    Grain {
        group: 0,
        radius: sampled.radius,
        reach: sampled.reach,
        shape: sampled.shape.clone(),
        mass: sampled.volume(),
        position,
        velocity: Vector3::zeros(),
        spin: Vector3::zeros(),
    }
}

/// Radius of the largest bounding ball, m.
fn largest_reach(grains: &[SampledGrain]) -> f64 {
    grains.iter().map(|grain| grain.reach).fold(0.0, f64::max)
}

/// Positions each grain at random in its site's ball, within the share `jitter` of the free distance. `is_clear`: whether
/// a ball about a position in the region, m, of a radius, m, overlaps no other body.
fn jittered_lattice(
    region: &GrainRegion,
    grains: &[SampledGrain],
    margin: f64,
    jitter: f64,
    is_clear: &dyn Fn(&Vector3<f64>, f64) -> bool,
    random: &mut RandomStream,
) -> Result<Vec<Vector3<f64>>, PlacementError> {
    let largest = largest_reach(grains);
    let closest = 2.0 * (largest + margin);
    let misfit = |PositionShortage { count }: PositionShortage| PlacementError {
        found: format!(
            "{} grains, the largest of radius {} m, in {region}: the lattice has {count} sites",
            grains.len(),
            number_text(largest)
        ),
        expected: "fewer or smaller grains, a larger envelope (a smaller solid fraction), or RandomSequential for very \
                   unequal grains",
    };
    let (mut sites, distance) =
        lattice::lattice_sites(region, grains.len(), closest, is_clear, random).map_err(misfit)?;
    let order = z_order(region, &sites);
    sites = order.into_iter().map(|k| sites[k]).collect();
    let move_in_ball = |(site, grain): (&Vector3<f64>, &SampledGrain)| {
        site + random.point_in_ball() * (jitter * (0.5 * distance - grain.reach - margin).max(0.0))
    };
    Ok(sites.iter().zip(grains).map(move_in_ball).collect())
}

/// Places grains by falling size; reorders the grains like the returned positions. `rotation` turns the axes of the region
/// into the fixed ones, in which the grains have their orientations. `is_clear`: whether a grain at a position in the region
/// overlaps no other body.
fn random_sequential(
    region: &GrainRegion,
    grains: &mut Vec<SampledGrain>,
    rotation: &Matrix3<f64>,
    margin: f64,
    is_clear: &dyn Fn(&SampledGrain, &Vector3<f64>) -> bool,
    random: &mut RandomStream,
) -> Result<Vec<Vector3<f64>>, PlacementError> {
    grains.sort_by(|a, b| b.reach.total_cmp(&a.reach));
    let padded_radii: Vec<f64> = grains.iter().map(|grain| grain.reach + margin).collect();
    let polyhedra: Option<Vec<&OrientedPolyhedron>> = grains.iter().map(|grain| grain.shape.polyhedron()).collect();
    let largest = largest_reach(grains);
    let shape = polyhedra.map(|polyhedra| move |k: usize| GrainHulls::new(polyhedra[k], rotation, largest));
    let sequence = SequentialGrains {
        radii: &padded_radii,
        margin,
        shape: shape.as_ref().map(|shape| shape as &dyn Fn(usize) -> GrainHulls),
        is_clear: &|k, position| is_clear(&grains[k], position),
    };
    let kind_of_tries = if sequence.shape.is_some() { " by its shape" } else { "" };
    let are_balls = |grain: &SampledGrain| !matches!(grain.shape, OrientedShape::Sphere | OrientedShape::Polyhedron(_));
    let expected = match grains.iter().any(are_balls) {
        true => EXPECTED_DENSE,
        false => "fewer or smaller grains, or a larger envelope (a smaller solid fraction)",
    };
    let centres = sequential::place_one_by_one(region, &sequence, random).map_err(|PositionShortage { count }| PlacementError {
        found: format!(
            "{count} of {} grains (largest first) could be placed in {region} before {} tries found no free position \
             for the next{kind_of_tries}",
            grains.len(),
            sequential::MAX_ATTEMPTS
        ),
        expected,
    })?;
    let order = z_order(region, &centres);
    *grains = order.iter().map(|&k| grains[k].clone()).collect();
    Ok(order.into_iter().map(|k| centres[k]).collect())
}

/// Expected value instead of clumps, capsules or cylinders that do not fit one after the other.
const EXPECTED_DENSE: &str = "DensePacking, which packs them by their shapes, not by the balls around them; or fewer or \
                              smaller grains, or a larger envelope";

/// Those of the bodies that enter the box around the region, or its images within the reach of a grain.
fn bodies_within(cell: &PackingCell, bodies: Vec<FixedBody>, grains: &[SampledGrain]) -> Vec<FixedBody> {
    let smallest = grains.iter().map(|grain| grain.radius).fold(f64::INFINITY, f64::min);
    let mut halves = cell.region.half_extents();
    (0..3).filter(|k| cell.periods[*k].is_some()).for_each(|k| halves[k] += largest_reach(grains));
    let region_box = RoundedHull::from_box(&Matrix3::identity(), &halves);
    let enters = |body: &FixedBody| {
        let limits = body.hulls.iter().map(|hull| (hull, hull.radius - TOUCHING_TOLERANCE * smallest));
        let gap = |(hull, limit)| hull_gap(&region_box, hull, &body.position, limit, halves.max());
        limits.map(gap).any(|gap| gap.is_some())
    };
    bodies.into_iter().filter(enters).collect()
}

/// Packs grains densely around `obstacles`; turns them, if they can turn, and reorders them like the returned positions.
fn dense_packing(
    cell: &PackingCell,
    grains: &mut Vec<SampledGrain>,
    margin: f64,
    pose: EnvelopePose,
    can_turn: bool,
    obstacles: Option<Obstacles>,
    random: &mut RandomStream,
) -> Result<Vec<Vector3<f64>>, PlacementError> {
    let padded_radii: Vec<f64> = grains.iter().map(|grain| grain.reach + margin).collect();
    let region = cell.region;
    let EnvelopePose { rotation, centre } = pose;
    let to_region_axes = rotation.transpose();
    let fixed_bodies = obstacles.as_ref().map_or(Vec::new(), |obstacles| {
        let bodies = obstacles.to_fixed_bodies(&centre, &to_region_axes, region.half_extents().norm(), &cell.periods);
        bodies_within(cell, bodies, grains)
    });
    let is_free = |point: &Vector3<f64>| {
        obstacles.as_ref().is_none_or(|obstacles| !obstacles.is_in_solid(&(rotation * point + centre)))
    };
    let are_spheres = grains.iter().all(|grain| grain.shape == OrientedShape::Sphere);
    let packed = if are_spheres && fixed_bodies.is_empty() {
        dense::pack_spheres(cell, &padded_radii, random).map(|centres| (centres, Vec::new()))
    } else {
        let hulls = |grain: &SampledGrain| {
            let hulls = RoundedHull::from_shape(&grain.shape, grain.radius, &to_region_axes).into_iter();
            let add_margin = |hull: RoundedHull| {
                let radius = hull.radius + margin;
                hull.with_radius(radius)
            };
            hulls.map(add_margin).collect()
        };
        let shapes = PackingShapes {
            hulls: grains.iter().map(hulls).collect(),
            sizes: grains.iter().map(|grain| grain.radius).collect(),
            can_turn: can_turn && !are_spheres,
            obstacles: fixed_bodies,
        };
        dense::pack_shapes(cell, &padded_radii, &shapes, &is_free, random)
            .map(|packed| (packed.centres, packed.rotations))
    };
    let (centres, rotations) = packed.map_err(|error| {
        let volume: f64 = grains.iter().map(SampledGrain::volume).sum();
        let fraction = volume / region.volume();
        let found = match error {
            PackingError::Jammed { volume_ratio } => format!(
                "{} grains at a solid fraction of {fraction:.4} in {region} jam: they fit at {:.4}",
                grains.len(),
                volume_ratio * fraction
            ),
            PackingError::NoPoint => {
                format!("no random point of {region} is free: it is too thin, or other bodies fill it")
            }
        };
        PlacementError { found, expected: "fewer or smaller grains, or a larger envelope (a smaller solid fraction)" }
    })?;
    if can_turn {
        for (grain, turn) in grains.iter_mut().zip(&rotations) {
            grain.shape.turn(&(rotation * turn.to_rotation_matrix().into_inner() * to_region_axes));
        }
    }
    let order = z_order(region, &centres);
    *grains = order.iter().map(|&k| grains[k].clone()).collect();
    Ok(order.into_iter().map(|k| centres[k]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::placement::cells::SphereGrid;
    use crate::rounding::round_8_digits;
    use crate::scene::Rotation;
    use crate::scene::{GrainShape, RadiusKind};
    use proptest::prelude::*;

    fn grains(
        number: Option<usize>,
        solid_fraction: Option<f64>,
        sizes: SizeDistribution,
        placement: GrainPlacement,
    ) -> Grains {
        Grains {
            material: "ROCKx".into(),
            colour: "BLUEx".into(),
            number,
            solid_fraction,
            shape: GrainShape::Sphere,
            sizes: Some(sizes),
            radius: RadiusKind::default(),
            grain_orientation: GrainOrientations::default(),
            placement,
            centre: [0.0; 3],
            orientation: Rotation::default(),
            velocity: [0.0; 3],
            spin: [0.0; 3],
            orbit: None,
            thermal_velocity: 0.0,
            driven: None,
            driven_spin: None,
        }
    }

    fn place_group(grains: &Grains, seed: u64, group: usize) -> Result<PlacedGrains, PlacementError> {
        let folder = std::path::Path::new("");
        let region = grains.placement.envelope().map(|envelope| envelope.to_region(folder).unwrap().0);
        let mut shapes = GrainSampler::from_grains(grains, folder, seed, group).unwrap();
        let input = PlacementInput { region, ..PlacementInput::default() };
        place_grains(grains, &mut shapes, input, seed, group)
    }

    #[test]
    fn a_position_too_far_out_for_the_files_is_reported() {
        for place in [
            GrainPlacement::RandomSequential { envelope: envelope(0) },
            GrainPlacement::JitteredLattice { envelope: envelope(0), jitter: 0.5 },
        ] {
            let near = grains(Some(100), Some(0.25), SizeDistribution::Single(1.0), place);
            assert!(place_group(&near, 1, 0).is_ok());
            let far = Grains { centre: [6e7, 0.0, 0.0], ..near };
            let misfit = place_group(&far, 1, 0).err().unwrap();
            assert!(misfit.expected.contains("from-outbox"), "{}; expected {}", misfit.found, misfit.expected);
        }
    }

    fn solid_volume(placed: &PlacedGrains) -> f64 {
        placed.grains.iter().map(SampledGrain::volume).sum()
    }

    fn envelope(which: usize) -> Envelope {
        match which {
            0 => Envelope::Ball { radius: None },
            1 => Envelope::Ellipsoid { semi_axes: None, ratios: Some([3.0, 2.0, 1.0]) },
            _ => Envelope::Box { lengths: None, ratios: Some([1.0, 2.0, 3.0]) },
        }
    }

    /// Checks that grains lie within the envelope without overlaps, by the numbers that the files hold.
    fn check_positions(grains: &Grains, placed: &PlacedGrains) -> Result<(), TestCaseError> {
        let (turn, region) = (rotation_matrix(&grains.orientation), placed.region.clone().unwrap());
        let mut order: Vec<usize> = (0..placed.grains.len()).collect();
        order.sort_by(|&a, &b| placed.grains[b].reach.total_cmp(&placed.grains[a].reach));
        let mut cells = SphereGrid::new(placed.grains[order[0]].reach);
        for k in order {
            let (position, radius) = (placed.positions[k], placed.grains[k].reach);
            prop_assert!(position == round_point(&position) && radius == round_8_digits(radius));
            let local = turn.transpose() * (position - Vector3::from(grains.centre));
            prop_assert!(region.contains_ball(&local, radius), "grain {k} reaches out of {region}");
            prop_assert!(cells.is_free(&position, radius), "grain {k} overlaps another");
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
            centre in prop::array::uniform3(-1e4..1e4f64), // far off, so that rounding matters
            angle in -3.0..3.0f64,
            seed: u64,
        ) {
            let envelope = envelope(which);
            let place = if lattice { GrainPlacement::JitteredLattice { envelope, jitter } } else { GrainPlacement::RandomSequential { envelope } };
            let sizes = SizeDistribution::Uniform { min: 0.9, max: 1.1 };
            let mut grains = grains(Some(number), Some(solid_fraction), sizes, place);
            grains.centre = centre;
            grains.orientation = Rotation { axis: [1.0, -2.0, 0.5], angle };
            match place_group(&grains, seed, 0) {
                Ok(placed) => {
                    prop_assert_eq!(placed.grains.len(), number);
                    prop_assert_eq!(placed.positions.len(), number);
                    let volume = solid_volume(&placed);
                    // Round-off of a sum of up to 200 terms and of a cube root.
                    prop_assert!((volume / placed.region.as_ref().unwrap().volume() / solid_fraction - 1.0).abs() < 1e-12);
                    check_positions(&grains, &placed)?;
                }
                // Few grains in a flat envelope may not fit at all: it may be thinner than a grain.
                Err(_) => prop_assert!(number < 60),
            }
        }
    }

    #[test]
    fn mixed_sizes_fill_given_envelopes() {
        let sizes = SizeDistribution::PowerLaw { min: 1.0, max: 10.0, exponent: 2.5 };
        let place = GrainPlacement::RandomSequential {
            envelope: Envelope::Ellipsoid { semi_axes: Some([60.0, 50.0, 40.0]), ratios: None },
        };
        let grains = grains(None, Some(0.35), sizes, place);
        let placed = place_group(&grains, 1, 0).unwrap();
        check_positions(&grains, &placed).unwrap();
        let volume = solid_volume(&placed);
        // The volume is off by at most half of the largest grain.
        assert!((volume - 0.35 * placed.region.as_ref().unwrap().volume()).abs() <= 0.5 * sphere_volume(10.0));
    }

    #[test]
    fn a_seed_decides_all_and_groups_do_not_depend_on_each_other() {
        let lattice = GrainPlacement::JitteredLattice { envelope: envelope(0), jitter: 1.0 };
        let grains = grains(Some(50), Some(0.1), SizeDistribution::Uniform { min: 1.0, max: 2.0 }, lattice);
        let first = place_group(&grains, 7, 0).unwrap();
        assert_eq!(place_group(&grains, 7, 0).unwrap(), first);
        assert_ne!(place_group(&grains, 8, 0).unwrap(), first);
        assert_ne!(place_group(&grains, 7, 1).unwrap(), first);
    }

    #[test]
    fn neighbours_in_number_are_near_in_space() {
        let lattice = GrainPlacement::JitteredLattice { envelope: envelope(0), jitter: 1.0 };
        let grains = grains(Some(4096), Some(0.3), SizeDistribution::Single(1.0), lattice);
        let positions = place_group(&grains, 1, 0).unwrap().positions;
        let steps: f64 = positions.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        // Neighbours are about 2.7 radii apart and the Z-curve makes a jump now and then; without order
        // two grains are about 36/35 of the ball's radius apart, 24 radii.
        assert!(steps / 4095.0 < 6.0, "{}", steps / 4095.0);
    }

    #[test]
    fn grains_that_do_not_fit_are_reported_with_counts() {
        let tight = |place| grains(Some(1000), None, SizeDistribution::Single(1.0), place);
        let envelope = || Envelope::Ball { radius: Some(10.0) };
        let lattice = place_group(&tight(GrainPlacement::JitteredLattice { envelope: envelope(), jitter: 1.0 }), 1, 0)
            .unwrap_err();
        assert!(
            lattice.found.starts_with("1000 grains, the largest of radius 1 m, in a ball of radius 10 m"),
            "{lattice:?}"
        );
        let random = place_group(&tight(GrainPlacement::RandomSequential { envelope: envelope() }), 1, 0).unwrap_err();
        assert!(random.found.contains(" of 1000 grains (largest first) could be placed"), "{random:?}");
        let empty = grains(
            None,
            Some(0.01),
            SizeDistribution::Single(9.0),
            GrainPlacement::RandomSequential { envelope: envelope() },
        );
        assert!(place_group(&empty, 1, 0).unwrap_err().found.starts_with("no grain for a solid fraction of 0.01"));
    }

    #[test]
    fn listed_positions_are_turned_and_moved_and_keep_their_order() {
        let place = GrainPlacement::List { positions: vec![[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]], allow_overlap: false };
        let mut grains = grains(None, None, SizeDistribution::List(vec![0.5, 0.25]), place);
        grains.centre = [10.0, 0.0, 0.0];
        grains.orientation = Rotation { axis: [0.0, 0.0, 3.0], angle: std::f64::consts::FRAC_PI_2 };
        let placed = place_group(&grains, 1, 0).unwrap();
        assert_eq!(placed.grains.iter().map(|grain| grain.radius).collect::<Vec<_>>(), [0.5, 0.25]);
        let expected = [Vector3::new(10.0, 1.0, 0.0), Vector3::new(8.0, 0.0, 0.0)];
        for (position, expected) in placed.positions.iter().zip(expected) {
            assert!((position - expected).norm() < 1e-15); // cos(pi/2) is 6e-17
        }
    }
}
