//! Scenes at the ends of what parameters can be, with what must hold there.

use cd_formats::drv_dof::Evolution;

use crate::case::{Beyond, Case, Envelope, Figures, Vec3, equal, near, range, shaken_lattice, shown};

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

/// A dozen bounces of two balls on a floor, in units of radius R and of sqrt(R/g), that many steps each unit of time.
/// None if it cannot be done.
fn bounces(steps: u32, radius: f64, g: f64, density: f64) -> Option<[Vec3; 4]> {
    let mut case = Case::new();
    case.law_of_all("RST_CLB", &[0.5, 0.25, 0.5]);
    case.gravity = [0.0, 0.0, -g];
    case.plate([1024.0 * radius, 1024.0 * radius, radius], [0.0, 0.0, -radius], [X, Y, Z]);
    case.materials[0].density = density;
    let time = (radius / g).sqrt();
    let below = case.sphere(radius, [0.0, 0.0, 1.5 * radius]);
    let above = case.sphere(radius, [0.5 * radius, 0.25 * radius, 4.0 * radius]);
    case.options.dt = time / f64::from(steps);
    case.options.tol = Some(1e-12);
    let end = case.attempt(4 * u64::from(steps))?;
    Some([end.x(below) / radius, end.x(above) / radius, end.v(below) * time / radius, end.w(above) * time])
}

#[test]
fn the_same_at_every_scale() {
    // Files have eight digits of radii, densities and g; a dozen bounces make their errors grow by as many times.
    let bound = 1e-5;
    let away = |radius: f64, g: f64, density: f64| {
        let of = |steps: u32| {
            let expected = bounces(steps, 1.0, 9.81, 2700.0).expect("the usual");
            let found = bounces(steps, radius, g, density);
            found.map_or(f64::INFINITY, |found| (0..4).map(|k| (found[k] - expected[k]).norm()).fold(0.0, f64::max))
        };
        [16, 64, 256].map(of).into_iter().fold(0.0, f64::max)
    };
    let holds = "a dozen bounces the same in units of radius and √(radius/g), difference";
    let show = |name: &str, found: Envelope| shown(name, &found.range(), holds, found.worst);
    show("radius, m", Envelope::measure(&[1e-6, 1e4], Beyond::Both, bound, |radius| away(radius, 9.81, 2700.0)));
    show("gravity, m/s²", Envelope::measure(&[9.81e-9, 9.81e4], Beyond::Both, bound, |g| away(1.0, g, 2700.0)));
    show("density, kg/m³", Envelope::measure(&[1.0, 1e5], Beyond::Both, bound, |density| away(1.0, 9.81, density)));
    // The small and heavy one under much, the large and light one under little.
    assert!(away(1e-6, 9.81e4, 1e5) <= bound && away(1e4, 9.81e-9, 1.0) <= bound);
}

#[test]
fn what_crosses_many_radii_in_a_step_is_stopped_all_the_same() {
    // Over what rounding makes of the first speed.
    let found = Envelope::measure(&[0.5, 5.0, 500.0], Beyond::Above, 1e-9, |travel| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.floor();
        case.options.dt = 0.01;
        let bullet = case.sphere(0.5, [0.0, 0.0, 600.0]);
        let speed = 0.5 * travel / case.options.dt;
        let target = case.sphere(0.5, [300.0, 0.0, 600.0]);
        let other = case.sphere(0.5, [-300.0, 0.0, 600.0]);
        case.launch(other, [speed, 0.0, 0.0], [0.0; 3]);
        case.launch(bullet, [0.0, 0.0, -speed], [0.0; 3]);
        let Some(end) = case.attempt((700.0 / (speed * case.options.dt)).ceil() as u64) else { return f64::INFINITY };
        // Not through the floor, nor the target, which it pushes: inelastic, of equal masses.
        let floor = (end.x(bullet).z - 0.5).abs();
        let passed = if end.x(target).x - end.x(other).x > 0.99 { 0.0 } else { f64::INFINITY };
        let pushed = (end.v(target) - Vec3::new(0.5 * speed, 0.0, 0.0)).norm();
        (floor + pushed) / speed + passed
    });
    shown(
        "displacement in a step over the radius",
        &found.range(),
        "under `IQS_CLB` a bullet is stopped, error of velocities",
        found.worst,
    );
}

