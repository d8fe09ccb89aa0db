//! Near pairs in a space that is periodic along one, two or three axes.

use std::ops::Range;

use cd_formats::geometry::periodic_cell::PeriodicCell;

use crate::detect::swept::{self, SweptBall};
use crate::geometry::{near_pairs, near_pairs_from};
use crate::math::Vec3;

/// Steps along the edges to images such that each pair of neighbouring cells occurs once.
const IMAGE_STEPS: [[f64; 3]; 13] = [
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [1.0, 1.0, 0.0],
    [1.0, -1.0, 0.0],
    [0.0, 0.0, 1.0],
    [1.0, 0.0, 1.0],
    [-1.0, 0.0, 1.0],
    [0.0, 1.0, 1.0],
    [0.0, -1.0, 1.0],
    [1.0, 1.0, 1.0],
    [1.0, -1.0, 1.0],
    [-1.0, 1.0, 1.0],
    [-1.0, -1.0, 1.0],
];

/// All pairs i < j with images within the distance of [`near_pairs`] and i in `firsts`, each once, in an order that does not
/// depend on threads.
///
/// Positions may be anywhere; bodies near a cell's border get images beyond the opposite border.
pub fn periodic_pairs(x: &[Vec3], reach: &[f64], cell: &PeriodicCell, firsts: Range<u32>) -> Vec<[u32; 2]> {
    if !cell.is_periodic() {
        return near_pairs_from(x, reach, firsts);
    }
    let (centres, ball_of_image) = periodic_images(x, reach, cell);
    let reaches: Vec<f64> = ball_of_image.iter().map(|&i| reach[i as usize]).collect();
    let mut pairs = pairs_of_originals(near_pairs(&centres, &reaches), x.len(), &ball_of_image);
    pairs.retain(|[first, _]| firsts.contains(first));
    pairs
}

/// Periodic version of [`swept::swept_pairs`]; `reach`: radii plus the whole length of the paths, m.
pub fn periodic_swept_pairs(balls: &[SweptBall], reach: &[f64], cell: &PeriodicCell) -> Vec<[u32; 2]> {
    if !cell.is_periodic() {
        return swept::swept_pairs(balls);
    }
    let x: Vec<Vec3> = balls.iter().map(|ball| ball.centre).collect();
    let (centres, ball_of_image) = periodic_images(&x, reach, cell);
    let ball_at = |(centre, &i): (&Vec3, &u32)| SweptBall { centre: *centre, ..balls[i as usize] };
    let moving: Vec<SweptBall> = centres.iter().zip(&ball_of_image).map(ball_at).collect();
    pairs_of_originals(swept::swept_pairs(&moving), x.len(), &ball_of_image)
}

/// Pairs of balls, i < j, from pairs of images. `ball_of_image`: ball of each image; the first `ball_count` images are the
/// balls themselves.
fn pairs_of_originals(image_pairs: Vec<[u32; 2]>, ball_count: usize, ball_of_image: &[u32]) -> Vec<[u32; 2]> {
    // A pair of two images is an image of another pair.
    let own_pairs = image_pairs.into_iter().filter(|[i, _]| (*i as usize) < ball_count);
    let mut pairs: Vec<[u32; 2]> =
        own_pairs.map(|pair| pair.map(|image| ball_of_image[image as usize])).filter(|[i, j]| i != j).collect();
    pairs.iter_mut().for_each(|pair| pair.sort_unstable());
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Centres within the cell, then centres of the images that may be near, and the index of the ball of each.
fn periodic_images(x: &[Vec3], reach: &[f64], cell: &PeriodicCell) -> (Vec<Vec3>, Vec<u32>) {
    let mut centres: Vec<Vec3> = x.iter().map(|x| x - cell.cell_origin(x)).collect();
    // A body that reaches across half a cell, such as a floor, gets images all around, so that small bodies need few.
    let widths = cell.widths();
    let is_wide = |reach: f64| widths.iter().any(|width| reach > 0.25 * width);
    let widest = reach.iter().copied().filter(|reach| !is_wide(*reach)).fold(0.0, f64::max);
    let steps = |wide: bool| {
        let signs: &[f64] = if wide { &[1.0, -1.0] } else { &[1.0] };
        let is_allowed = |step: &[f64; 3]| (0..3).all(|k| step[k] == 0.0 || cell.periods[k].is_some());
        let all = IMAGE_STEPS.iter().flat_map(|step| signs.iter().map(|sign| step.map(|steps| sign * steps)));
        all.filter(is_allowed).collect::<Vec<_>>()
    };
    let steps = [steps(false), steps(true)];
    let edges = [0, 1, 2].map(|axis| cell.edge(axis));
    let is_near_cell = |image: &Vec3, margin: f64| match cell.is_rectangular() {
        true => (0..3).all(|k| cell.periods[k].is_none_or(|period| image[k].abs() <= 0.5 * period + margin)),
        false => {
            let coordinates = cell.lattice_coordinates(image);
            (0..3).all(|k| coordinates[k].abs() <= 0.5 + margin / widths[k])
        }
    };
    let mut ball_of_image: Vec<u32> = (0..x.len() as u32).collect();
    for i in 0..x.len() {
        let wide = is_wide(reach[i]);
        for step in &steps[usize::from(wide)] {
            let image = centres[i] + edges[0] * step[0] + edges[1] * step[1] + edges[2] * step[2];
            if wide || is_near_cell(&image, reach[i] + widest) {
                centres.push(image);
                ball_of_image.push(i as u32);
            }
        }
    }
    (centres, ball_of_image)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Cells with one, two and three periods, and one that has been sheared.
    fn cells() -> Vec<PeriodicCell> {
        let (x, y, z) = (Some(10.0), Some(7.0), Some(8.0));
        let rectangular = [[x, None, None], [None, y, None], [x, y, None], [None, None, z], [x, None, z], [x, y, z]];
        let sheared = PeriodicCell { periods: [x, y, z], shears: [4.5, -3.0, 3.5] };
        rectangular.map(PeriodicCell::with_periods).into_iter().chain([sheared]).collect()
    }

    proptest! {
        #[test]
        fn pairs_are_those_of_the_nearest_images(
            points in prop::collection::vec((-30.0..30.0f64, -30.0..30.0f64, -30.0..30.0f64, -4.0..2.0f64), 0..60),
            cell in prop::sample::select(cells()),
        ) {
            let x: Vec<Vec3> = points.iter().map(|p| Vec3::new(p.0, p.1, p.2)).collect();
            // The nearest image of two balls is known up to half of the least width of the cell.
            let largest = if cell.is_rectangular() { f64::INFINITY } else { 0.2 * 7.0 };
            let reach: Vec<f64> = points.iter().map(|p| p.3.exp2().min(largest)).collect();
            let mut expected = Vec::new();
            for j in 0..x.len() {
                for i in 0..j {
                    let d = x[i] - x[j];
                    let distance = (d - cell.nearest_shift(&d)).norm();
                    // Pairs within the rounding of the positions may go either way.
                    if (distance - reach[i] - reach[j]).abs() < 1e-12 {
                        return Ok(());
                    }
                    if distance <= reach[i] + reach[j] {
                        expected.push([i as u32, j as u32]);
                    }
                }
            }
            expected.sort_unstable();
            prop_assert_eq!(periodic_pairs(&x, &reach, &cell, 0..u32::MAX), expected);
        }
    }
}
