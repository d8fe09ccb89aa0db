//! Random sequential placement: largest first, each at a random free position in the region.

use nalgebra::Vector3;

use super::cells::SphereGrid;
use super::hulls::GrainHulls;
use super::region::{GrainRegion, PositionShortage};
use crate::random::RandomStream;

/// Number of trial positions for one grain before the region counts as full. Ten times as many would bring equal spheres
/// from a solid fraction of about 0.36 to 0.37 only: each further step to the jamming limit 0.385 costs a factor of ten.
pub const MAX_ATTEMPTS: usize = 10_000;

/// Grains to be placed, by falling radius.
pub struct SequentialGrains<'a> {
    /// Radii of their balls, m, with `margin`.
    pub radii: &'a [f64],
    /// Distance, m, that grains keep from each other and from the boundary of the region, as part of `radii`.
    pub margin: f64,
    /// Shape of the polyhedron of an index, about the origin; `None` unless all grains are polyhedra.
    pub shape: Option<&'a dyn Fn(usize) -> GrainHulls>,
    /// Whether the grain of an index at a position overlaps no body that was placed before.
    pub is_clear: &'a dyn Fn(usize, &Vector3<f64>) -> bool,
}

/// Places grains without overlap and completely in the region; returns their centres, m.
///
/// Grains are placed by their balls. As soon as the ball of a polyhedron finds no position, this one and those after it
/// are placed by their shapes, in their given orientations.
///
/// Errors: a grain found no position in [`MAX_ATTEMPTS`] tries.
pub fn place_one_by_one(
    region: &GrainRegion,
    grains: &SequentialGrains,
    random: &mut RandomStream,
) -> Result<Vec<Vector3<f64>>, PositionShortage> {
    let mut cells = SphereGrid::new(grains.radii.first().copied().unwrap_or(1.0));
    let mut centres: Vec<Vector3<f64>> = Vec::with_capacity(grains.radii.len());
    let halves = region.half_extents();
    // Shapes of the grains that were placed, from the first one on that finds no position by its ball.
    let mut hulls: Option<Vec<GrainHulls>> = None;
    for (k, &radius) in grains.radii.iter().enumerate() {
        let mut position = None;
        if hulls.is_none() {
            let range = halves.map(|half| (half - radius).max(0.0));
            position = (0..MAX_ATTEMPTS).map(|_| random.point_in_cube().component_mul(&range)).find(|position| {
                region.contains_ball(position, radius)
                    && cells.is_free(position, radius)
                    && (grains.is_clear)(k, position)
            });
        }
        if position.is_none()
            && let Some(shape) = grains.shape
        {
            let shape_at = |(k, centre): (usize, &Vector3<f64>)| {
                let mut hulls = shape(k);
                hulls.move_to(centre);
                hulls
            };
            let placed = hulls.get_or_insert_with(|| centres.iter().enumerate().map(shape_at).collect());
            let mut own = shape(k);
            let is_clear = |position: &Vector3<f64>| (grains.is_clear)(k, position);
            position = free_position(region, &mut own, (radius, grains.margin), &cells, placed, &is_clear, random);
            placed.push(own);
        }
        let Some(position) = position else { return Err(PositionShortage { count: centres.len() }) };
        cells.add(position, radius);
        centres.push(position);
    }
    Ok(centres)
}

/// Moves the polyhedron `own`, whose ball has this radius, m, to a random position in the region, a margin (m) from its
/// boundary, at which it overlaps none of those `placed` and `is_clear` of others; returns the position.
fn free_position(
    region: &GrainRegion,
    own: &mut GrainHulls,
    (radius, margin): (f64, f64),
    cells: &SphereGrid,
    placed: &[GrainHulls],
    is_clear: &dyn Fn(&Vector3<f64>) -> bool,
    random: &mut RandomStream,
) -> Option<Vector3<f64>> {
    let halves = region.half_extents();
    let [low, high] = own.bounds();
    let [lowest, highest] = [-halves - low, halves - high];
    if (highest - lowest).min() < 0.0 {
        return None;
    }
    (0..MAX_ATTEMPTS)
        .map(|_| 0.5 * (lowest + highest + random.point_in_cube().component_mul(&(highest - lowest))))
        .find(|position| {
            own.move_to(position);
            let mut is_free = true;
            cells.for_each_overlap(position, radius, |number, _| {
                is_free = is_free && own.is_apart_from(&placed[number], margin);
            });
            is_free && own.lies_in(region, margin) && is_clear(position)
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::StreamPurpose;

    #[test]
    fn equal_spheres_reach_a_solid_fraction_of_030_but_not_040() {
        let radii = |share: f64| vec![1.0; (share * 1000.0) as usize]; // in a ball of radius 10
        let place = |share| {
            let grains = SequentialGrains { radii: &radii(share), margin: 0.0, shape: None, is_clear: &|_, _| true };
            place_one_by_one(&GrainRegion::Ball(10.0), &grains, &mut RandomStream::new(2, 0, StreamPurpose::Positions))
        };
        assert!(place(0.28).is_ok());
        // The jamming limit of random sequential placement is 0.385; the wall takes some more.
        assert!(place(0.40).unwrap_err().count < 385);
    }
}