#[test]
fn energy_never_grows_with_restitution_or_friction() {
    let steps = [1e-3, 1e-2, 1e-1];
    let mut worst = 0f64;
    for (law, parameters) in [
        ("RST_CLB", &[0.0, 0.0, 0.0][..]),
        ("RST_CLB", &[1.0, 0.0, 0.0]),
        ("RST_CLB", &[0.0, 0.0, 1e3]),
        ("RST_CLB", &[1.0, 0.0, 0.5]),
        ("RST_CLB", &[0.5, 0.5, 0.5]),
        ("IQS_CLB", &[0.0]),
        ("IQS_CLB", &[1e3]),
    ] {
        // In the longest steps several pairs collide at once, and restitution with friction may raise the energy.
        let has_both = parameters == [1.0, 0.0, 0.5];
        for &h in &steps[..if has_both { 2 } else { 3 }] {
            let mut case = Case::new();
            case.law_of_all(law, parameters);
            case.gravity = [0.0, 0.0, -8.0];
            case.tub(2.5);
            for (radius, x) in shaken_lattice(3, 7) {
                let ball = case.sphere(radius, [x[0], x[1], x[2] + 3.0]);
                case.launch(ball, [-x[0], x[1], -2.0], [1.0, 2.0, 3.0]);
            }
            case.options.dt = h;
            case.options.tol = Some(1e-8);
            let states = case.states(200, 20);
            let energy: Vec<f64> = states.iter().map(|state| state.kinetic() + state.potential()).collect();
            let scale = states[0].kinetic() + states[0].potential().abs();
            for pair in energy.windows(2) {
                // Impulses are solved to 1e-8 in each of 20 steps.
                assert!(pair[1] <= pair[0] + 20.0 * 1e-8 * scale, "{law} {parameters:?} h {h}: {energy:?}");
                worst = worst.max((pair[1] - pair[0]) / scale);
            }
        }
    }
    // Newton's law with both may raise it, since its coefficient is that of the normal velocity alone (T.R. Kane, 1984).
    let holds = |without: &str| {
        format!(
            "energy of spheres never grows without {without}, for steps of 1e-3 to 1e-1 s; by how much of it at most"
        )
    };
    shown("restitution", &range(&[0.0, 1.0]), &holds("friction"), worst);
    shown("friction", &range(&[0.0, 1e3]), &holds("restitution"), worst);
}

#[test]
fn a_spin_of_a_thousand_becomes_the_motion_of_rolling() {
    // To rounding of the first speed, 1e2 times.
    let found = Envelope::measure(&[1.0, 1e3], Beyond::Both, 1e-12, |spin| {
        let away = |steps: u64| {
            let mut case = Case::new();
            case.law_of_all("IQS_CLB", &[0.5]);
            case.gravity = [0.0, 0.0, -8.0 * spin];
            case.floor();
            let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
            case.launch(ball, [0.0; 3], [0.0, spin, 0.0]);
            case.options.dt = 0.1 / steps as f64;
            let Some(end) = case.attempt(steps) else { return f64::INFINITY };
            // Friction until v = ω R: v = 2/7 ω R.
            let speed = (end.v(ball) - Vec3::new(spin / 7.0, 0.0, 0.0)).norm() / spin;
            let turn = (end.w(ball) - Vec3::new(0.0, spin * 2.0 / 7.0, 0.0)).norm() / spin;
            speed.max(turn).max((end.x(ball).z - 0.5).abs())
        };
        [10, 100, 1000].map(away).into_iter().fold(0.0, f64::max)
    });
    shown("spin, rad/s", &found.range(), "rolls at 2/7 of it, error", found.worst);
}

