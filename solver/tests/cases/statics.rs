//! Things at rest: the forces that hold them, and that they stay.

use cd_formats::accuracy::Accuracy;

use crate::case::{Case, Figures, Vec3, equal, near};

/// Columns of spheres of radius 1/2 on a floor under 8 m/s^2, by density from below.
fn column(densities: &[f64]) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -8.0];
    case.floor();
    for (level, density) in densities.iter().enumerate() {
        case.sphere_of(*density, 0.5, [0.0, 0.0, 0.5 + level as f64]);
    }
    case
}

/// The normal forces of a column's contacts from below, over the weight above each; and the largest speed.
fn shares(case: &mut Case, steps: u64) -> (Vec<f64>, f64) {
    let end = case.run(steps);
    let count = case.bodies.len();
    let share = |level: usize| {
        // A sphere's contact with the one above has the lower as candidate; the force on it points down.
        let force = if level == 1 { end.force(1, 0) } else { end.force(level - 1, level) };
        force.unwrap().x / (8.0 * (level..count).map(|i| end.mass(i)).sum::<f64>())
    };
    ((1..count).map(share).collect(), (1..count).map(|i| end.v(i).norm()).fold(0.0, f64::max))
}

#[test]
fn a_sphere_on_a_floor_is_carried_by_its_weight() {
    for theta in [0.5, 1.0] {
        let mut case = column(&[1.0]);
        case.options.theta = theta;
        let (force, speed) = shares(&mut case, 10);
        equal(force[0], 1.0, 1e-14); // one contact: exact but for rounding
        equal(speed, 0.0, 1e-16);
    }
}

#[test]
fn a_column_carries_the_weight_above_at_every_level() {
    // Sweeps stop at 1e-12 of the first error; n levels make an error of up to n^2 of that, and rounding.
    let (force, speed) = shares(&mut column(&[1.0; 20]), 20);
    force.iter().for_each(|f| equal(*f, 1.0, 1e-9));
    assert!(speed < 1e-10);
    // Light under heavy, 1 : 1000: as many times more.
    let (force, speed) = shares(&mut column(&[1.0, 1.0, 1.0, 1000.0]), 20);
    force.iter().for_each(|f| equal(*f, 1.0, 1e-8));
    assert!(speed < 1e-9);
}

/// Three spheres of radius 1/2 on a floor, their centres 0.6 from the middle, and a fourth on top: the
/// contacts lean by a 3-4-5 triangle and the three do not touch each other.
fn pyramid(friction: f64) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[friction]);
    case.gravity = [0.0, 0.0, -8.0];
    case.floor();
    for k in 0..3 {
        let angle = std::f64::consts::TAU / 3.0 * f64::from(k) + 0.1;
        case.sphere(0.5, [0.6 * angle.cos(), 0.6 * angle.sin(), 0.5]);
    }
    case.sphere(0.5, [0.0, 0.0, 1.3]);
    case
}

#[test]
fn a_pyramid_of_four_is_held_by_the_forces_of_statics() {
    let end = pyramid(0.4).run(50);
    let weight = 8.0 * end.mass(1);
    for base in 1..4 {
        // Moments about the lower sphere's centre make its two frictions equal, T; then N sin = T (1 + cos),
        // and the top's balance N cos + T sin = W/3 gives N = W/3, T = N tan(angle/2) = W/9.
        // The solver's 1e-12 through a dozen coupled unknowns; gaps to 1e-16 m.
        let force = end.force(base, 4).unwrap();
        equal(force.x / weight, 1.0 / 3.0, 1e-9);
        equal(force.yz().norm() / weight, 1.0 / 9.0, 1e-9);
        let force = end.force(base, 0).unwrap();
        equal(force.x / weight, 4.0 / 3.0, 1e-9);
        equal(force.yz().norm() / weight, 1.0 / 9.0, 1e-9);
    }
}

#[test]
fn a_pyramid_of_four_stands_from_mu_one_third_on() {
    let sunk = |friction: f64| 1.3 - pyramid(friction).run(200).x(4).z;
    equal(sunk(1.0 / 3.0 + 1e-3), 0.0, 1e-12);
    assert!(sunk(1.0 / 3.0 - 1e-3) > 1e-6);
    // Without friction the top starts at g / (1 + 3 (4/3)^2), for it drives the three apart at 4/3 of its speed;
    // the share grows as it sinks.
    let a = 8.0 / (1.0 + 16.0 / 3.0);
    equal(pyramid(0.0).run(1).v(4).z, -a * 1e-3, 1e-9 * a);
    let fall = 0.5 * a * 0.2f64.powi(2);
    assert!((fall..1.5 * fall).contains(&sunk(0.0)), "{}", sunk(0.0));
}

#[test]
fn nothing_creeps() {
    for mut case in [pyramid(0.5), column(&[1.0, 8.0, 1.0])] {
        let states = case.states(1000, 1000);
        for i in states[0].free() {
            // The solver's 1e-12 of h g h in every step.
            near(states[1].x(i), states[0].x(i), 1e-12);
            near(states[1].v(i), Vec3::zeros(), 1e-12);
        }
    }
}

