//! Ranges of parameters; each test prints a line with its result, from which docs/explanation/limits.md is made.

use std::path::Path;
use std::process::Command;

use cd_formats::compute::{Accuracy, ExternalField};
use cd_formats::drv_dof::Evolution;
use cd_formats::names::short_number;
use cd_solve::limits;

use crate::case::{AXES, Case, Envelope, Figures, SearchEffort, Vec3, is_long, near, range, shown};

/// The page is written by `make extremes`; a row that has changed since then needs another run of it.
#[test]
fn the_page_has_the_rows_of_the_table() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/explanation/limits.md");
    let page = std::fs::read_to_string(path).unwrap();
    for row in limits::LIMITS {
        let [start, property] =
            [format!("| {} | {} | ", row.parameter, row.stated_text()), format!(" | {} | ", row.property)];
        let lines: Vec<&str> = page.lines().filter(|line| line.starts_with(&start)).collect();
        assert!(lines.len() == 1 && lines[0].contains(&property), "{start}: make extremes");
    }
}

/// Spheres on a floor under 8 m/s², by radius and density from below.
fn column(spheres: &[(f64, f64)]) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.gravity = [0.0, 0.0, -8.0];
    case.floor();
    let mut top = 0.0;
    for &(radius, density) in spheres {
        case.sphere_of(density, radius, [0.0, 0.0, top + radius]);
        top += 2.0 * radius;
    }
    case
}

