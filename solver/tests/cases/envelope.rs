//! Scenes at the ends of what parameters can be, with what must hold there.

use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;
use cd_solve::limits;

use crate::case::{Case, Envelope, Figures, SearchEffort, Vec3, shaken_lattice};

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
    Envelope::search(SearchEffort::SMALL, &limits::RADIUS, &[1e-6, 1e4], bound, |radius| away(radius, 9.81, 2700.0))
        .print();
    Envelope::search(SearchEffort::SMALL, &limits::GRAVITY, &[1e-8, 1e5], bound, |g| away(1.0, g, 2700.0)).print();
    Envelope::search(SearchEffort::SMALL, &limits::DENSITY, &[1.0, 1e5], bound, |density| away(1.0, 9.81, density))
        .print();
    // The small and heavy one under much, the large and light one under little.
    assert!(away(1e-6, 9.81e4, 1e5) <= bound && away(1e4, 9.81e-9, 1.0) <= bound);
}

#[test]
fn what_crosses_many_radii_in_a_step_is_stopped_all_the_same() {
    // Over what rounding makes of the first speed.
    let found = Envelope::search(SearchEffort::SMALL, &limits::TRAVEL, &[0.5, 5.0], 1e-9, |travel| {
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
        // A step beyond the last impact, which may be in the first.
        let steps = (700.0 / (speed * case.options.dt)).ceil() as u64 + 1;
        let Some(end) = case.attempt(steps) else { return f64::INFINITY };
        // Not through the floor, nor the target, which it pushes: inelastic, of equal masses.
        let floor = (end.x(bullet).z - 0.5).abs();
        let passed = if end.x(target).x - end.x(other).x > 0.99 { 0.0 } else { f64::INFINITY };
        let pushed = (end.v(target) - Vec3::new(0.5 * speed, 0.0, 0.0)).norm();
        (floor + pushed) / speed + passed
    });
    found.print();
}

/// Largest gain of energy of spheres in a tub from one state to the next, over that of the start.
fn gained_energy(law: &str, parameters: &[f64], h: f64) -> f64 {
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
    let Some(states) = case.attempt_states(200, 20) else { return f64::INFINITY };
    let energy: Vec<f64> = states.iter().map(|state| state.kinetic() + state.potential()).collect();
    let scale = states[0].kinetic() + states[0].potential().abs();
    energy.windows(2).map(|pair| (pair[1] - pair[0]) / scale).fold(0.0, f64::max)
}

/// Impulses are solved to 1e-8 in each of 20 steps.
const ENERGY_GAIN_BOUND: f64 = 20.0 * 1e-8;

#[test]
fn energy_never_grows_with_restitution_or_friction() {
    let steps = [1e-3, 1e-2, 1e-1];
    let worst_gain = |law: &str, parameters: &[f64], steps: &[f64]| {
        steps.iter().map(|h| gained_energy(law, parameters, *h)).fold(0.0, f64::max)
    };
    let with_restitution = |e: f64| worst_gain("RST_CLB", &[e, 0.0, 0.0], &steps);
    Envelope::search(SearchEffort::NONE, &limits::RESTITUTION, &[0.0], ENERGY_GAIN_BOUND, with_restitution).print();
    let with_friction =
        |mu: f64| worst_gain("RST_CLB", &[0.0, 0.0, mu], &steps).max(worst_gain("IQS_CLB", &[mu], &steps));
    Envelope::search(SearchEffort::NONE, &limits::FRICTION, &[0.0], ENERGY_GAIN_BOUND, with_friction).print();
    assert!(worst_gain("RST_CLB", &[0.5, 0.5, 0.5], &steps) <= ENERGY_GAIN_BOUND);
    // Newton's law with both may raise it, since its coefficient is that of the normal velocity alone (T.R. Kane, 1984):
    // in the longest steps, in which several pairs collide at once.
    assert!(worst_gain("RST_CLB", &[1.0, 0.0, 0.5], &steps[..2]) <= ENERGY_GAIN_BOUND);
}

