//! Free rotation against the exact solution by elliptic functions.

use crate::case::{Case, Figures, Vec3, near};
use crate::elliptic::{FreeRotation, jacobi};

const J: [f64; 3] = [1.0, 2.0, 2.7];

/// Euler's equations by the classical Runge-Kutta method in steps so small that its error is rounding.
fn runge_kutta(w: [f64; 3], t: f64) -> Vec3 {
    let rate = |w: &Vec3| {
        Vec3::new((J[1] - J[2]) * w.y * w.z / J[0], (J[2] - J[0]) * w.z * w.x / J[1], (J[0] - J[1]) * w.x * w.y / J[2])
    };
    let n = 20_000;
    let h = t / f64::from(n);
    (0..n).fold(Vec3::from(w), |w, _| {
        let a = rate(&w);
        let b = rate(&(w + a * (0.5 * h)));
        let c = rate(&(w + b * (0.5 * h)));
        let d = rate(&(w + c * h));
        w + (a + b * 2.0 + c * 2.0 + d) * (h / 6.0)
    })
}

#[test]
fn the_oracle_solves_eulers_equations() {
    for (u, k1) in [(0.3f64, 0.8f64), (5.0, 0.1), (-2.0, 1e-6), (40.0, 0.999)] {
        let ([sn, cn, dn], m) = (jacobi(u, k1), 1.0 - k1 * k1);
        assert!((sn * sn + cn * cn - 1.0).abs() < 1e-15 && (dn * dn + m * sn * sn - 1.0).abs() < 1e-14);
        // d sn/du = cn dn, by a central difference whose error is h².
        let slope = (jacobi(u + 1e-5, k1)[0] - jacobi(u - 1e-5, k1)[0]) / 2e-5;
        assert!((slope - cn * dn).abs() < 1e-9, "{u} {k1}: {slope} {}", cn * dn);
    }
    let signs = [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, -1.0, -1.0]];
    for size in
        [[0.3, 0.2, 1.0], [1.0, 0.2, 0.1], [0.01, 1.0, 0.01], [0.02, 1.0, 0.01], [0.0, 0.5, 1.0], [1.0, 0.0, 0.2]]
    {
        for sign in signs {
            let w = [0, 1, 2].map(|k| size[k] * sign[k]);
            let exact = FreeRotation::new(J, w);
            near(exact.at(0.0), w, 1e-14);
            near(exact.at(20.0), runge_kutta(w, 20.0), 1e-11);
        }
    }
}

/// A thousand seconds at 0.3 rad/s in steps of 0.5 s and 1 s, through the program: what must not change does not, and
/// the phase is of second order.
#[test]
fn a_free_body_keeps_energy_and_momentum() {
    let w = [0.003, 0.3, 0.003];
    let run = |h: f64| {
        let mut case = Case::new();
        let third = 1.0 / 3.0;
        let vertices = [[-third; 3], [1.0, -third, -third], [-third, 1.0, -third], [-third, -third, 1.0]];
        let body = case.polyhedron(&vertices, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], [0.0; 3]);
        case.bodies[body].inertia = Some(J);
        case.launch(body, [0.0; 3], w);
        case.options.dt = h;
        let states = case.states((1000.0 / h) as u64, (100.0 / h) as u64);
        let first = &states[0];
        for state in &states {
            // Rounding that grows as the square root of 4000 turns.
            assert!((state.kinetic() / first.kinetic() - 1.0).abs() < 1e-13, "{}", state.kinetic());
            near(
                state.own_angular_momentum(body),
                first.own_angular_momentum(body),
                1e-15 * first.own_angular_momentum(body).norm() * 4.0,
            );
        }
        Vec3::from(states.last().unwrap().bodies.body_w[body])
    };
    let exact = Vec3::from(FreeRotation::new(J, w).at(1000.0));
    let [coarse, fine] = [1.0, 0.5].map(|h| (run(h) - exact).norm());
    assert!(coarse < 0.2, "{coarse}");
    let order = (coarse / fine).log2();
    assert!((1.9..2.1).contains(&order), "{order}: {coarse} {fine}");
}