/// Largest error of the normal forces of a column, over the weight above each.
fn away_from_weight(case: &mut Case, steps: u64) -> f64 {
    let Some(end) = case.attempt(steps) else { return f64::INFINITY };
    let count = case.bodies.len();
    let share = |level: usize| {
        // A sphere's contact with the one above has the lower as candidate; the force on it points down.
        let force = if level == 1 { end.force(1, 0) } else { end.force(level - 1, level) };
        force.map_or(0.0, |force| force.x) / (8.0 * (level..count).map(|i| end.mass(i)).sum::<f64>())
    };
    (1..count).map(|level| (share(level) - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn any_step_carries_a_column() {
    let inside: Vec<f64> = (-9..=1).map(|power| 10f64.powi(power)).collect();
    // Solved to 1e-12 in each of 20 steps.
    let found = Envelope::search(SearchEffort::SMALL, &limits::TIME_STEP, &inside, 1e-9, |multiple| {
        let h = multiple * 0.25; // √(0.5 m/8 m/s²)
        let away = [0.5, 1.0].map(|theta| {
            let mut case = column(&[(0.5, 1.0), (0.5, 2.0), (0.5, 1.0)]);
            (case.options.dt, case.options.theta) = (h, theta);
            away_from_weight(&mut case, 20)
        });
        away[0].max(away[1])
    });
    found.print();
}

#[test]
fn a_heavy_one_on_top() {
    // Gauss-Seidel alone would need as many sweeps as the ratio: the matrix solvers take it over.
    let inside = [1e-9, 1e-6, 1e-3, 1.0, 1e1, 1e2, 1e3, 1e4, 1e6];
    // 1e-12 of the weight of all, times the ratio; ten for the steps.
    let found = Envelope::search(SearchEffort::SMALL, &limits::TOP_MASS, &inside, 1e-2, |ratio| {
        let away = |h: f64| {
            let mut case = column(&[(0.5, 1.0), (0.5, 1.0), (0.5, ratio)]);
            case.options.dt = h;
            away_from_weight(&mut case, 50)
        };
        [1e-4, 1e-3, 1e-2].map(away).into_iter().fold(0.0, f64::max)
    });
    found.print();
}

#[test]
fn a_small_one_under_a_large_one() {
    let found = Envelope::search(SearchEffort::SMALL, &limits::CARRIED_SIZE, &[1e1, 1e2, 1e3], 1e-2, |ratio| {
        // What would fall beyond the small one in a step is not carried by it.
        let steps = [1e-2, 1e-3, 1e-4, 0.1 * ratio.recip().sqrt()];
        let away = |h: f64| {
            let mut case = column(&[(0.5 / ratio, 1.0), (0.5, 1.0)]);
            case.options.dt = h;
            away_from_weight(&mut case, 50)
        };
        steps.into_iter().filter(|h| 8.0 * h * h < 0.5 / ratio).map(away).fold(0.0, f64::max)
    });
    found.print();
}

#[test]
fn a_blow_of_any_ratio_of_masses() {
    let inside: Vec<f64> = (-9..=9).step_by(3).map(|power| 10f64.powi(power)).collect();
    // Rounding of up to a thousand steps.
    let found = Envelope::search(SearchEffort::SMALL, &limits::COLLIDING_MASSES, &inside, 1e-12, |ratio| {
        let away = |steps: u64| {
            let mut case = Case::new();
            case.law("RST_CLB", &[0.5, 0.0, 0.3]);
            case.options.dt = 0.1 / steps as f64;
            let ram = case.sphere_of(ratio, 0.5, [0.0; 3]);
            case.launch(ram, [1.0, 0.0, 0.0], [0.0; 3]);
            let ball = case.sphere(0.5, [1.05, 0.0, 0.0]);
            let Some(end) = case.attempt(steps) else { return f64::INFINITY };
            let (m, n) = (end.mass(ram), end.mass(ball));
            let centre = m / (m + n); // velocity of both together
            let expected = [centre - 0.5 * n / (m + n), centre + 0.5 * m / (m + n)];
            let errors = [ram, ball].into_iter().zip(expected);
            errors.map(|(body, v)| (end.v(body) - Vec3::new(v, 0.0, 0.0)).norm()).fold(0.0, f64::max)
        };
        [10, 100, 1000].map(away).into_iter().fold(0.0, f64::max)
    });
    found.print();
}

#[test]
fn what_stands_does_not_creep() {
    let steps = if is_long() { 1_000_000 } else { 5_000 };
    let mut moved = 0f64;
    for (h, steps) in [(1e-3, steps), (1e-2, steps / 10), (1e-4, steps / 10)] {
        let mut case = column(&[(0.5, 1.0), (0.5, 8.0), (0.5, 1.0)]);
        case.options.dt = h;
        let states = case.states(steps, steps);
        let way = |i: usize| (states[1].x(i) - states[0].x(i)).norm();
        moved = states[0].free().into_iter().map(way).fold(moved, f64::max);
    }
    assert!(moved < 1e-9, "{moved:e}"); // 1e-12 of h² g in each step, all one way
    shown("steps at rest", &range(&[1.0, steps as f64]), "nothing creeps, displacement over the size", moved);
}

#[test]
fn a_rod_that_jams_gives_no_energy() {
    // Solved to 1e-8 in up to a hundred steps from one state to the next.
    let found = Envelope::search(SearchEffort::NONE, &limits::JAM_TIME_STEP, &[1e-3, 1e-2], 1e-6, |h| {
        [0.5, 2.0, 10.0].map(|friction| jam_gain(h, friction)).into_iter().fold(0.0, f64::max)
    });
    found.print();
}

/// Energy that Painlevé's rod gains, over that of the start: it slides tip first over a floor so rough that no finite force lets
/// it slide on. Infinite if it becomes too fast.
fn jam_gain(h: f64, friction: f64) -> f64 {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[friction]);
    case.gravity = [0.0, 0.0, -8.0];
    case.floor();
    let (c, s) = (0.8, 0.6);
    let axes = [[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]];
    let half = [1.0, 0.05, 0.05];
    let rod = case.block(half, [0.0, 0.0, s * half[0] + c * half[2]], axes);
    case.launch(rod, [8.0, 0.0, 0.0], [0.0; 3]);
    (case.options.dt, case.options.tol) = (h, Some(1e-8));
    let count = (0.2 / h).ceil() as u64;
    let Some(states) = case.attempt_states(count, count.div_ceil(20)) else { return f64::INFINITY };
    let energy: Vec<f64> = states.iter().map(|state| state.kinetic() + state.potential()).collect();
    let gained = energy.windows(2).map(|pair| (pair[1] - pair[0]) / energy[0].abs()).fold(0.0, f64::max);
    let is_slow = states.iter().all(|state| state.v(rod).norm() <= 8.0 + 8.0 * 0.2 + 8.0);
    if is_slow { gained } else { f64::INFINITY }
}

#[test]
fn two_spheres_part_where_weight_ends() {
    // 1e-12 of the forces that cancel.
    let found = Envelope::search(SearchEffort::SMALL, &limits::PARTING_MARGIN, &[1e-4], 1e-10, |margin| {
        [1e-7, 1e-6].map(|h| parting_error(margin, h)).into_iter().fold(0.0, f64::max)
    });
    found.print();
}

/// Error of the force of two spheres that spin below the rate at which they part, over their attraction; infinite if they do not
/// part above it. In a frame that rotates with them: G m²/d² less m ω² d/2 is what presses them together.
fn parting_error(margin: f64, h: f64) -> f64 {
    let press = |share: f64| {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.5]);
        (case.options.self_gravity, case.options.gravity_constant) = (true, 1.0);
        for side in [-0.5, 0.5] {
            case.sphere(0.5, [side, 0.0, 0.0]);
        }
        let mass = std::f64::consts::PI / 6.0;
        let rate = (2.0 * mass * share).sqrt();
        case.options.fields = vec![ExternalField::RotatingFrame { rate: [0.0, 0.0, rate], centre: [0.0; 3] }];
        case.options.dt = h; // Coriolis' force makes an error of (h ω)²
        let end = case.run(20);
        end.force(0, 1).map_or(0.0, |force| force.x) / (mass * mass)
    };
    let held = press(1.0 - margin);
    if held > 0.0 && press(1.0 + margin) == 0.0 { (held - margin).abs() } else { f64::INFINITY }
}