#[test]
fn cohesion_far_above_weight_holds_a_chain_that_hangs() {
    // Each ball hangs by the one above; the first by a plate. Solved to 1e-12 of h times the cohesion, on half a kilogram.
    let found = Envelope::measure(&[1e1, 1e6], Beyond::Above, 1e-3, |ratio| {
        let away = |h: f64| {
            let mut case = Case::new();
            case.gravity = [0.0, 0.0, -8.0];
            case.law_of_all("IQS_WET_DS_CLB", &[ratio * 8.0 * 10.0 * 0.53, 0.0, 0.01, 0.5, 0.5]);
            case.plate([4.0, 4.0, 0.5], [0.0, 0.0, 0.5], [X, Y, Z]);
            let balls: Vec<usize> = (0..10).map(|k| case.sphere(0.5, [0.0, 0.0, -0.5 - f64::from(k)])).collect();
            case.options.dt = h;
            let Some(end) = case.attempt(200) else { return f64::INFINITY };
            let moved = |(k, &ball): (usize, &usize)| (end.x(ball).z + 0.5 + k as f64).abs() / (0.1 * h * h) * 1e-3;
            let moved = balls.iter().enumerate().map(moved).fold(0.0, f64::max);
            balls.iter().map(|&ball| end.v(ball).norm() / h).fold(moved, f64::max)
        };
        [1e-4, 1e-3, 1e-2].map(away).into_iter().fold(0.0, f64::max)
    });
    shown(
        "cohesion over weight",
        &found.range(),
        "a chain of ten hangs, E ≤ 1e-12, speed after 200 steps over h, m/s²",
        found.worst,
    );
}

/// The tolerance is relative to the load that contacts carry, not to the load that their cohesion could carry.
#[test]
fn the_tolerance_is_of_the_load_however_strong_the_cohesion() {
    let ratios = [0.0, 1e2, 1e4, 1e6];
    let mut worst = 0f64;
    for (ratio, standing) in ratios.into_iter().flat_map(|ratio| [(ratio, true), (ratio, false)]) {
        if ratio == 0.0 && !standing {
            continue;
        }
        let mut case = Case::new();
        case.gravity = [0.0, 0.0, -8.0];
        let up = if standing { 1.0 } else { -1.0 };
        let weight = 8.0 * std::f64::consts::FRAC_PI_6; // of one
        case.law_of_all("IQS_WET_DS_CLB", &[ratio * weight, 0.0, 0.01, 0.5, 0.5]);
        let plate = case.plate([4.0, 4.0, 0.5], [0.0, 0.0, -0.5 * up], [X, Y, Z]);
        let balls: Vec<usize> = (0..10).map(|k| case.sphere(0.5, [0.0, 0.0, up * (0.5 + f64::from(k))])).collect();
        case.options.dt = 1e-2;
        case.options.tol = Some(1e-2);
        let end = case.run(500);
        for (k, &ball) in balls.iter().enumerate() {
            let force = if k == 0 { end.force(ball, plate) } else { end.force(balls[k - 1], ball) };
            let expected = up * f64::from(10 - k as u32) * weight;
            let away = (end.x(ball).z - up * (0.5 + k as f64)).abs();
            assert!(away < 2e-3, "{ratio:e} {up} {k}: {away:e}"); // tol of g h² in each step, ten balls deep: 4e-2 at most
            worst = worst.max((force.unwrap_or_default().x / expected - 1.0).abs());
        }
    }
    shown(
        "cohesion over weight, E ≤ 1e-2",
        &range(&ratios),
        "ten stand or hang for 500 steps, error of the forces",
        worst,
    );
    assert!(worst < 0.1); // ten times the tolerance: the one at the end carries a tenth
}

