//! Order of grains along the Z-curve.

use nalgebra::Vector3;

use super::region::GrainRegion;

/// Order of the points along the Z-curve (Morton 1966) through the region's box.
pub fn z_order(region: &GrainRegion, points: &[Vector3<f64>]) -> Vec<usize> {
    const BITS: u32 = 20; // a millionth of the region's length
    let halves = region.half_extents();
    let code = |point: &Vector3<f64>| {
        let cell = |k: usize| ((0.5 + 0.5 * point[k] / halves[k]) * f64::from(1u32 << BITS)) as u64;
        let cells = [cell(0), cell(1), cell(2)];
        (0..3 * BITS).rev().fold(0u64, |code, bit| code << 1 | cells[(bit % 3) as usize] >> (bit / 3) & 1)
    };
    let mut order: Vec<(u64, usize)> = points.iter().map(code).zip(0..).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, k)| k).collect()
}
