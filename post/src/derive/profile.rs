//! Radial profiles about the centre of mass.

use crate::derive::coordination::neighbour_counts;
use crate::derive::stress::{grain_stresses, pressure};
use crate::frame::{Frame, Grain, GrainId};
use crate::math::Vec3;

/// The mean state in one spherical shell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadialShell {
    /// Inner radius, m.
    pub inner: f64,
    /// Outer radius, m.
    pub outer: f64,
    /// Share of the shell that grains fill.
    pub nu: f64,
    /// Grains with their centre in the shell.
    pub grains: u64,
    /// Mean number of neighbours that these grains touch with force; NaN without grains.
    pub z: f64,
    /// sum V_i sigma_i over the grains, each with the share of its volume that lies in the shell, divided by the volume
    /// of the shell, Pa: a third of the trace.
    pub pressure: f64,
    /// Radial component of the stress, Pa.
    pub radial: f64,
    /// Mean of the two tangential components of the stress, Pa.
    pub tangential: f64,
}

/// Sums over the grains of a shell; of those with a share of their volume in it, with this share.
#[derive(Debug, Clone, Copy, Default)]
struct ShellSums {
    /// Volume of the grains in the shell, m^3.
    filled: f64,
    /// Grains with their centre in the shell, and their neighbours.
    grains: u64,
    neighbours: f64,
    /// Volume times the pressure, and times the radial and the mean tangential stress, J.
    pressure: f64,
    radial: f64,
    tangential: f64,
}

/// Shells of equal width about `centre` out to the farthest surface of these grains.
///
/// Stresses are those of each grain ([`grain_stresses`]): the shells' stresses add up to V times the stress of the
/// whole. A polyhedron counts as the sphere of equal volume.
pub fn radial_shells(frame: &Frame, members: &[GrainId], centre: Vec3, count: usize) -> Vec<RadialShell> {
    let (stresses, neighbours) = (grain_stresses(frame), neighbour_counts(frame));
    let farthest_point = |g: &Grain| (g.x - centre).norm() + g.radius;
    let radius = members.iter().map(|&i| farthest_point(&frame.grains[i])).fold(0.0, f64::max);
    let width = radius / count as f64;
    let edges: Vec<f64> = (0..=count).map(|k| if k == count { radius } else { k as f64 * width }).collect();
    let mut sums = vec![ShellSums::default(); count];
    for &i in members {
        let grain = &frame.grains[i];
        let arm = grain.x - centre;
        let distance = arm.norm();
        // At the centre no direction is radial: the mean of all is used.
        let mean = pressure(&stresses[i.index()]);
        let radial = if distance > 0.0 { arm.dot(&(stresses[i.index()] * arm)) / (distance * distance) } else { mean };
        let own_shell = ((distance / width) as usize).min(count - 1);
        sums[own_shell].grains += 1;
        sums[own_shell].neighbours += f64::from(neighbours[i.index()]);
        let first = (((distance - grain.radius) / width).max(0.0) as usize).min(count - 1);
        let mut inner_volume = shared_volume(edges[first], grain.radius, distance);
        for k in first..count {
            let outer_volume = shared_volume(edges[k + 1], grain.radius, distance);
            let part = outer_volume - inner_volume;
            inner_volume = outer_volume;
            sums[k].filled += part;
            sums[k].pressure += part * mean;
            sums[k].radial += part * radial;
            sums[k].tangential += part * (0.5 * (3.0 * mean - radial));
            if edges[k + 1] >= distance + grain.radius {
                break;
            }
        }
    }
    let shell = |(k, sum): (usize, &ShellSums)| {
        let volume = ball_volume(edges[k + 1]) - ball_volume(edges[k]);
        RadialShell {
            inner: edges[k],
            outer: edges[k + 1],
            nu: sum.filled / volume,
            grains: sum.grains,
            z: sum.neighbours / sum.grains as f64,
            pressure: sum.pressure / volume,
            radial: sum.radial / volume,
            tangential: sum.tangential / volume,
        }
    };
    sums.iter().enumerate().map(shell).collect()
}

fn ball_volume(radius: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * radius.powi(3)
}

