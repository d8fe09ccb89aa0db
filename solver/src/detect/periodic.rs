//! Near pairs in a space that is periodic along x, y or both.

use std::ops::Range;

use crate::detect::swept::{self, SweptBall};
use crate::geometry::{near_pairs, near_pairs_from};
use crate::math::Vec3;

/// Steps to images such that each pair of neighbouring cells occurs once.
const IMAGE_STEPS: [[f64; 2]; 4] = [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0]];

/// All pairs i < j with images within the distance of [`near_pairs`] and i in `firsts`, each once, in an order that does not
/// depend on threads.
///
/// Positions may be anywhere; bodies near a cell's border get images beyond the opposite border.
pub fn periodic_pairs(x: &[Vec3], reach: &[f64], periods: [Option<f64>; 2], firsts: Range<u32>) -> Vec<[u32; 2]> {
    if periods == [None; 2] {
        return near_pairs_from(x, reach, firsts);
    }
    let (centres, originals) = periodic_images(x, reach, periods);
    let reaches: Vec<f64> = originals.iter().map(|&i| reach[i as usize]).collect();
    let mut pairs = pairs_of_originals(near_pairs(&centres, &reaches), x.len(), &originals);
    pairs.retain(|[first, _]| firsts.contains(first));
    pairs
}

/// Periodic version of [`swept::swept_pairs`]; `reach`: radii plus the whole length of the paths, m.
pub fn periodic_swept_pairs(balls: &[SweptBall], reach: &[f64], periods: [Option<f64>; 2]) -> Vec<[u32; 2]> {
    if periods == [None; 2] {
        return swept::swept_pairs(balls);
    }
    let x: Vec<Vec3> = balls.iter().map(|ball| ball.centre).collect();
    let (centres, originals) = periodic_images(&x, reach, periods);
    let ball_at = |(centre, &i): (&Vec3, &u32)| SweptBall { centre: *centre, ..balls[i as usize] };
    let moving: Vec<SweptBall> = centres.iter().zip(&originals).map(ball_at).collect();
    pairs_of_originals(swept::swept_pairs(&moving), x.len(), &originals)
}

/// Converts pairs of images to pairs of originals; the first `count` images are the originals.
fn pairs_of_originals(found: Vec<[u32; 2]>, count: usize, originals: &[u32]) -> Vec<[u32; 2]> {
    // A pair of two images is an image of another pair.
    let of_originals = found.into_iter().filter(|[i, _]| (*i as usize) < count);
    let mut pairs: Vec<[u32; 2]> =
        of_originals.map(|pair| pair.map(|k| originals[k as usize])).filter(|[i, j]| i != j).collect();
    pairs.iter_mut().for_each(|pair| pair.sort_unstable());
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Centres within the cell, then centres of the images that may be near, and the original of each.
fn periodic_images(x: &[Vec3], reach: &[f64], periods: [Option<f64>; 2]) -> (Vec<Vec3>, Vec<u32>) {
    let wrap = |x: f64, period: Option<f64>| period.map_or(x, |period| x - period * (x / period).round());
    let mut centres: Vec<Vec3> =
        x.iter().map(|x| Vec3::new(wrap(x.x, periods[0]), wrap(x.y, periods[1]), x.z)).collect();
    // A body that reaches across half a cell, such as a floor, gets images all around, so that small bodies need few.
    let is_wide = |reach: f64| periods.iter().flatten().any(|period| reach > 0.25 * period);
    let widest = reach.iter().copied().filter(|reach| !is_wide(*reach)).fold(0.0, f64::max);
    let steps = |wide: bool| {
        let signs: &[f64] = if wide { &[1.0, -1.0] } else { &[1.0] };
        let is_allowed = |step: &[f64; 2]| (0..2).all(|k| step[k] == 0.0 || periods[k].is_some());
        let all = IMAGE_STEPS.iter().flat_map(|step| signs.iter().map(|sign| [sign * step[0], sign * step[1]]));
        all.filter(is_allowed).collect::<Vec<_>>()
    };
    let steps = [steps(false), steps(true)];
    let mut originals: Vec<u32> = (0..x.len() as u32).collect();
    for i in 0..x.len() {
        let wide = is_wide(reach[i]);
        let is_near_cell = |at: f64, period: Option<f64>| {
            wide || period.is_none_or(|period| at.abs() <= 0.5 * period + reach[i] + widest)
        };
        for step in &steps[usize::from(wide)] {
            let move_by = Vec3::new(step[0] * periods[0].unwrap_or(0.0), step[1] * periods[1].unwrap_or(0.0), 0.0);
            let image = centres[i] + move_by;
            if is_near_cell(image.x, periods[0]) && is_near_cell(image.y, periods[1]) {
                centres.push(image);
                originals.push(i as u32);
            }
        }
    }
    (centres, originals)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn pairs_are_those_of_the_nearest_images(
            points in prop::collection::vec((-30.0..30.0f64, -30.0..30.0f64, -3.0..3.0f64, -4.0..2.5f64), 0..60),
            periods in prop::sample::select(vec![[Some(10.0), None], [None, Some(7.0)], [Some(10.0), Some(7.0)]]),
        ) {
            let x: Vec<Vec3> = points.iter().map(|p| Vec3::new(p.0, p.1, p.2)).collect();
            let reach: Vec<f64> = points.iter().map(|p| p.3.exp2()).collect();
            let nearest = |d: f64, period: Option<f64>| period.map_or(d, |p| d - p * (d / p).round());
            let mut expected = Vec::new();
            for j in 0..x.len() {
                for i in 0..j {
                    let d = x[i] - x[j];
                    let d = Vec3::new(nearest(d.x, periods[0]), nearest(d.y, periods[1]), d.z);
                    // Pairs within the rounding of the positions may go either way.
                    if (d.norm() - reach[i] - reach[j]).abs() < 1e-12 {
                        return Ok(());
                    }
                    if d.norm() <= reach[i] + reach[j] {
                        expected.push([i as u32, j as u32]);
                    }
                }
            }
            expected.sort_unstable();
            prop_assert_eq!(periodic_pairs(&x, &reach, periods, 0..u32::MAX), expected);
        }
    }
}