/// Real numbers of a line as the files of LMGC90 have them: 14 columns that end in an exponent.
fn reals(line: &str) -> Vec<std::ops::Range<usize>> {
    let ends = line.match_indices('E').filter(|(k, _)| line[k + 1..].starts_with(['+', '-'])).map(|(k, _)| k + 4);
    ends.filter(|end| *end >= 14 && *end <= line.len() && line[end - 14..*end].contains('.'))
        .map(|end| end - 14..end)
        .collect()
}

#[test]
fn a_number_that_is_none_is_refused_wherever_it_stands() {
    let mut case = Case::new();
    case.law("IQS_WET_DS_CLB", &[1.0, 0.5, 0.1, 0.5, 0.5]);
    case.gravity = [0.0, 0.0, -8.0];
    case.floor();
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    case.pull(ball, 0, 1.0);
    (case.options.steps, case.options.quench) = (Some(2), 0.5);
    case.write();
    assert_eq!(case.solve(&[]), 0);
    let mut tried = 0;
    for name in ["BODIES.DAT", "BULK_BEHAV.DAT", "TACT_BEHAV.DAT", "DRV_DOF.DAT", "DOF.INI"] {
        let path = case.path().join("DATBOX").join(name);
        let sound = std::fs::read_to_string(&path).unwrap();
        let mut start = 0;
        for line in sound.split_inclusive('\n') {
            for place in reals(line) {
                for wrong in ["NaN", "Infinity", "-Infinity"] {
                    let mut text = sound.clone();
                    text.replace_range(start + place.start..start + place.end, &format!("{wrong:>14}"));
                    std::fs::write(&path, text).unwrap();
                    assert_eq!(case.solve(&["--force"]), 2, "{name}: {wrong} in {line}");
                    tried += 1;
                }
            }
            start += line.len();
        }
        std::fs::write(&path, sound).unwrap();
    }
    for option in
        ["dt", "end_time", "theta", "tol", "alert", "gravity_constant", "gravity_error", "quench", "gravity_moved"]
    {
        for wrong in ["nan", "inf", "-inf"] {
            let flag = format!("--{}={wrong}", option.replace('_', "-"));
            assert_eq!(case.solve(&["--force", &flag]), 2, "{flag}");
            tried += 1;
        }
    }
    assert!(tried > 150, "{tried}");
    assert_eq!(case.solve(&["--force"]), 0);
    shown(
        "NaN, infinity",
        "any number of any file, any option",
        "rejected; number of positions tried",
        f64::from(tried),
    );
}

#[test]
fn none_one_and_two_bodies() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    case.floor();
    case.write();
    assert_eq!(case.solve(&["--steps", "2"]), 2); // nobody is free to move
    (case.options.self_gravity, case.options.gravity_constant) = (true, 1.0);
    let mut worst = 0f64;
    for count in [1, 2] {
        case.sphere(0.5, [8.0 * f64::from(count), 0.0, 50.0]);
        for h in [1e-5, 1e-3, 1e-1f64] {
            case.options.dt = h;
            let end = case.run(10);
            // G m/d² towards the other, if there is one; on the way w it grows by 4 w/d, of which the way has a sixth.
            let pull: f64 = f64::from(count - 1) * std::f64::consts::PI / 6.0 / 64.0;
            let way: f64 = 0.5 * pull * (10.0 * h).powi(2);
            let place = Vec3::new(8.0 + way, 0.0, 50.0);
            near(end.x(1), place, 0.1 * way * way + 1e-13); // and rounding of 50 m, ten times
            worst = worst.max((end.x(1) - place).norm());
        }
    }
    let holds =
        "0 is rejected, others rest or fall towards each other, ten steps of 1e-5 to 1e-1 s; error of the position, m";
    shown("free bodies", "0, 1, 2", holds, worst);
}

/// Messages of cd-solve for a case of ten steps: of its run and of its plan.
fn messages(case: &mut Case) -> [String; 2] {
    case.options.steps = Some(10);
    case.write();
    ["--force", "--plan"].map(|flag| {
        let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).arg(flag).output().unwrap();
        assert_eq!(output.status.code(), Some(0));
        String::from_utf8(output.stdout).unwrap()
    })
}