#[test]
fn a_ball_squeezed_by_walls_stays_between_them() {
    // Nothing rigid fits: the overlap is shared, and the ball neither leaps nor becomes a number that is none.
    let mut fastest = 0f64;
    for h in [1e-3, 1e-2, 1e-1] {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        let wall = |case: &mut Case, z: f64| case.plate([4.0, 4.0, 0.5], [0.0, 0.0, z], [X, Y, Z]);
        let (below, above) = (wall(&mut case, -1.0), wall(&mut case, 1.0));
        case.drive_along(below, 2, Evolution::constant(0.1));
        case.drive_along(above, 2, Evolution::constant(-0.1));
        let ball = case.sphere(0.5, [0.0, 0.0, 0.0]);
        case.options.dt = h;
        case.options.max_sweeps = Some(500);
        for state in case.states((1.0 / h) as u64, (0.1 / h) as u64) {
            let depth = 0.1 * state.meta.time;
            assert!(state.x(ball).norm() <= depth + 1e-9 && state.v(ball).norm() <= 0.1 + 1e-9, "{}", state.v(ball));
            fastest = fastest.max(state.v(ball).norm());
        }
    }
    let holds = "between driven walls it stays, speed over theirs";
    shown("overlap of a squeezed ball over its radius", &range(&[0.0, 0.2]), holds, fastest / 0.1);
}

#[test]
fn what_is_symmetric_stays_so() {
    // Four balls in a square and one on top, under a law that lets it sink between them.
    let mut worst = 0f64;
    for steps in [100, 1000] {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.1]);
        case.gravity = [0.0, 0.0, -8.0];
        case.options.dt = 1.0 / steps as f64;
        case.floor();
        let square: Vec<usize> = [[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]]
            .iter()
            .map(|[x, y]| case.sphere(0.5, [*x, *y, 0.5]))
            .collect();
        let top = case.sphere(0.5, [0.0, 0.0, 0.5 + 0.5f64.sqrt()]);
        let end = case.run(steps);
        let turned = |v: Vec3| Vec3::new(-v.y, v.x, v.z);
        assert!(end.x(square[0]).xy().norm() > 0.75, "they part: {}", end.x(square[0]));
        for pair in square.windows(2) {
            // Contacts are solved one after the other, to 1e-12 of h g in steps that add up.
            near(end.x(pair[1]), turned(end.x(pair[0])), 1e-9);
        }
        equal(end.x(top).xy().norm(), 0.0, 1e-9);
        worst = worst.max(end.x(top).xy().norm());
    }
    let holds = "it stays symmetric while it collapses, m";
    shown("steps of a symmetric pile", &range(&[100.0, 1000.0]), holds, worst);
}

#[test]
fn a_chain_of_a_thousand_carries_itself() {
    // Under 1 m/s² from the wall at its lower end; what the last of them carries is exact to the tolerance.
    let mut worst = 0f64;
    for h in [1e-3, 1e-2] {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.gravity = [0.0, 0.0, -1.0];
        let floor = case.floor();
        let first = case.sphere(0.5, [0.0, 0.0, 0.5]);
        for k in 1..1000 {
            case.sphere(0.5, [0.0, 0.0, 0.5 + f64::from(k)]);
        }
        (case.options.tol, case.options.dt) = (Some(1e-2), h);
        let end = case.run(100);
        let weight: f64 = (first..first + 1000).map(|i| end.mass(i)).sum();
        // A hundred steps, each solved to 1e-2 of what gravity does in it from where the last one ended.
        let carried = end.force(first, floor).unwrap().x / weight;
        equal(carried, 1.0, 0.05);
        worst = worst.max((carried - 1.0).abs());
        assert!((first..first + 1000).all(|i| end.v(i).norm() < 100.0 * h));
        // Nothing slides, so that momentum carries the forces down in some hundred sweeps.
        assert!(case.column("converged").iter().all(|converged| *converged == 1.0));
    }
    shown("length of a chain", &range(&[1000.0]), "it is carried at tol 1e-2, error of the force", worst);
}
