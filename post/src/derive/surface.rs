//! The surface of an aggregate by direction: height, effective gravity, slope.

use cd_formats::field::FieldModel;
use rayon::prelude::*;

use crate::derive::energy::external_fields;
use crate::derive::motion::AggregateSums;
use crate::derive::plane_fit::{FittedPlane, NoiseDensity, PlaneFit, without_noise};
use crate::frame::{Contact, Frame, Grain, GrainId};
use crate::math::Vec3;

/// Directions about the centre of mass: the middles of cells of equal steps of latitude and longitude.
/// z of the world points to the north pole, x to longitude 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DirectionGrid {
    pub latitudes: usize,
    /// Number of cells along a parallel; even, so that a meridian continues beyond the pole.
    pub longitudes: usize,
}

impl DirectionGrid {
    /// Cells of 5 degrees.
    pub const STANDARD: DirectionGrid = DirectionGrid { latitudes: 36, longitudes: 72 };

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.latitudes * self.longitudes
    }

    /// Whether there are no cells.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Latitude and longitude of cell k, rad: the rows from south to north, each from -pi eastwards.
    pub fn cell_angles(&self, k: usize) -> (f64, f64) {
        let (row, column) = (k / self.longitudes, k % self.longitudes);
        let share = |index: usize, count: usize| (index as f64 + 0.5) / count as f64;
        let pi = std::f64::consts::PI;
        (pi * (share(row, self.latitudes) - 0.5), 2.0 * pi * (share(column, self.longitudes) - 0.5))
    }

    /// Unit vectors of cell k outward, eastward and northward.
    pub fn cell_axes(&self, k: usize) -> [Vec3; 3] {
        let (latitude, longitude) = self.cell_angles(k);
        let ((sin_a, cos_a), (sin_o, cos_o)) = (latitude.sin_cos(), longitude.sin_cos());
        [
            Vec3::new(cos_a * cos_o, cos_a * sin_o, sin_a),
            Vec3::new(-sin_o, cos_o, 0.0),
            Vec3::new(-sin_a * cos_o, -sin_a * sin_o, cos_a),
        ]
    }

    /// Solid angle of each cell.
    fn solid_angles(&self) -> Vec<f64> {
        let (latitude_step, longitude_step) =
            (std::f64::consts::PI / self.latitudes as f64, std::f64::consts::TAU / self.longitudes as f64);
        (0..self.len())
            .map(|k| longitude_step * 2.0 * self.cell_angles(k).0.cos() * (0.5 * latitude_step).sin())
            .collect()
    }

    /// Index of the cell `north` rows and `east` columns away; beyond a pole the meridian continues on the opposite side.
    fn neighbour_cell(&self, k: usize, north: isize, east: isize) -> usize {
        let (mut row, mut column) = ((k / self.longitudes) as isize + north, (k % self.longitudes) as isize + east);
        let last = self.latitudes as isize - 1;
        if row < 0 || row > last {
            row = if row < 0 { -1 - row } else { 2 * last + 1 - row };
            column += self.longitudes as isize / 2;
        }
        row as usize * self.longitudes + column.rem_euclid(self.longitudes as isize) as usize
    }
}

/// Point of the surface in one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceFacet {
    /// Latitude and longitude, rad.
    pub latitude: f64,
    pub longitude: f64,
    /// Position, m.
    pub x: Vec3,
    /// Distance from the centre of mass, m; NaN where no ray meets a grain.
    pub height: f64,
    /// Gravity and centrifugal acceleration in the frame that moves and turns with the aggregate, m/s^2.
    pub gravity: Vec3,
    /// Area of the surface in the cell, m^2.
    pub area: f64,
    /// Angle between the outward normal and the direction against gravity, corrected for noise, rad: 0 if level, above pi/2
    /// if loose material is shed. NaN without gravity and spin, which leave no level direction.
    pub slope: f64,
    /// Standard error of the gradient due to single grains, as an angle, rad.
    pub error: f64,
}