/// Volume that two balls of the radii `a` and `b`, their centres `d` apart, have in common, m^3.
///
/// A lens of two caps: pi (a + b - d)^2 (d^2 + 2 d (a + b) - 3 (a - b)^2) / 12 d. The whole of the
/// smaller within the other, and 0 apart.
///
/// ```
/// use cd_post::derive::profile::shared_volume;
/// // Two unit balls a distance of 1 apart: 5 pi / 12.
/// assert!((shared_volume(1.0, 1.0, 1.0) - 5.0 * std::f64::consts::PI / 12.0).abs() < 1e-15);
/// ```
pub fn shared_volume(a: f64, b: f64, d: f64) -> f64 {
    if d >= a + b {
        0.0
    } else if d <= (a - b).abs() {
        ball_volume(a.min(b))
    } else {
        std::f64::consts::PI * (a + b - d).powi(2) * (d * d + 2.0 * d * (a + b) - 3.0 * (a - b).powi(2)) / (12.0 * d)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    #[test]
    fn shells_hold_all_of_the_grains() {
        let mut scene = Scene::default();
        for k in 0..40 {
            let k = k as f64;
            scene.grain([3.0 * (7.0 * k).sin(), 3.0 * (3.0 * k).cos(), 3.0 * (5.0 * k + 1.0).sin()], 0.2 + 0.01 * k);
        }
        let frame = scene.frame();
        let members: Vec<GrainId> = (0..40).map(GrainId).collect();
        for count in [1, 3, 50] {
            let shells = radial_shells(&frame, &members, Vec3::new(0.1, 0.2, -0.3), count);
            let filled: f64 = shells.iter().map(|s| s.nu * (ball_volume(s.outer) - ball_volume(s.inner))).sum();
            let volume: f64 = frame.grains.iter().map(|g| g.volume()).sum();
            assert!((filled / volume - 1.0).abs() < 1e-12, "{filled} {volume}"); // rounding of differences
            assert_eq!(shells.iter().map(|s| s.grains).sum::<u64>(), 40);
        }
    }

    #[test]
    fn polyhedra_that_meet_in_an_edge_are_one_neighbour_each() {
        let mut scene = Scene::default();
        let (low, high) = (scene.cube([0.0; 3], 1.0), scene.cube([0.0, 0.0, 2.4], 1.0));
        for y in [-1.0, 1.0] {
            scene.contact_at(high, low, [0.0, y, 1.0], Vec3::z());
        }
        let frame = scene.frame();
        assert_eq!(radial_shells(&frame, &[low, high].map(GrainId::new), Vec3::new(0.0, 0.0, 1.2), 1)[0].z, 1.0);
    }

    #[test]
    fn a_cubic_packing_is_uniform() {
        // Simple cubic: nu = pi / 6, Z = 6 but at the surface, and the stress p of every contact force p.
        let (mut scene, side) = (Scene::default(), 13i32);
        let row = |x: [i32; 3]| (x[0] + side * (x[1] + side * x[2])) as usize;
        let sites = || (0..side.pow(3)).map(|k| [k % side, k / side % side, k / side / side]);
        for x in sites() {
            scene.grain(x.map(f64::from), 0.5);
        }
        for x in sites() {
            for axis in 0..3 {
                let mut y = x;
                y[axis] += 1;
                if y[axis] < side {
                    scene.push(row(y), row(x), 7.0);
                }
            }
        }
        let frame = scene.frame();
        let members: Vec<GrainId> = frame.grain_ids().collect();
        let shells = radial_shells(&frame, &members, Vec3::repeat(6.0), 5);
        let inner = shells[1]; // 2.2 to 4.4 of 6 to the faces
        assert_eq!(inner.z, 6.0);
        // A shell of two lattice constants contains whole cells except at its surfaces.
        assert!((inner.nu / (std::f64::consts::PI / 6.0) - 1.0).abs() < 0.03, "{inner:?}");
        for stress in [inner.pressure, inner.radial, inner.tangential] {
            assert!((stress / 7.0 - 1.0).abs() < 0.03, "{inner:?}");
        }
    }
}
