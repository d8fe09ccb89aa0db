//! Stress carried by the contacts.
//!
//! Positions are those of contact detection ([`Grain::x_contact`]): forces act there in the time-stepping scheme, so that
//! the balance between the pressure of the contacts and that of the virial (`Region::virial_pressure`) holds to the solver's
//! tolerance, not just to first order in the step.

use crate::derive::fabric::eigenvalues;
use crate::frame::{Frame, Grain};
use crate::math::{Mat3, Vec3};

/// Mean stress of the whole, Pa: sigma = (1/V) sum f (x) l over the contacts between grains.
///
/// f is the force on the candidate, l = x_candidate - x_antagonist the branch vector;
/// `volume` V in m^3. Row: component of f; column: component of l. Compression is positive.
/// Two grains a distance d apart that push each other with F give sigma = F d / V along their line.
///
/// Source: Love (1892); Weber (1966).
pub fn mean_stress(frame: &Frame, volume: f64) -> Mat3 {
    let sum: Mat3 = frame
        .active_contacts()
        .filter_map(|contact| {
            let (candidate, antagonist) = contact.grain_pair()?;
            let branch = frame.grains[candidate].x_contact - (frame.grains[antagonist].x_contact + contact.image);
            Some(contact.force * branch.transpose())
        })
        .sum();
    sum / volume
}

/// A third of the trace, Pa, > 0 in compression.
pub fn pressure(stress: &Mat3) -> f64 {
    stress.trace() / 3.0
}

/// Stress of the motion about the centre of mass, Pa: (1/V) sum m v' (x) v', v' = v - v_com.
///
/// It is not included in [`mean_stress`]; a third of its trace is the pressure of the motion.
pub fn kinetic_stress(grains: &[Grain], velocity: Vec3, volume: f64) -> Mat3 {
    let moment = |g: &Grain| g.mass * (g.v - velocity) * (g.v - velocity).transpose();
    grains.iter().map(moment).sum::<Mat3>() / volume
}

/// Invariants of the symmetric part of a stress.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StressInvariants {
    /// Principal stresses, largest first, Pa, > 0 in compression.
    pub principal: [f64; 3],
    /// sqrt(J_2), Pa: J_2 = s:s / 2 of the deviator s.
    pub sqrt_j2: f64,
    /// sqrt(J_2) / I_1, I_1 = tr sigma: Drucker-Prager coefficient s = 2 sin(phi) / (sqrt(3) (3 - sin(phi))) that a
    /// material without cohesion needs.
    pub drucker_prager: f64,
    /// Friction angle phi of that coefficient, rad.
    pub friction_angle: f64,
}

impl StressInvariants {
    /// Invariants of a stress. In triaxial compression (sigma_1 > sigma_2 = sigma_3) the friction angle is Mohr-Coulomb's:
    /// sin(phi) = (sigma_1 - sigma_3) / (sigma_1 + sigma_3). Source: Drucker & Prager (1952).
    pub fn new(stress: &Mat3) -> StressInvariants {
        let symmetric = 0.5 * (stress + stress.transpose());
        let trace = symmetric.trace();
        let deviator = symmetric - Mat3::from_diagonal_element(trace / 3.0);
        let sqrt_j2 = (0.5 * deviator.norm_squared()).sqrt();
        let share = sqrt_j2 / trace;
        let root = 3f64.sqrt();
        // The sine exceeds 1 if no friction alone can balance the stress, and if the mean stress is tension: not defined.
        let sine = 3.0 * root * share / (2.0 + root * share);
        let friction_angle = if (0.0..=1.0).contains(&sine) { sine.asin() } else { f64::NAN };
        StressInvariants { principal: eigenvalues(&symmetric), sqrt_j2, drucker_prager: share, friction_angle }
    }
}

/// Stress of each grain, Pa: sigma_i = (1/V_i) sum f (x) (x_i - p) over its contacts, walls too.
///
/// f is the force on grain i at the point p, x_i its centre, V_i its own volume. Compression is
/// positive. Without walls, sum V_i sigma_i = V sigma of [`mean_stress`].
///
/// Source: Weber (1966); Moreau (1997), "Numerical investigation of shear zones in granular materials".
pub fn grain_stresses(frame: &Frame) -> Vec<Mat3> {
    let mut stresses = vec![Mat3::zeros(); frame.grains.len()];
    for contact in frame.active_contacts() {
        for (i, force, image) in contact.on_grains() {
            stresses[i.index()] += force * (frame.grains[i].x_contact + image - contact.point).transpose();
        }
    }
    for (stress, grain) in stresses.iter_mut().zip(&frame.grains) {
        *stress /= grain.volume();
    }
    stresses
}