/// Heights, effective gravity and slopes of the grains `members`, whose mass, inertia and motion are `sums`.
///
/// Rays from the centre of mass to the last surface of a sphere give the heights (a polyhedron counts as the sphere of
/// equal volume). Height and normal are those of the least-squares plane through the heights, over the arcs along the
/// surface, within `reach` mean radii ([`PlaneFit`]), at most a quarter of the circumference. Gravity is that of all grains
/// of the frame, each a solid ball, and of the primaries, and `acceleration_in_own_axes`; `constant`: G. The spin is
/// that of `sums`, in fixed axes.
pub fn aggregate_surface(
    frame: &Frame,
    members: &[GrainId],
    sums: &AggregateSums,
    constant: f64,
    grid: DirectionGrid,
    reach: f64,
) -> Vec<SurfaceFacet> {
    let grains: Vec<&Grain> = members.iter().map(|&i| &frame.grains[i]).collect();
    let ray_heights = surface_heights(&grains, sums.x, grid);
    let mean_radius = grains.iter().map(|g| g.radius).sum::<f64>() / grains.len() as f64;
    let (heights, fits, density) = fit_planes(&ray_heights, reach * mean_radius, 2.0 * mean_radius, grid);
    let fields = external_fields(frame);
    let own_acceleration = acceleration_in_own_axes(frame, members, sums, constant, &fields);
    let gravity = |x: Vec3| {
        let grains = frame.grains.iter().map(|g| ball_attraction(g, x)).sum::<Vec3>() * constant;
        grains + primary_attraction(&fields, x) + own_acceleration
    };
    let gradient = |k: usize| fits[k].map_or([f64::NAN; 2], |plane| plane.gradient);
    let mut facets = facets_of(&heights, gradient, sums.x, sums.spin(), gravity, grid);
    for (facet, fit) in facets.iter_mut().zip(&fits) {
        // Slope by the arc, divided by the distance from the centre.
        let noise = fit.map_or(f64::NAN, |plane| (density * plane.variance).sqrt() / plane.height);
        facet.error = noise.atan();
        facet.slope = without_noise(facet.slope, noise);
    }
    facets
}

/// Root mean square of the errors of a surface, as an angle, rad, weighted by area; NaN without errors.
pub fn rms_noise(facets: &[SurfaceFacet]) -> f64 {
    let known_facets = || facets.iter().filter(|facet| facet.error.is_finite() && facet.area.is_finite());
    let sum: f64 = known_facets().map(|facet| facet.area * facet.error.tan().powi(2)).sum();
    (sum / known_facets().map(|facet| facet.area).sum::<f64>()).sqrt().atan()
}

/// Uniform part of the acceleration in axes that move with the centre of mass of the grains `members`, m/s^2.
///
/// If a wall touches one of them with force, they rest in the axes of the scene: the acceleration is uniform gravity and,
/// in rotating axes, the centrifugal acceleration of their centre of mass. Otherwise they fall freely: the acceleration is
/// opposite to the mean pull of primaries and other grains, of which only tides remain, and uniform gravity has no effect.
fn acceleration_in_own_axes(
    frame: &Frame,
    members: &[GrainId],
    sums: &AggregateSums,
    constant: f64,
    fields: &[FieldModel],
) -> Vec3 {
    let mut own = vec![false; frame.grains.len()];
    members.iter().for_each(|&i| own[i.index()] = true);
    let is_support =
        |contact: &Contact| contact.grain_pair().is_none() && contact.on_grains().any(|(i, _, _)| own[i.index()]);
    if frame.active_contacts().any(is_support) {
        let turning = fields.iter().filter(|field| matches!(field, FieldModel::RotatingAxes { .. }));
        return Vec3::from(frame.meta.parameters.uniform_gravity)
            + turning.map(|f| f.acceleration_and_potential(&sums.x).0).sum::<Vec3>();
    }
    let others: Vec<&Grain> = frame.grain_ids().filter(|i| !own[i.index()]).map(|i| &frame.grains[i]).collect();
    let pull = |&i: &GrainId| {
        let grain = &frame.grains[i];
        let attraction = others.iter().map(|other| ball_attraction(other, grain.x)).sum::<Vec3>() * constant;
        (attraction + primary_attraction(fields, grain.x)) * grain.mass
    };
    // Summed in one order, independent of the number of threads.
    let pulls: Vec<Vec3> = members.par_iter().map(pull).collect();
    -pulls.iter().sum::<Vec3>() / sums.mass
}