#[test]
fn at_the_usual_tolerance_a_pile_creeps_by_less_than_a_thousandth_of_its_fall() {
    let mut case = pyramid(0.5);
    case.options.tol = Some(1e-3);
    let states = case.states(1000, 1000);
    // A free fall of 1 s is 4 m.
    (1..5).for_each(|i| near(states[1].x(i), states[0].x(i), 1e-3 * 4.0));
}

/// Cubes that lie on a slope on which they hold, by tolerances at which what the last sweep has left is within E: it is swept on, and
/// does not press them in for ever.
#[test]
fn what_rests_does_not_sink_in() {
    for accuracy in [None, Some(Accuracy::Standard), Some(Accuracy::Draft)] {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.gravity = [1.0, 0.5, -8.0];
        case.floor();
        for x in [0.0, 3.0, 6.0, 9.0] {
            case.block([0.5; 3], [x, 0.0, 0.5], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        }
        (case.options.dt, case.options.accuracy) = (0.001953125, accuracy);
        (case.options.tol, case.options.penetration_tol) = (None, None);
        let end = case.run(16_384);
        // With what is left of E in the first steps they would sink in by 3e-4 to 1e-3 in these 32 s, with a hundredth of it by less than 1e-5.
        assert!(
            end.contacts.contact_gap.iter().all(|gap| *gap > -3e-5),
            "{accuracy:?}: {:?}",
            end.contacts.contact_gap
        );
        for (k, x) in [0.0, 3.0, 6.0, 9.0].into_iter().enumerate() {
            near(end.x(k + 1), [x, 0.0, 0.5], 3e-5);
        }
    }
}

#[test]
fn two_spheres_lean_on_each_other_by_their_own_gravity() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.3]);
    case.options.self_gravity = true;
    case.options.gravity_constant = 1.0;
    case.sphere_of(2.0, 0.5, [0.0; 3]);
    case.sphere_of(5.0, 0.5, [0.6, 0.0, 0.8]);
    let end = case.run(100);
    // G m1 m2 / d^2 at d = 1 m; rounding of the position.
    let force = end.mass(0) * end.mass(1);
    near(end.force(0, 1).unwrap() / force, [1.0, 0.0, 0.0], 1e-12);
    near(end.x(1), [0.6, 0.0, 0.8], 1e-13);
}

#[test]
fn a_run_reports_what_its_errors_are() {
    let message = |tol: f64| {
        let mut case = pyramid(0.5);
        case.options.tol = Some(tol);
        case.run(200);
        let text = std::fs::read_to_string(case.path().join("ERRORS.csv")).unwrap();
        let row = |line: &str| -> (String, f64) {
            let cells: Vec<&str> = line.split(',').collect();
            assert_eq!(cells.len(), 5, "{line}");
            (cells[0].to_string(), cells[2].parse().unwrap())
        };
        text.lines().skip(1).map(row).collect::<Vec<_>>()
    };
    let (loose, tight) = (message(0.1), message(1e-12));
    let names: Vec<&str> = loose.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["contacts", "step", "gravity", "narrow", "chance", "energy", "momentum", "writing"]);
    // Nothing pulls but uniform gravity, and nothing has fallen.
    assert_eq!((loose[2].1, tight[4].1 < 1e-6), (0.0, true), "{tight:?}");
    assert!(tight.iter().all(|(_, error)| *error < 1e-6) && loose[0].1 >= tight[0].1, "{loose:?} {tight:?}");
}

/// Error by chance in ERRORS.csv of a sphere that falls on plates whose normals lean by these angles, rad.
fn chance_between(lean: &[f64]) -> f64 {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.0]);
    case.gravity = [0.0, 0.0, -8.0];
    for angle in lean {
        let (sin, cos) = angle.sin_cos();
        // Touching the sphere where it comes to rest, at the origin, from which its energy counts.
        case.plate([0.5; 3], [-sin, 0.0, -cos], [[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]]);
    }
    case.sphere(0.5, [0.0, 0.0, 0.1]);
    let end = case.run(300);
    assert!(end.v(lean.len()).norm() < 1e-9);
    let text = std::fs::read_to_string(case.path().join("ERRORS.csv")).unwrap();
    let row = text.lines().find(|line| line.starts_with("chance")).unwrap();
    row.split(',').nth(2).unwrap().parse().unwrap()
}

#[test]
fn walls_may_carry_more_than_weight() {
    let floor = chance_between(&[0.0]);
    // All of the energy is taken, by one contact that holds the weight; but for a step's part of the fall, 1 ms of 158.
    equal(floor, 0.35, 1e-2);
    // Each of two carries the weight, twice of what is needed, and they push against each other: 0.35/√2, and 1/2 of the forces of two.
    let third = std::f64::consts::FRAC_PI_3;
    equal(chance_between(&[third, -third]), (0.35 + 0.5) * 0.5f64.sqrt(), 1e-2);
}