#[test]
fn a_spin_of_a_thousand_becomes_the_motion_of_rolling() {
    // To rounding of the first speed, 1e2 times.
    let found = Envelope::search(SearchEffort::SMALL, &limits::SPIN, &[1e-3, 1e-1], 1e-12, |turn| {
        let away = |steps: u64| {
            let spin = turn * 10.0 * steps as f64;
            let mut case = Case::new();
            case.law_of_all("IQS_CLB", &[0.5]);
            case.gravity = [0.0, 0.0, -8.0 * spin];
            // It rolls by less than a seventieth of this.
            case.plate([spin + 4.0, 4.0, 0.5], [0.0, 0.0, -0.5], [X, Y, Z]);
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
    found.print();
}

#[test]
fn cohesion_far_above_weight_holds_a_chain_that_hangs() {
    // Each ball hangs by the one above; the first by a plate. Solved to 1e-12 of h times the cohesion, on half a kilogram.
    let found = Envelope::search(SearchEffort::SMALL, &limits::COHESION, &[1e1, 1e6], 1e-3, |ratio| {
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
    found.print();
}

/// The tolerance is relative to the load that contacts carry, not to the load that their cohesion could carry.
#[test]
fn the_tolerance_is_of_the_load_however_strong_the_cohesion() {
    // Ten times the tolerance: the one at the end carries a tenth.
    let found = Envelope::search(SearchEffort::NONE, &limits::LOOSE_COHESION, &[0.0, 1e2, 1e4], 0.1, |ratio| {
        let standing = error_of_ten(ratio, true);
        // Nothing hangs without cohesion.
        if ratio == 0.0 { standing } else { standing.max(error_of_ten(ratio, false)) }
    });
    found.print();
}

/// Largest error of the forces of ten balls that stand or hang, over the force; infinite if they move.
fn error_of_ten(ratio: f64, standing: bool) -> f64 {
    let mut case = Case::new();
    case.gravity = [0.0, 0.0, -8.0];
    let up = if standing { 1.0 } else { -1.0 };
    let weight = 8.0 * std::f64::consts::FRAC_PI_6; // of one
    case.law_of_all("IQS_WET_DS_CLB", &[ratio * weight, 0.0, 0.01, 0.5, 0.5]);
    let plate = case.plate([4.0, 4.0, 0.5], [0.0, 0.0, -0.5 * up], [X, Y, Z]);
    let balls: Vec<usize> = (0..10).map(|k| case.sphere(0.5, [0.0, 0.0, up * (0.5 + f64::from(k))])).collect();
    case.options.dt = 1e-2;
    case.options.tol = Some(1e-2);
    let Some(end) = case.attempt(500) else { return f64::INFINITY };
    let error = |(k, &ball): (usize, &usize)| {
        let force = if k == 0 { end.force(ball, plate) } else { end.force(balls[k - 1], ball) };
        let expected = up * f64::from(10 - k as u32) * weight;
        let away = (end.x(ball).z - up * (0.5 + k as f64)).abs();
        // tol of g h² in each step, ten balls deep: 4e-2 at most.
        if away < 2e-3 { (force.unwrap_or_default().x / expected - 1.0).abs() } else { f64::INFINITY }
    };
    balls.iter().enumerate().map(error).fold(0.0, f64::max)
}

#[test]
fn a_ball_squeezed_by_walls_stays_between_them() {
    // Nothing rigid fits: the overlap is shared, and the ball neither leaps nor becomes a number that is none.
    let found = Envelope::search(SearchEffort::NONE, &limits::SQUEEZED_OVERLAP, &[], 1.0 + 1e-8, |overlap| {
        [1e-3, 1e-2, 1e-1].map(|h| squeezed_speed(overlap, h)).into_iter().fold(0.0, f64::max)
    });
    found.print();
}

/// Largest speed of a ball between driven walls, over theirs, until its overlaps are that much of its radius; infinite if it
/// moves from between them.
fn squeezed_speed(overlap: f64, h: f64) -> f64 {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    let wall = |case: &mut Case, z: f64| case.plate([4.0, 4.0, 0.5], [0.0, 0.0, z], [X, Y, Z]);
    let (below, above) = (wall(&mut case, -1.0), wall(&mut case, 1.0));
    let speed = 0.5 * overlap;
    case.drive_along(below, 2, Evolution::constant(speed));
    case.drive_along(above, 2, Evolution::constant(-speed));
    let ball = case.sphere(0.5, [0.0, 0.0, 0.0]);
    case.options.dt = h;
    case.options.max_sweeps = Some(500);
    let share = |state: &Snapshot| {
        let is_inside = state.x(ball).norm() <= speed * state.meta.time + 1e-9;
        if is_inside { state.v(ball).norm() / speed } else { f64::INFINITY }
    };
    let states = case.attempt_states((1.0 / h) as u64, (0.1 / h) as u64);
    states.map_or(f64::INFINITY, |states| states.iter().map(share).fold(0.0, f64::max))
}

#[test]
fn what_is_symmetric_stays_so() {
    // Contacts are solved one after the other, to 1e-12 of h g in steps that add up.
    Envelope::search(SearchEffort::NONE, &limits::SYMMETRIC_STEPS, &[], 1e-9, symmetry_error).print();
}

/// Largest distance from a symmetric position, m, of four balls in a square and one on top, under a law that lets it sink
/// between them, after 1 s; infinite if they do not part.
fn symmetry_error(steps: f64) -> f64 {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.1]);
    case.gravity = [0.0, 0.0, -8.0];
    case.options.dt = 1.0 / steps;
    case.floor();
    let square: Vec<usize> = [[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]]
        .iter()
        .map(|[x, y]| case.sphere(0.5, [*x, *y, 0.5]))
        .collect();
    let top = case.sphere(0.5, [0.0, 0.0, 0.5 + 0.5f64.sqrt()]);
    let Some(end) = case.attempt(steps.round() as u64) else { return f64::INFINITY };
    if end.x(square[0]).xy().norm() <= 0.75 {
        return f64::INFINITY;
    }
    let turned = |v: Vec3| Vec3::new(-v.y, v.x, v.z);
    let away = square.windows(2).map(|pair| (end.x(pair[1]) - turned(end.x(pair[0]))).norm());
    away.fold(end.x(top).xy().norm(), f64::max)
}

#[test]
fn a_chain_of_a_thousand_carries_itself() {
    // A hundred steps, each solved to 1e-2 of what gravity does in it from where the last one ended.
    let found = Envelope::search(SearchEffort::NONE, &limits::CHAIN_LENGTH, &[], 0.05, |length| {
        [1e-3, 1e-2].map(|h| error_of_chain(length as u32, h)).into_iter().fold(0.0, f64::max)
    });
    found.print();
}

/// Error of the force of a chain on the wall at its lower end, over its weight, at 1 m/s² after a hundred steps; infinite if it
/// moves or a step does not converge.
fn error_of_chain(length: u32, h: f64) -> f64 {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -1.0];
    let floor = case.floor();
    let balls: Vec<usize> = (0..length).map(|k| case.sphere(0.5, [0.0, 0.0, 0.5 + f64::from(k)])).collect();
    (case.options.tol, case.options.dt) = (Some(1e-2), h);
    let Some(end) = case.attempt(100) else { return f64::INFINITY };
    let weight: f64 = balls.iter().map(|&i| end.mass(i)).sum();
    let rests = balls.iter().all(|&i| end.v(i).norm() < 100.0 * h);
    // Nothing slides, so that momentum carries the forces down in some hundred sweeps.
    let converges = case.column("converged").iter().all(|converged| *converged == 1.0);
    let force = end.force(balls[0], floor).filter(|_| rests && converges);
    force.map_or(f64::INFINITY, |force| (force.x / weight - 1.0).abs())
}

#[test]
fn a_search_finds_the_limit_on_either_side() {
    let search =
        |effort, error: &mut dyn FnMut(f64) -> f64| Envelope::search_with(effort, &limits::RADIUS, &[], 1.0, error);
    let mut trials = 0;
    let found = search(SearchEffort::WHOLE, &mut |radius: f64| {
        trials += 1;
        (radius / 4.4e33).max(3.3e-31 / radius)
    });
    for ((good, bad), expected) in found.sides.into_iter().zip([3.3e-31, 4.4e33]) {
        let bad = bad.expect("a limit");
        assert!((good / expected).max(expected / good) <= 1.11 && (bad / expected).max(expected / bad) <= 1.11);
    }
    assert!(trials <= 2 + 2 * (8 + 12), "{trials}");
    // Without a limit it ends where the row says; NaN is a failure.
    assert_eq!(search(SearchEffort::WHOLE, &mut |_| 0.0).sides, [(1e-39, None), (1e39, None)]);
    let limited = search(SearchEffort::SMALL, &mut |radius: f64| if radius > 2e20 { f64::NAN } else { 1.0 });
    assert_eq!(limited.sides, [(1e-21, None), (1e20, Some(3.2e20))]);
}

#[test]
#[should_panic(expected = "radius, m: 1e20 is in the stated range, 1e-20 to 1e20: error 2e0; allowed are 1e0")]
fn a_stated_limit_beyond_the_one_found_fails() {
    Envelope::search(SearchEffort::SMALL, &limits::RADIUS, &[], 1.0, |radius| if radius > 1e19 { 2.0 } else { 0.0 });
}