/// Attraction by the primaries among the fields, m/s^2.
fn primary_attraction(fields: &[FieldModel], x: Vec3) -> Vec3 {
    fields
        .iter()
        .filter(|field| matches!(field, FieldModel::Primary { .. } | FieldModel::Polyhedron { .. }))
        .map(|field| field.acceleration_and_potential(&x).0)
        .sum()
}

/// Distance along each direction from `centre` to the last surface of a grain, m; NaN if no grain is hit.
pub fn surface_heights(grains: &[&Grain], centre: Vec3, grid: DirectionGrid) -> Vec<f64> {
    let height = |k: usize| {
        let [out, ..] = grid.cell_axes(k);
        let far = grains.iter().filter_map(|g| {
            let d = g.x - centre;
            let along = d.dot(&out);
            let half_chord2 = g.radius * g.radius - (d.norm_squared() - along * along);
            (half_chord2 >= 0.0).then(|| along + half_chord2.sqrt())
        });
        far.filter(|height| *height > 0.0).fold(f64::NAN, f64::max)
    };
    (0..grid.len()).into_par_iter().map(height).collect()
}

/// Planes through the raw heights over the arcs to the east and north (rad), within `length` (m) on the surface. Returns
/// their heights, the planes, and the density of the noise of single grains, from the residuals within `diameter` (m) of
/// each other, over which the noise of a grain extends.
fn fit_planes(
    raw: &[f64],
    length: f64,
    diameter: f64,
    grid: DirectionGrid,
) -> (Vec<f64>, Vec<Option<FittedPlane>>, f64) {
    let solid = grid.solid_angles();
    let known: Vec<(usize, Vec3)> =
        (0..grid.len()).filter(|&k| raw[k].is_finite()).map(|k| (k, grid.cell_axes(k)[0])).collect();
    let mean = known.iter().map(|(k, _)| raw[*k]).sum::<f64>() / known.len() as f64;
    // One reach for all: with one for each direction its own change would be a slope.
    let reach = (length / mean).min(std::f64::consts::FRAC_PI_2);
    let arcs = |k: usize, max_angle: f64| {
        let [out, east, north] = grid.cell_axes(k);
        let min_cosine = max_angle.cos();
        known.iter().filter_map(move |(j, other)| {
            let cos = out.dot(other);
            let across = [other.dot(&east), other.dot(&north)];
            let sin = across[0].hypot(across[1]);
            let stretch = if sin > 0.0 { sin.atan2(cos) / sin } else { 1.0 };
            (cos >= min_cosine).then(|| (*j, across.map(|x| x * stretch)))
        })
    };
    let plane = |k: usize| {
        let mut fit = PlaneFit::new(reach);
        arcs(k, reach).for_each(|(j, at)| fit.add(at, raw[j], solid[j]));
        fit.fitted_plane()
    };
    let fits: Vec<Option<FittedPlane>> = (0..grid.len()).into_par_iter().map(plane).collect();
    let heights: Vec<f64> = fits.iter().map(|fit| fit.map_or(f64::NAN, |plane| plane.height)).collect();
    let patch = (diameter / mean).min(reach);
    // Sum of the products of the residual of k with those in its patch, and the solid angle of the patch.
    let neighbour_products = |k: usize| {
        let (mut products, mut patch_area) = (0.0, 0.0);
        for (j, _) in arcs(k, patch).filter(|(j, _)| heights[*j].is_finite()) {
            products += (raw[k] - heights[k]) * (raw[j] - heights[j]) * solid[j];
            patch_area += solid[j];
        }
        (products, patch_area)
    };
    let has_fit = |(k, _): &&(usize, Vec3)| fits[*k].is_some();
    let patches: Vec<_> = known.par_iter().filter(has_fit).map(|(k, _)| (*k, neighbour_products(*k))).collect();
    let mut density = NoiseDensity::default();
    for (k, (products, patch_area)) in patches {
        if let Some(plane) = &fits[k] {
            density.add(solid[k], raw[k] - heights[k], products, patch_area, plane);
        }
    }
    (heights, fits, density.mean_density())
}

/// Acceleration by a solid ball divided by G, kg/m^2: m r / r^3, within it m r / R^3.
pub fn ball_attraction(grain: &Grain, x: Vec3) -> Vec3 {
    let d = grain.x - x;
    let distance = d.norm().max(grain.radius);
    d * (grain.mass / distance.powi(3))
}

