//! What the shapes of two near bodies change in their attraction, to the second order of size over distance.

use nalgebra::Matrix3;

use crate::math::Vec3;

/// A body as its neighbours feel it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rigid {
    /// kg
    pub mass: f64,
    /// About the centre of mass, along the axes of the world, kg m^2.
    pub inertia: Matrix3<f64>,
}

/// What two bodies do to each other beyond two points of their masses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    /// On the second body, N; on the first the opposite.
    pub force: Vec3,
    /// On the first and the second body about their centres, N m.
    pub torques: [Vec3; 2],
    /// J
    pub energy: f64,
}

/// From this part of the reach on it fades, so that nothing jumps where a pair comes within reach.
const FADES: f64 = 0.8;

/// The second body stands at `r` from the first, |r| > 0. With d = |r| and S = m_2 I_1 + m_1 I_2,
///
/// ```text
/// U = -G (tr S/(2 d^3) - 3 r.S r/(2 d^5)),    F = -dU/dr,    T_1 = 3 G m_2/d^5 r x I_1 r,    T_2 = 3 G m_1/d^5 r x I_2 r,
/// ```
///
/// times a factor of d that falls from 1 at 0.8 of `reach` to 0 at `reach`. F stems from U with that factor, and
/// T_1 + T_2 + r x F = 0: energy, momentum and angular momentum are kept.
/// Source: J. MacCullagh (1844), see C.D. Murray and S.F. Dermott, Solar System Dynamics (1999), ch. 5.
pub fn correction(r: &Vec3, [one, two]: [&Rigid; 2], reach: f64, constant: f64) -> Correction {
    let d2 = r.norm_squared();
    let d = d2.sqrt();
    let [of_one, of_two] = [one.inertia * r * two.mass, two.inertia * r * one.mass];
    let trace = two.mass * one.inertia.trace() + one.mass * two.inertia.trace();
    let (along, of_both) = (r.dot(&(of_one + of_two)) / d2, of_one + of_two);
    let strength = constant / (d2 * d);
    let energy = -0.5 * strength * (trace - 3.0 * along);
    let part = ((1.0 - d / reach) / (1.0 - FADES)).clamp(0.0, 1.0);
    let factor = part * part * (3.0 - 2.0 * part);
    let slope = -6.0 * part * (1.0 - part) / (reach * (1.0 - FADES));
    let force = (r * (2.5 * along - 0.5 * trace) - of_both) * (3.0 * strength / d2);
    let torque = 3.0 * strength / d2 * factor;
    Correction {
        force: force * factor - r * (energy * slope / d),
        torques: [r.cross(&of_one) * torque, r.cross(&of_two) * torque],
        energy: energy * factor,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Quat;

    /// Points of equal mass on a lattice in a box of these half lengths, turned.
    fn rock(half: [f64; 3], turn: Vec3) -> Vec<Vec3> {
        let turn = Quat::from_scaled_axis(turn);
        let counts = half.map(|h| (8.0 * h) as usize);
        let places =
            |k: usize| (0..counts[k]).map(move |i| ((i as f64 + 0.5) / counts[k] as f64 * 2.0 - 1.0) * half[k]);
        places(0).flat_map(|x| places(1).flat_map(move |y| places(2).map(move |z| turn * Vec3::new(x, y, z)))).collect()
    }

    fn rigid(points: &[Vec3]) -> Rigid {
        let inertia = points.iter().map(|x| Matrix3::identity() * x.norm_squared() - x * x.transpose()).sum();
        Rigid { mass: points.len() as f64, inertia }
    }

    /// Every point with every point: force on the second, torques.
    fn exact(r: &Vec3, one: &[Vec3], two: &[Vec3]) -> (Vec3, [Vec3; 2]) {
        let (mut force, mut torques) = (Vec3::zeros(), [Vec3::zeros(); 2]);
        for a in one {
            for b in two {
                let d = r + b - a;
                let pull = -d / d.norm().powi(3);
                force += pull;
                torques[0] -= a.cross(&pull);
                torques[1] += b.cross(&pull);
            }
        }
        (force, torques)
    }

    fn point(r: &Vec3, one: &Rigid, two: &Rigid) -> Vec3 {
        -r * (one.mass * two.mass / r.norm().powi(3))
    }

    /// Errors of force without and with the correction and of torque, all over the force.
    fn errors(r: &Vec3, one: &[Vec3], two: &[Vec3]) -> [f64; 3] {
        let (a, b) = (rigid(one), rigid(two));
        let (force, torques) = exact(r, one, two);
        let found = correction(r, [&a, &b], 1e9, 1.0);
        let plain = point(r, &a, &b);
        let turned = (found.torques[0] - torques[0]).norm() + (found.torques[1] - torques[1]).norm();
        [(plain - force).norm(), (plain + found.force - force).norm(), turned / r.norm()].map(|x| x / force.norm())
    }

    #[test]
    fn errs_to_the_fourth_order_against_a_sum_over_points() {
        let one = rock([1.0, 0.5, 0.5], Vec3::new(0.3, -0.2, 0.9));
        let two = rock([1.0, 0.75, 0.5], Vec3::new(-0.5, 1.1, 0.4));
        let along = Vec3::new(2.0, -1.0, 0.5).normalize();
        let [near, far] = [5.0, 10.0].map(|d| errors(&(along * d), &one, &two));
        let ratios = [0, 1, 2].map(|k| near[k] / far[k]);
        // Boxes have no multipoles of odd degree: twice the distance, a quarter without, a sixteenth with correction,
        // and some of the next order. A torque over the force times the distance goes the same way.
        assert!((3.8..4.3).contains(&ratios[0]), "{ratios:?}");
        assert!((14.0..19.0).contains(&ratios[1]) && (14.0..19.0).contains(&ratios[2]), "{ratios:?}");
    }

    #[test]
    fn rocks_of_two_to_one() {
        // End to end, end to side, side by side, as docs/accuracy.md has them; touching, and twice as far.
        let quarter = std::f64::consts::FRAC_PI_2;
        let long = [2.0, 1.0, 1.0];
        let cases = [
            (4.0, Vec3::zeros(), Vec3::zeros()),
            (3.0, Vec3::zeros(), Vec3::z() * quarter),
            (2.0, Vec3::z() * quarter, Vec3::z() * quarter),
        ];
        let found = cases.map(|(touching, turn_one, turn_two)| {
            let (one, two) = (rock(long, turn_one), rock(long, turn_two));
            [1.0, 2.0].map(|k| errors(&(Vec3::x() * (touching * k)), &one, &two))
        });
        for [_, [plain, corrected, _]] in found {
            assert!(corrected < 0.3 * plain, "{found:?}");
        }
        // What touches along its length is beyond a quadrupole.
        assert!(found[0][0][1] < 0.3 * found[0][0][0] && found[2][0][1] > found[2][0][0], "{found:?}");
    }

    #[test]
    fn forces_in_an_aggregate() {
        // 125 rocks of 2:1:1 on a lattice as wide as they are long, turned anyhow.
        let turn = |k: usize| Vec3::new((1.3 * k as f64).sin(), (2.1 * k as f64).sin(), (0.7 * k as f64).cos()) * 3.0;
        let rocks: Vec<Vec<Vec3>> = (0..125).map(|k| rock([1.0, 0.5, 0.5], turn(k))).collect();
        let at = |k: usize| Vec3::new((k % 5) as f64, (k / 5 % 5) as f64, (k / 25) as f64) * 1.8;
        let rigids: Vec<Rigid> = rocks.iter().map(|points| rigid(points)).collect();
        let (mut scale, mut plain_away, mut away) = (0.0, 0.0, 0.0);
        for i in 0..125 {
            let (mut true_force, mut plain, mut corrected) = (Vec3::zeros(), Vec3::zeros(), Vec3::zeros());
            for j in (0..125).filter(|&j| j != i) {
                let r = at(i) - at(j);
                true_force += exact(&r, &rocks[j], &rocks[i]).0;
                plain += point(&r, &rigids[j], &rigids[i]);
                corrected += correction(&r, [&rigids[j], &rigids[i]], 3.0 * 2.0 * 0.78, 1.0).force;
            }
            scale += true_force.norm_squared();
            plain_away += (plain - true_force).norm_squared();
            away += (plain + corrected - true_force).norm_squared();
        }
        let (plain, corrected) = ((plain_away / scale).sqrt(), (away / scale).sqrt());
        assert!(corrected < 0.5 * plain, "{plain} {corrected}");
    }

    #[test]
    fn keeps_energy_momentum_and_angular_momentum() {
        let (one, two) = (rigid(&rock([1.0, 0.5, 0.5], Vec3::y())), rigid(&rock([0.75, 0.5, 1.0], Vec3::x())));
        // Inside, where it fades, and outside.
        for d in [3.0, 4.3, 4.8, 5.5] {
            let r = Vec3::new(0.6, -0.48, 0.64) * d;
            let at = |r: &Vec3| correction(r, [&one, &two], 5.0, 2.0);
            let found = at(&r);
            let h = 1e-4;
            let slope = Vec3::from_fn(|k, _| {
                let step = Vec3::ith(k, h);
                (at(&(r + step)).energy - at(&(r - step)).energy) / (2.0 * h)
            });
            let scale = one.mass * two.mass;
            // Central differences: h^2.
            assert!((slope + found.force).norm() < 1e-7 * scale, "{d}: {slope} {}", found.force);
            let turn = found.torques[0] + found.torques[1] + r.cross(&found.force);
            assert!(turn.norm() < 1e-14 * scale, "{d}: {turn}");
            assert!(d < 5.0 || (found.force == Vec3::zeros() && found.energy == 0.0));
        }
    }
}
