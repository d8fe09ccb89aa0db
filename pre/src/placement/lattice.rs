//! Sites of a face-centred cubic lattice in a region.

use nalgebra::Vector3;

use super::region::{GrainRegion, PositionShortage};
use crate::random::RandomStream;

/// Number of random offsets of the lattice that are tried in a curved region, besides [`SYMMETRIC_OFFSETS`].
const RANDOM_OFFSETS: usize = 12;

/// Offsets of the region's centre from a site, in half edges of the cubic cell, that suit few grains: on a site, between
/// two, and in the holes between four and between six.
const SYMMETRIC_OFFSETS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.5, 0.5, 0.5], [1.0, 0.0, 0.0]];

/// Returns exactly `number` sites and their distance d (m), the largest that the region allows, at least `closest`.
///
/// The balls of diameter d about the sites touch at most and lie in the region: a grain within its site's ball overlaps
/// no other. If more than `number` sites fit, some are left out at random. `is_clear`: whether a ball about a position, m, of
/// a radius, m, overlaps no other body.
///
/// Errors: the sites at the distance `closest` are too few.
pub fn lattice_sites(
    region: &GrainRegion,
    number: usize,
    closest: f64,
    is_clear: &dyn Fn(&Vector3<f64>, f64) -> bool,
    random: &mut RandomStream,
) -> Result<(Vec<Vector3<f64>>, f64), PositionShortage> {
    let mut offsets: Vec<[f64; 3]> = SYMMETRIC_OFFSETS.to_vec();
    match region {
        GrainRegion::Box(_) => offsets.truncate(1), // lies against the box's corner
        _ => offsets.extend((0..RANDOM_OFFSETS).map(|_| <[f64; 3]>::from(random.point_in_cube()))),
    }
    let (mut best, mut largest_count) = (None, 0);
    let mut distance = closest;
    for offset in offsets {
        let site_count = |d| FccLattice { region, d, offset, is_clear }.lattice_sites(number).len();
        let count = site_count(distance);
        largest_count = largest_count.max(count);
        if count < number {
            continue;
        }
        // Bisection between a distance at which enough sites fit and one at which no site fits.
        let (mut low, mut high) = (distance, 2.001 * region.half_extents().min());
        while high - low > 1e-6 * low {
            let middle = 0.5 * (low + high);
            if site_count(middle) >= number { low = middle } else { high = middle }
        }
        distance = low;
        best = Some(offset);
    }
    let offset = best.ok_or(PositionShortage { count: largest_count })?;
    let mut sites = FccLattice { region, d: distance, offset, is_clear }.lattice_sites(usize::MAX);
    random.shuffle(&mut sites);
    sites.truncate(number);
    Ok((sites, distance))
}

/// Face-centred cubic lattice in a region.
struct FccLattice<'a> {
    region: &'a GrainRegion,
    /// Distance of neighbours, m.
    d: f64,
    /// Offset in half edges of the cubic cell.
    offset: [f64; 3],
    /// Whether a ball about a position, m, of a radius, m, overlaps no other body.
    is_clear: &'a dyn Fn(&Vector3<f64>, f64) -> bool,
}