/// Share of the grains' volume in grains whose own pressure ([`grain_stresses`]) is negative: tension.
pub fn tensile_fraction(frame: &Frame) -> f64 {
    let volume: f64 = frame.grains.iter().map(Grain::volume).sum();
    let under_tension =
        grain_stresses(frame).into_iter().zip(&frame.grains).filter(|(stress, _)| pressure(stress) < 0.0);
    under_tension.map(|(_, grain)| grain.volume()).sum::<f64>() / volume
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::derive::energy::PairSummation;
    use crate::derive::fragments::find_fragments;
    use crate::derive::region::Region;
    use crate::samples::Scene;

    fn region(frame: &Frame) -> Region {
        Region::from_frame(frame, &find_fragments(frame))
    }

    fn pressures(frame: &Frame) -> (f64, f64) {
        let region = region(frame);
        (pressure(&region.stress(frame)), region.virial_pressure(frame, PairSummation::Direct))
    }

    #[track_caller]
    fn assert_close(found: f64, expected: f64) {
        assert!((found - expected).abs() <= 2e-14 * expected.abs(), "{found:e} is not {expected:e}"); // some roundings
    }

    #[test]
    fn two_spheres_under_their_own_gravity() {
        // f = G m^2 / (2r)^2 keeps them apart, W = -G m^2 / 2r.
        let (r, constant) = (0.5, 6.67430e-11);
        let mut scene = Scene::self_gravitating(constant);
        let (i, j) = (scene.grain([3.0, 0.0, 0.0], r), scene.grain([3.0 + 2.0 * r, 0.0, 0.0], r));
        let m = scene.snapshot.bodies.body_mass[i];
        scene.push(i, j, constant * m * m / (2.0 * r).powi(2));
        let frame = scene.frame();
        let expected = constant * m * m / (2.0 * r) / (3.0 * region(&frame).volume);
        let (contacts, virial) = pressures(&frame);
        assert_close(contacts, expected);
        assert_close(virial, expected);
    }

    #[test]
    fn four_spheres_in_a_tetrahedron_under_their_own_gravity() {
        // Every pair touches, so each contact carries just the pull of its own pair.
        let (r, constant) = (2f64.sqrt(), 1.0);
        let mut scene = Scene::self_gravitating(constant);
        for x in [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]] {
            scene.grain(x, r);
        }
        let m = scene.snapshot.bodies.body_mass[0];
        for i in 0..4 {
            for j in 0..i {
                scene.push(i, j, constant * m * m / (2.0 * r).powi(2));
            }
        }
        let (contacts, virial) = pressures(&scene.frame());
        assert_close(contacts, virial);
        // Isotropic: the tetrahedron has no preferred axis.
        let sigma = mean_stress(&scene.frame(), 1.0);
        assert!((sigma - Mat3::from_diagonal_element(sigma[(0, 0)])).norm() < 1e-13 * sigma.norm());
    }

    #[test]
    fn a_row_of_three_passes_the_pull_of_its_ends_through() {
        // Contact 0-1 carries the pull of 0 by 1 and by 2, which is twice as far.
        let (r, constant) = (1.0, 2.0);
        let mut scene = Scene::self_gravitating(constant);
        for k in 0..3 {
            scene.grain([2.0 * r * k as f64, 1.0, -1.0], r);
        }
        let m = scene.snapshot.bodies.body_mass[0];
        let force = constant * m * m / (4.0 * r * r) * (1.0 + 0.25);
        scene.push(0, 1, force);
        scene.push(2, 1, force);
        let (contacts, virial) = pressures(&scene.frame());
        assert_close(contacts, virial);
    }

    #[test]
    fn a_stack_on_a_floor_under_uniform_gravity() {
        let mut scene = Scene::default();
        let (g, r) = (9.81, 0.1);
        scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -g];
        let floor = scene.plate([0.0, 0.0, -0.1], [1.0, 1.0, 0.1]);
        let (low, high) = (scene.grain([0.0, 0.0, r], r), scene.grain([0.0, 0.0, 3.0 * r], r));
        let weight = scene.snapshot.bodies.body_mass[low] * g;
        scene.contact_at(floor, low, [0.0; 3], Vec3::new(0.0, 0.0, -2.0 * weight)); // force on the floor
        scene.push(high, low, weight);
        let frame = scene.frame();
        let (contacts, virial) = pressures(&frame);
        assert_close(contacts, virial);
        // The lower grain carries 2 w from below and w from above, each on an arm r.
        let stress = grain_stresses(&frame)[0];
        assert_close(stress[(2, 2)], 3.0 * weight * r / frame.grains[0].volume());
        assert_eq!(stress[(0, 0)], 0.0);
    }

    #[test]
    fn a_turning_pair_is_held_together_by_gravity_less_its_motion() {
        let (r, constant) = (1.0, 1.0);
        let mut scene = Scene::self_gravitating(constant);
        let (i, j) = (scene.grain([-r, 0.0, 0.0], r), scene.grain([r, 0.0, 0.0], r));
        let m = scene.snapshot.bodies.body_mass[i];
        let spin = 0.3 * (constant * m / (4.0 * r.powi(3))).sqrt(); // they part at 1.0
        scene.snapshot.bodies.body_v[i] = [5.0, -spin * r, 0.0];
        scene.snapshot.bodies.body_v[j] = [5.0, spin * r, 0.0];
        scene.push(i, j, constant * m * m / (4.0 * r * r) - m * spin * spin * r);
        let frame = scene.frame();
        let (contacts, virial) = pressures(&frame);
        assert_close(contacts, virial - pressure(&region(&frame).kinetic_stress(&frame)));
    }

    #[test]
    fn stresses_of_the_grains_add_up_to_that_of_the_whole() {
        let mut scene = Scene::default();
        let radii = [1.0, 0.7, 1.3];
        for (k, r) in radii.into_iter().enumerate() {
            scene.grain([k as f64 * 1.5, (k * k) as f64 * 0.4, 0.2 * k as f64], r);
        }
        scene.contact(0, 1, Vec3::new(-3.0, 0.5, 0.25));
        scene.contact(1, 2, Vec3::new(-1.0, 0.25, 2.0));
        let frame = scene.frame();
        let sum: Mat3 = grain_stresses(&frame).iter().zip(&frame.grains).map(|(s, g)| s * g.volume()).sum();
        let whole = mean_stress(&frame, 1.0);
        assert!((sum - whole).norm() < 1e-14 * whole.norm());
    }

    #[test]
    fn triaxial_compression_has_the_angle_of_mohr_and_coulomb() {
        let invariants = StressInvariants::new(&Mat3::from_diagonal(&Vec3::new(3.0, 1.0, 1.0)));
        assert_eq!(invariants.principal, [3.0, 1.0, 1.0]);
        assert_close(invariants.sqrt_j2, 2.0 / 3f64.sqrt());
        assert_close(invariants.friction_angle, (2.0f64 / 4.0).asin());
        // A uniform stress has no deviator; without stress nothing is defined.
        assert_eq!(StressInvariants::new(&Mat3::from_diagonal_element(5.0)).drucker_prager, 0.0);
        assert!(StressInvariants::new(&Mat3::zeros()).friction_angle.is_nan());
    }

    #[test]
    fn a_simple_cubic_packing_under_uniform_stress_has_that_stress() {
        // Spheres of radius 1/2 on a lattice of 1, every contact along axis k pushed by p_k: each grain feels
        // p_k on a square of 1, so its own stress is p_k divided by its volume, and the deviator is known.
        let p = [3.0, 2.0, 1.0];
        let mut scene = Scene::default();
        let side = 4;
        let row = |x: [usize; 3]| x[0] + side * (x[1] + side * x[2]);
        for k in 0..side * side * side {
            scene.grain([k % side, k / side % side, k / side / side].map(|x| x as f64), 0.5);
        }
        for k in 0..side * side * side {
            let x = [k % side, k / side % side, k / side / side];
            for axis in (0..3).filter(|&axis| x[axis] + 1 < side) {
                let mut y = x;
                y[axis] += 1;
                scene.push(row(y), row(x), p[axis]);
            }
        }
        let frame = scene.frame();
        let inner = grain_stresses(&frame)[row([1, 2, 1])] * frame.grains[0].volume();
        assert!((inner - Mat3::from_diagonal(&p.into())).norm() < 1e-14);
        // The whole has side^2 (side - 1) contacts along each axis in a volume of side^2 (side - 1).
        let whole = mean_stress(&frame, 48.0);
        assert!((whole - Mat3::from_diagonal(&p.into())).norm() < 1e-14);
        let moving = kinetic_stress(&frame.grains, Vec3::new(1.0, 0.0, 0.0), 2.0);
        assert_close(moving[(0, 0)], 0.5 * frame.total_mass());
    }

    #[test]
    fn forces_through_the_border_of_a_cell_count_like_others() {
        // Three grains in a row that comes again after 6, one contact through the border, wherever they are.
        let p = 3.0;
        let of = |first: [f64; 3]| {
            let mut scene = Scene::default();
            scene.snapshot.meta.parameters.xperiode = Some(6.0);
            scene.snapshot.meta.parameters.yperiode = Some(5.0);
            let grains = first.map(|x| scene.grain([x, 0.0, 2.0], 1.0));
            for k in 0..3 {
                let (i, j) = (grains[k], grains[(k + 1) % 3]);
                scene.contact_at(i, j, [first[k] + 1.0, 0.0, 2.0], Vec3::new(-p, 0.0, 0.0));
            }
            scene.frame()
        };
        for first in [[-2.0, 0.0, 2.0], [1.0, 3.0, 5.0], [-8.0, -6.0, -4.0], [-2.0, 6.0, 14.0]] {
            let frame = of(first);
            // The cell is as high as the grains: sigma_xx = 3 p 2 / (6 * 5 * 2).
            assert_close(region(&frame).volume, 60.0);
            assert_close(region(&frame).stress(&frame)[(0, 0)], 6.0 * p / 60.0);
            assert_close(mean_stress(&frame, 60.0)[(0, 0)], 6.0 * p / 60.0);
            for stress in grain_stresses(&frame) {
                assert_close(stress[(0, 0)] * frame.grains[0].volume(), 2.0 * p);
            }
            assert!(frame.grains.iter().all(|grain| grain.x.x.abs() <= 3.0));
            assert!(pressures(&frame).1.is_nan());
        }
    }

    #[test]
    fn forces_through_the_upper_border_of_a_cell_count_like_others() {
        // Three grains above each other in a cube of 6, one contact through the border, wherever they are.
        for first in [[-2.0, 0.0, 2.0], [1.0, 3.0, 5.0], [-8.0, 0.0, 8.0]] {
            let mut scene = Scene::default();
            let parameters = &mut scene.snapshot.meta.parameters;
            (parameters.xperiode, parameters.yperiode, parameters.zperiode) = (Some(6.0), Some(6.0), Some(6.0));
            let grains = first.map(|z| scene.grain([0.5, 0.0, z], 1.0));
            for k in 0..3 {
                let point = [0.5, 0.0, first[k] + 1.0];
                scene.contact_at(grains[k], grains[(k + 1) % 3], point, Vec3::new(0.0, 0.0, -4.0));
            }
            let frame = scene.frame();
            assert_close(region(&frame).stress(&frame)[(2, 2)], 3.0 * 4.0 * 2.0 / 216.0);
            assert!(frame.grains.iter().all(|grain| grain.x.z.abs() <= 3.0));
        }
    }

    #[test]
    fn grains_that_pull_are_under_tension() {
        let mut scene = Scene::default();
        for k in 0..4 {
            scene.grain([2.0 * k as f64, 0.0, 0.0], 1.0);
        }
        scene.push(1, 0, -3.0); // pulls
        scene.push(2, 1, 5.0);
        assert_eq!(tensile_fraction(&scene.frame()), 0.25); // grain 0 alone; 3 feels nothing
    }

    #[test]
    fn branch_vectors_are_taken_half_way_through_the_step() {
        let mut scene = Scene::default();
        scene.snapshot.meta.parameters.theta = 0.5;
        scene.snapshot.meta.h = 0.1;
        let (i, j) = (scene.grain([2.0, 0.0, 0.0], 1.0), scene.grain([0.0; 3], 1.0));
        scene.snapshot.bodies.body_v[i] = [4.0, 0.0, 0.0];
        scene.push(i, j, 10.0);
        // l = 2 - 0.5 * 0.1 * 4
        assert_close(mean_stress(&scene.frame(), 1.0)[(0, 0)], 10.0 * 1.8);
    }
}