/// Surface of known heights about `centre`: normals by central differences, gravity as given, the centrifugal acceleration
/// of `spin` (rad/s).
///
/// The normal of r = h u is along n = h u - (dh/dlatitude) north - (dh/dlongitude / cos latitude) east, and the area per
/// unit of solid angle is h |n|.
pub fn surface_facets(
    heights: &[f64],
    centre: Vec3,
    spin: Vec3,
    gravity: impl Fn(Vec3) -> Vec3 + Sync,
    grid: DirectionGrid,
) -> Vec<SurfaceFacet> {
    let (latitude_step, longitude_step) =
        (std::f64::consts::PI / grid.latitudes as f64, std::f64::consts::TAU / grid.longitudes as f64);
    let gradient = |k: usize| {
        let neighbour_height = |n: isize, e: isize| heights[grid.neighbour_cell(k, n, e)];
        [
            (neighbour_height(0, 1) - neighbour_height(0, -1)) / (2.0 * longitude_step * grid.cell_angles(k).0.cos()),
            (neighbour_height(1, 0) - neighbour_height(-1, 0)) / (2.0 * latitude_step),
        ]
    };
    facets_of(heights, gradient, centre, spin, gravity, grid)
}

/// Surface facets with `gradient`, the derivatives of the heights by the arc to the east and to the north, m/rad.
fn facets_of(
    heights: &[f64],
    gradient: impl Fn(usize) -> [f64; 2] + Sync,
    centre: Vec3,
    spin: Vec3,
    gravity: impl Fn(Vec3) -> Vec3 + Sync,
    grid: DirectionGrid,
) -> Vec<SurfaceFacet> {
    let solid_angles = grid.solid_angles();
    let facet = |k: usize| {
        let (latitude, longitude) = grid.cell_angles(k);
        let [out, east, north] = grid.cell_axes(k);
        let height = heights[k];
        let [to_east, to_north] = gradient(k);
        let normal = height * out - to_north * north - to_east * east;
        let x = centre + height * out;
        let effective = gravity(x) - spin.cross(&spin.cross(&(x - centre)));
        let slope = (-effective.dot(&normal) / (effective.norm() * normal.norm())).clamp(-1.0, 1.0).acos();
        SurfaceFacet {
            latitude,
            longitude,
            x,
            height,
            gravity: effective,
            area: solid_angles[k] * height * normal.norm(),
            slope,
            error: 0.0,
        }
    };
    (0..grid.len()).into_par_iter().map(facet).collect()
}