/// A ball at rest before a plate of half lengths 3, 4 and 0 m or so.
fn before_a_plate() -> (Case, usize, usize) {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    let ball = case.sphere(0.5, [0.0, 0.0, 1e6]);
    let plate = case.plate([3.0, 4.0, 1e-9], [0.0; 3], AXES);
    (case, ball, plate)
}

#[test]
fn a_step_too_long_for_what_moves_is_reported() {
    let printed = |case: &mut Case, h: f64, reason: &str| {
        case.options.dt = 10.0 * h;
        let [run, plan] = messages(case);
        // Four times the bound suits a draft.
        assert!(
            run.contains(&format!(
                "is 2.5 times the largest step for the preset draft, {} s ({reason})",
                short_number(4.0 * h)
            )),
            "{run}"
        );
        assert!(plan.contains("is 10.0 times the strictest bound"), "{plan}");
        assert!(plan.contains(&format!("up to {} s: {reason}", short_number(h))), "{plan}");
    };
    let fast = "largest speed 1.00e5 m/s: 0.1 of the smallest radius per step";
    let (mut thrown, ball, _) = before_a_plate();
    thrown.launch(ball, [0.0, 0.0, -1e5], [0.0; 3]);
    printed(&mut thrown, 5e-7, fast);
    // At rest at first.
    let shaken = Evolution::Harmonic {
        constant: 0.0,
        amplitude: 1e5,
        omega: 1.0,
        phase: -std::f64::consts::FRAC_PI_2,
        ramp_start: 1.0,
        ramp_rate: 0.0,
    };
    let (mut struck, _, plate) = before_a_plate();
    struck.drive_along(plate, 2, shaken);
    printed(&mut struck, 5e-7, fast);
    // Where a motion depends on time all steps are `dt`.
    struck.options.accuracy = Some(Accuracy::Draft);
    assert!(!messages(&mut struck)[1].contains("of dt"));
    // A corner is 5 m from the centre; the plate's turn by 1e4 rad/s alone would allow 1e-5 s.
    let (mut swept, _, plate) = before_a_plate();
    swept.drive_along(plate, 4, Evolution::constant(2e4));
    printed(&mut swept, 5e-7, fast);

    // At rest, high above a floor.
    let mut high = Case::new();
    high.law("IQS_CLB", &[0.5]);
    high.gravity = [0.0, 0.0, -10.0];
    high.plate([3.0, 4.0, 1.0], [0.0, 0.0, -1.0], AXES);
    high.sphere(0.5, [0.0, 0.0, 100.0]);
    let fall = 1990f64.sqrt();
    printed(
        &mut high,
        0.05 / fall,
        &format!(
            "impact speed of a fall through 99.5 m, {} m/s: 0.1 of the smallest radius per step",
            short_number(fall)
        ),
    );

    let mut low = Case::new();
    low.sphere(0.5, [7e6, 0.0, 0.0]);
    low.sphere(0.5, [7e6, 0.0, 2.0]);
    low.options.fields =
        vec![ExternalField::PointMass { mass: 6e24, position: Some([0.0; 3]), orbit: None, response: false }];
    let period = std::f64::consts::TAU * (7e6f64.powi(3) / (6e24 * low.options.gravity_constant)).sqrt();
    printed(
        &mut low,
        period / 100.0,
        &format!("shortest orbital period {} s: 100 steps per orbit", short_number(period)),
    );
    low.options.fields =
        vec![ExternalField::RotatingFrame { rate: [0.0, 0.0, std::f64::consts::TAU], centre: [7e6, 0.0, 0.0] }];
    printed(&mut low, 1e-2, "rotation of a field in 1.00 s: 100 steps per rotation");

    let mut spun = Case::new();
    let cube = spun.block([0.5; 3], [0.0; 3], AXES);
    spun.launch(cube, [0.0; 3], [1000.0, 0.0, 0.0]);
    printed(&mut spun, 1e-4, "fastest rotation 1000 rad/s: 10 steps per radian");
}

#[test]
fn positions_with_too_few_digits_are_reported() {
    let printed = |out: f64| {
        let mut case = Case::new();
        case.sphere(0.5, [0.0; 3]);
        case.sphere(0.5, [0.0, -out, 0.0]);
        case.options.dt = 1e-3;
        let [run, plan] = messages(&mut case);
        let line = |text: &str| text.lines().find_map(|line| Some(line.split_once("body 2 is ")?.1.to_string()));
        assert_eq!(line(&run), line(&plan));
        line(&run)
    };
    assert_eq!(printed(1e9), None);
    let message = "1.000e15 m from the origin, where positions are rounded to 2.2e-1 m: \
                   in 10 steps round-off may displace it by 4.4e0 of its radius";
    assert_eq!(printed(1e15).as_deref(), Some(message));
}