impl FccLattice<'_> {
    /// First `at_most` sites whose balls of radius d/2 lie in the region and overlap no other body.
    fn lattice_sites(&self, at_most: usize) -> Vec<Vector3<f64>> {
        // The sites are the points of a cubic lattice of this edge whose indices have an even sum.
        let edge = self.d * std::f64::consts::FRAC_1_SQRT_2;
        let reach = self.region.half_extents().map(|half| (half - 0.5 * self.d) / edge);
        let mut sites = Vec::new();
        if reach.min() < 0.0 {
            return sites;
        }
        let offset = match self.region {
            GrainRegion::Box(_) => reach.map(|reach| 0.5 * (2.0 * reach).floor()), // layers 0, 1 ... fill the box evenly
            _ => self.offset.into(),
        };
        // Limits a row to the inside of an ellipsoid; `used_squares` is the sum of the squares of the other coordinates
        // divided by the semi-axes.
        let outer = self.region.half_extents().map(|half| half / edge);
        let squared_share = |k: usize, index: i64| match self.region {
            GrainRegion::Ball(_) | GrainRegion::Ellipsoid(_) => ((index as f64 - offset[k]) / outer[k]).powi(2),
            _ => 0.0,
        };
        // Slightly more than the reach, so that round-off loses no layer; the exact test follows.
        let indices = |k: usize, used_squares: f64| {
            let reach = if used_squares > 0.0 {
                reach[k].min(outer[k] * (1.0 - used_squares).max(0.0).sqrt())
            } else {
                reach[k]
            };
            (offset[k] - reach - 1e-9).ceil() as i64..=(offset[k] + reach + 1e-9).floor() as i64
        };
        for i in indices(0, 0.0) {
            for j in indices(1, squared_share(0, i)) {
                for k in indices(2, squared_share(0, i) + squared_share(1, j)).filter(|k| (i + j + k) % 2 == 0) {
                    let site = (Vector3::new(i as f64, j as f64, k as f64) - offset) * edge;
                    if self.region.contains_ball(&site, 0.5 * self.d) && (self.is_clear)(&site, 0.5 * self.d) {
                        sites.push(site);
                        if sites.len() >= at_most {
                            return sites;
                        }
                    }
                }
            }
        }
        sites
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::StreamPurpose;

    /// No other bodies.
    const ALL_CLEAR: fn(&Vector3<f64>, f64) -> bool = |_, _| true;

    fn random() -> RandomStream {
        RandomStream::new(1, 0, StreamPurpose::Positions)
    }

    /// Smallest distance of two points, by a search of all pairs.
    fn nearest(points: &[Vector3<f64>]) -> f64 {
        let pairs = points.iter().enumerate().flat_map(|(k, a)| points[..k].iter().map(move |b| (a - b).norm()));
        pairs.fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn exact_numbers_apart_and_inside() {
        for region in
            [GrainRegion::Ball(10.0), GrainRegion::Ellipsoid([20.0, 10.0, 5.0]), GrainRegion::Box([10.0, 8.0, 12.0])]
        {
            for number in [1, 2, 13, 100, 1000] {
                let (sites, d) = lattice_sites(&region, number, 0.1, &ALL_CLEAR, &mut random()).unwrap();
                assert_eq!(sites.len(), number);
                // Round-off of coordinates of about 10.
                assert!(nearest(&sites) >= d * (1.0 - 1e-13), "{region} {number}");
                assert!(sites.iter().all(|site| region.contains_ball(site, 0.5 * d)), "{region} {number}");
            }
        }
    }

    #[test]
    fn a_few_grains_in_a_large_region_take_no_time() {
        // A box around it would have 10^15 sites.
        for region in [GrainRegion::Ball(1e4), GrainRegion::Ellipsoid([1e4, 2e4, 5e3])] {
            assert_eq!(lattice_sites(&region, 4, 0.1, &ALL_CLEAR, &mut random()).unwrap().0.len(), 4);
        }
    }

    #[test]
    fn large_regions_are_filled_as_the_lattice_allows() {
        // The sites fill the ball that is smaller by d/2, a volume of d^3 / sqrt(2) each; the offsets
        // that were tried exceed the mean by less than 2 % of d.
        let (_, d) = lattice_sites(&GrainRegion::Ball(10.0), 5000, 0.1, &ALL_CLEAR, &mut random()).unwrap();
        let mean = (2f64.sqrt() * GrainRegion::Ball(10.0 - 0.5 * d).volume() / 5000.0).cbrt();
        assert!((1.0..1.02).contains(&(d / mean)), "{d} {mean}");
    }

    #[test]
    fn small_numbers_fit_as_tightly_as_can_be() {
        // One ball fills its region; two, four and six of radius 1 have known smallest enclosing spheres.
        for (number, radius) in [(1, 1.0), (2, 2.0), (4, 1.0 + 1.5f64.sqrt()), (6, 1.0 + 2f64.sqrt())] {
            let (_, d) =
                lattice_sites(&GrainRegion::Ball(radius * 1.0001), number, 2.0, &ALL_CLEAR, &mut random()).unwrap();
            assert!((2.0..2.001).contains(&d), "{number}: {d}");
        }
        let (_, d) = lattice_sites(&GrainRegion::Box([5.0, 5.0, 1.0]), 9, 2.0, &ALL_CLEAR, &mut random()).unwrap();
        assert_eq!(d, 2.0); // one layer
    }

    #[test]
    fn errors_give_the_number_of_sites() {
        assert_eq!(
            lattice_sites(&GrainRegion::Ball(0.9), 1, 2.0, &ALL_CLEAR, &mut random()),
            Err(PositionShortage { count: 0 })
        );
        assert_eq!(
            lattice_sites(&GrainRegion::Ball(1.5), 5, 2.0, &ALL_CLEAR, &mut random()),
            Err(PositionShortage { count: 1 })
        );
    }
}