/// Quantiles of the slopes at these shares of the area, rad; empty if no slope is known.
pub fn slope_quantiles(facets: &[SurfaceFacet], shares: &[f64]) -> Vec<f64> {
    let mut known: Vec<(f64, f64)> = facets.iter().map(|f| (f.slope, f.area)).filter(|(s, _)| s.is_finite()).collect();
    known.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = known.iter().map(|(_, area)| area).sum();
    let quantile = |share: &f64| {
        let mut below = 0.0;
        let mut reached = known.iter().skip_while(|(_, area)| {
            below += area;
            below < share * total
        });
        reached.next().or(known.last()).map(|(slope, _)| *slope) // rounding may leave the sum below the total
    };
    shares.iter().filter_map(quantile).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cd_formats::compute::ExternalField;

    use crate::derive::fragments::find_fragments;
    use crate::samples::Scene;

    /// Heights of the ellipsoid with these semi-axes.
    fn ellipsoid(axes: [f64; 3], grid: DirectionGrid) -> Vec<f64> {
        let height = |k: usize| {
            let [out, ..] = grid.cell_axes(k);
            1.0 / (0..3).map(|i| (out[i] / axes[i]).powi(2)).sum::<f64>().sqrt()
        };
        (0..grid.len()).map(height).collect()
    }

    const FINE: DirectionGrid = DirectionGrid { latitudes: 90, longitudes: 180 };

    #[test]
    fn a_ball_at_rest_is_level_and_one_that_turns_slopes_to_its_equator() {
        let level = |x: Vec3| -x;
        let radius = ellipsoid([2.0; 3], FINE);
        assert!(surface_facets(&radius, Vec3::zeros(), Vec3::zeros(), level, FINE).iter().all(|f| f.slope < 1e-7));
        // g = x, w^2 = 1/2: at latitude b, along the radius 1 - cos^2 / 2, across sin cos / 2.
        let spin = Vec3::new(0.0, 0.0, 0.5f64.sqrt());
        for facet in surface_facets(&radius, Vec3::zeros(), spin, level, FINE) {
            let (sin, cos) = facet.latitude.abs().sin_cos();
            let expected = (0.5 * sin * cos).atan2(1.0 - 0.5 * cos * cos);
            assert!((facet.slope - expected).abs() < 1e-7, "{facet:?} {expected}");
        }
    }

    #[test]
    fn slopes_of_an_ellipsoid_are_those_of_its_normal() {
        let axes = [3.0, 2.0, 1.5];
        let central = |x: Vec3| -x / x.norm().powi(3);
        for facet in surface_facets(&ellipsoid(axes, FINE), Vec3::zeros(), Vec3::zeros(), central, FINE) {
            let normal = Vec3::from_fn(|i, _| facet.x[i] / (axes[i] * axes[i]));
            let expected = (normal.dot(&facet.x) / (normal.norm() * facet.x.norm())).clamp(-1.0, 1.0).acos();
            // Central differences over 2 degrees: the third derivative of the height times 0.035^2 / 6.
            assert!((facet.slope - expected).abs() < 2e-3, "{facet:?} {expected}");
        }
    }

    #[test]
    fn a_spheroid_of_maclaurin_is_level_everywhere() {
        // g_i = -2 pi G rho A_i x_i within a homogeneous spheroid; w^2 = 2 pi G rho (A_1 - A_3 (1 - e^2)).
        let e: f64 = 0.8;
        let root = (1.0 - e * e).sqrt();
        let (a1, a3) = (root / e.powi(3) * (e.asin() - e * root), 2.0 / (e * e) * (1.0 - root * e.asin() / e));
        let gravity = |x: Vec3| -Vec3::new(a1 * x.x, a1 * x.y, a3 * x.z);
        let spin = Vec3::new(0.0, 0.0, (a1 - a3 * (1.0 - e * e)).sqrt());
        let heights = ellipsoid([5.0, 5.0, 5.0 * root], FINE);
        for facet in surface_facets(&heights, Vec3::zeros(), spin, gravity, FINE) {
            assert!(facet.slope < 2e-3, "{facet:?}"); // as above
        }
        let still = surface_facets(&heights, Vec3::zeros(), Vec3::zeros(), gravity, FINE);
        assert!(still.iter().any(|facet| facet.slope > 0.1));
    }

    #[test]
    fn slopes_are_shared_out_by_the_area_of_the_surface() {
        // An oblate spheroid: 2 pi a^2 (1 + (1 - e^2) / e artanh e).
        let (a, e) = (5.0, 0.8f64);
        let heights = ellipsoid([a, a, a * (1.0 - e * e).sqrt()], FINE);
        let found = surface_facets(&heights, Vec3::zeros(), Vec3::zeros(), |x| -x, FINE);
        let area: f64 = found.iter().map(|f| f.area).sum();
        let expected = std::f64::consts::TAU * a * a * (1.0 + (1.0 - e * e) / e * e.atanh());
        // Middles of cells of 2 degrees and central differences over two of them: 0.035^2, times a number of order 1.
        assert!((area / expected - 1.0).abs() < 1e-3, "{area} {expected}");
        // g = z: on a ball the slope is the angle from the pole, (1 - cos) / 2 of the area is nearer to it.
        let found = surface_facets(&ellipsoid([2.0; 3], FINE), Vec3::zeros(), Vec3::zeros(), |_| -Vec3::z(), FINE);
        for (share, slope) in [0.1, 0.5, 0.9, 1.0].into_iter().zip(slope_quantiles(&found, &[0.1, 0.5, 0.9, 1.0])) {
            let expected = (1.0f64 - 2.0 * share).acos();
            assert!((slope - expected).abs() < 2f64.to_radians(), "{share}: {slope} {expected}"); // a cell
        }
        let weightless =
            surface_facets(&ellipsoid([2.0; 3], FINE), Vec3::zeros(), Vec3::zeros(), |_| Vec3::zeros(), FINE);
        assert!(weightless.iter().all(|f| f.slope.is_nan()) && slope_quantiles(&weightless, &[0.5]).is_empty());
    }

    #[test]
    fn a_ball_that_rests_in_turning_axes_is_pulled_to_its_equator() {
        // Same values as above: without motion in the axes, but with their rate, w^2 = G M / 2 R^3.
        let (constant, radius) = (3.0, 2.0);
        let mut scene = Scene::self_gravitating(constant);
        scene.grain([1.0, -2.0, 0.5], radius);
        let attraction = constant * scene.snapshot.bodies.body_mass[0] / (radius * radius);
        let rate = [0.0, 0.0, (0.5 * attraction / radius).sqrt()];
        scene.snapshot.meta.parameters.fields = vec![ExternalField::RotatingFrame { rate, centre: [5.0, 0.0, 0.0] }];
        let frame = scene.frame();
        let largest = &find_fragments(&frame)[0];
        for facet in aggregate_surface(&frame, &largest.grains, &largest.sums, constant, DirectionGrid::STANDARD, 3.0) {
            let (sin, cos) = facet.latitude.abs().sin_cos();
            let expected = (0.5 * sin * cos).atan2(1.0 - 0.5 * cos * cos);
            assert!((facet.slope - expected).abs() < 1e-7, "{facet:?} {expected}"); // the cosine of 1e-7 is 1 to rounding
        }
    }

    /// The surface of the largest remnant of a scene.
    fn facets_of(scene: &Scene, constant: f64) -> Vec<SurfaceFacet> {
        let frame = scene.frame();
        let largest = &find_fragments(&frame)[0];
        aggregate_surface(&frame, &largest.grains, &largest.sums, constant, DirectionGrid::STANDARD, 3.0)
    }

    #[test]
    fn what_a_wall_bears_feels_uniform_gravity_and_what_falls_does_not() {
        let mut scene = Scene::default();
        let grain = scene.grain([0.0, 0.0, 1.0], 1.0);
        let floor = scene.plate([0.0, 0.0, -0.5], [9.0, 9.0, 0.5]);
        scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -2.0];
        assert!(facets_of(&scene, 0.0).iter().all(|f| f.gravity == Vec3::zeros() && f.slope.is_nan()));
        scene.contact_at(grain, floor, [0.0; 3], Vec3::z());
        for facet in facets_of(&scene, 0.0) {
            assert_eq!(facet.gravity, Vec3::new(0.0, 0.0, -2.0));
            let expected = std::f64::consts::FRAC_PI_2 - facet.latitude; // from the pole
            assert!((facet.slope - expected).abs() < 1e-7, "{facet:?}"); // the cosine of 1e-7 is 1 to rounding
        }
        // At rest in a frame that rotates about the middle of a turntable 10 m away: w^2 r.
        let rate = [0.0, 0.0, 0.3];
        scene.snapshot.meta.parameters.fields = vec![ExternalField::RotatingFrame { rate, centre: [-10.0, 0.0, 0.0] }];
        for facet in facets_of(&scene, 0.0) {
            let expected = Vec3::new(0.09 * (facet.x.x + 10.0), 0.09 * facet.x.y, -2.0);
            assert!((facet.gravity - expected).norm() < 1e-14, "{facet:?}");
        }
    }

    #[test]
    fn tides_are_what_is_left_of_a_primary_and_of_another_fragment() {
        let (constant, distance, mass) = (1.0, 100.0, 3e4);
        let primary = |scene: &mut Scene| {
            let position = [distance, 0.0, 0.0];
            scene.snapshot.meta.parameters.fields =
                vec![ExternalField::PointMass { mass, position: Some(position), orbit: None, response: false }];
        };
        let moon = |scene: &mut Scene| {
            let moon = scene.grain([distance, 0.0, 0.0], 0.9);
            scene.snapshot.bodies.body_mass[moon] = mass;
            scene.snapshot.bodies.body_mass[0] = 2.0 * mass; // the heaviest
        };
        for pull in [&primary as &dyn Fn(&mut Scene), &moon] {
            let mut scene = Scene::self_gravitating(constant);
            scene.grain([0.0; 3], 1.0);
            pull(&mut scene);
            let own = scene.snapshot.bodies.body_mass[0];
            for facet in facets_of(&scene, constant) {
                // G M / d^3 (2 x, -y, -z), to the next order in x / d.
                let tide = mass / f64::powi(distance, 3) * Vec3::new(2.0 * facet.x.x, -facet.x.y, -facet.x.z);
                let found = facet.gravity + own * facet.x;
                assert!((found - tide).norm() < 0.05 * 2.0 * mass / f64::powi(distance, 3), "{facet:?} {tide}");
            }
        }
    }

    #[test]
    fn heights_are_those_of_the_outermost_spheres() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        scene.grain([0.0, 0.0, 3.0], 0.5);
        let frame = scene.frame();
        let grains: Vec<&Grain> = frame.grains.iter().collect();
        let found = surface_heights(&grains, Vec3::zeros(), FINE);
        assert!((found[0] - 1.0).abs() < 1e-12);
        let north = FINE.len() - 1; // a degree off the pole: 3 cos + sqrt(1/4 - 9 sin^2)
        let (sin, cos) = (std::f64::consts::PI / 180.0).sin_cos();
        assert!((found[north] - 3.0 * cos - (0.25 - 9.0 * sin * sin).sqrt()).abs() < 1e-12);
        // From a point outside all grains, a ray away from them meets nothing.
        let aside = surface_heights(&grains, Vec3::new(10.0, 0.0, 0.0), FINE);
        assert!(aside.iter().any(|h| h.is_nan()) && aside.iter().any(|h| (*h - 11.0).abs() < 0.1));
    }

    #[test]
    fn a_fine_lattice_in_a_ball_is_a_ball() {
        let (mut scene, n) = (Scene::self_gravitating(1.0), 12);
        for (i, j, k) in (-n..=n).flat_map(|i| (-n..=n).flat_map(move |j| (-n..=n).map(move |k| (i, j, k)))) {
            if i * i + j * j + k * k <= n * n {
                scene.grain([i, j, k].map(f64::from), 0.5);
            }
        }
        let frame = scene.frame();
        let members: Vec<GrainId> = frame.grain_ids().collect();
        let whole = AggregateSums::from_grains(&frame.grains);
        let found = aggregate_surface(&frame, &members, &whole, 1.0, DirectionGrid::STANDARD, 4.0);
        let mean = |of: &dyn Fn(&SurfaceFacet) -> f64| found.iter().map(of).sum::<f64>() / found.len() as f64;
        // Rays slip between the outermost spheres, so that the height is up to a unit below the lattice's 12.
        let height = mean(&|f| f.height);
        assert!((11.0..12.5).contains(&height), "{height}");
        // Contribution of the grains' own heights to slopes. The mean with weights w over heights of variance s^2,
        // independent from one grain (an area A = 1) to the next, has a gradient of mean square s^2 A int |grad w|^2 / (int
        // w)^2. For w = (1 - (r/L)^2)^2 on a disc the integrals are 4 pi / 3 and pi L^2 / 3: 12 s^2 A / (pi L^4). The
        // length of a normal vector in a plane is sqrt(pi) / 2 of its root mean square. The measured value is less, by
        // about two fifths: a gap between two grains is narrower than a grain.
        let grains: Vec<&Grain> = frame.grains.iter().collect();
        let raw = surface_heights(&grains, whole.x, DirectionGrid::STANDARD);
        let solid = |k: usize| DirectionGrid::STANDARD.cell_angles(k).0.cos();
        let weighted = |of: &dyn Fn(usize) -> f64| {
            let (sum, weight) = (0..raw.len()).fold((0.0, 0.0), |(s, w), k| (s + solid(k) * of(k), w + solid(k)));
            sum / weight
        };
        let level = weighted(&|k| raw[k]);
        let variance = weighted(&|k| (raw[k] - level).powi(2));
        let pi = std::f64::consts::PI;
        let length: f64 = 4.0 * 0.5;
        let expected = (12.0 * variance / (pi * length.powi(4))).sqrt() * pi.sqrt() / 2.0;
        let slope = weighted(&|k| found[k].slope.tan()).atan();
        assert!(slope < expected.atan(), "{slope} {expected}");
        // Below its height a ball of one grain of pi / 6 a unit of volume: g = (4 pi / 3) rho h.
        let expected = 4.0 / 3.0 * std::f64::consts::PI * std::f64::consts::FRAC_PI_6 * height;
        assert!((mean(&|f| f.gravity.norm()) / expected - 1.0).abs() < 0.05);
    }
}
