//! A scene does not pay for what it has not: instructions by function, counted by valgrind. Without valgrind these tests
//! only say so; with CD_REQUIRE_VALGRIND=1 that is an error.

use std::path::Path;
use std::process::Command;

use cd_formats::compute::Adaptive;
use cd_formats::drv_dof::Evolution;

use crate::case::{Case, shaken_lattice};

/// Functions of models that some scenes have not.
const POLYHEDRA: &[&str] = &[
    "cd_solve::geometry::gjk::",
    "cd_solve::geometry::outline::",
    "cd_solve::geometry::patch::",
    "cd_solve::geometry::polyhedra::",
    "cd_solve::geometry::polyhedron::",
    "cd_solve::geometry::search::",
    "cd_solve::detect::parts::",
    "cd_solve::detect::posed::",
    "cd_solve::solve::gauss_seidel::block::",
];
const GRAVITY: &[&str] = &["cd_solve::gravity::"];
const ROLLING: &[&str] = &["cd_solve::solve::gauss_seidel::rolling::"];
const FREE_ROTATION: &[&str] = &["cd_solve::math::rotation::"];

/// Instructions of a run by function, or none where valgrind is not there.
fn counted(case: &Path) -> Option<Vec<(String, u64)>> {
    let out = case.join("callgrind.out");
    let done = Command::new("valgrind")
        .args(["--tool=callgrind", &format!("--callgrind-out-file={}", out.display())])
        .arg(env!("CARGO_BIN_EXE_cd-solve"))
        .arg(case)
        .args(["--threads", "1"])
        .output();
    let Ok(done) = done else {
        let required = std::env::var("CD_REQUIRE_VALGRIND").is_ok_and(|value| value == "1");
        assert!(!required, "valgrind is not there");
        eprintln!("valgrind is not there: nothing is counted");
        return None;
    };
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let text = std::fs::read_to_string(out).unwrap();
    let mut names = std::collections::HashMap::new();
    let mut costs: std::collections::BTreeMap<String, u64> = Default::default();
    let (mut current, mut of_call) = (String::new(), false);
    for line in text.lines() {
        if let Some(name) = line.strip_prefix("fn=") {
            // (id) name at first, then (id) alone.
            let (id, name) = name.split_once(' ').unwrap_or((name, ""));
            let known = names.entry(id.to_string()).or_insert_with(|| name.to_string());
            if !name.is_empty() {
                *known = name.to_string();
            }
            current.clone_from(known);
        } else if let Some(name) = line.strip_prefix("cfn=") {
            if let Some((id, name)) = name.split_once(' ') {
                names.insert(id.to_string(), name.to_string());
            }
        } else if line.starts_with("calls=") {
            of_call = true;
        } else if line.starts_with(|c: char| c.is_ascii_digit() || "+-*".contains(c)) {
            let cost = line.split(' ').nth(1).and_then(|cost| cost.parse::<u64>().ok());
            // The line after a call has what was spent inside of it.
            if !std::mem::take(&mut of_call) {
                *costs.entry(current.clone()).or_default() += cost.unwrap_or(0);
            }
        }
    }
    Some(costs.into_iter().collect())
}

fn spent(costs: &[(String, u64)], on: &[&str]) -> u64 {
    let is_one = |name: &str| on.iter().any(|start| name.trim_start_matches('<').starts_with(start));
    costs.iter().filter(|(name, _)| is_one(name)).map(|(_, cost)| cost).sum()
}

/// Balls, or as many cubes, in a tub, that fall for twenty steps and touch.
fn scene(cubes: bool, law: &str, parameters: &[f64]) -> Case {
    let mut case = Case::new();
    case.law_of_all(law, parameters);
    case.gravity = [0.0, 0.0, -8.0];
    case.tub(2.0);
    for (radius, x) in shaken_lattice(3, 5) {
        let x = [x[0], x[1], x[2] + 1.7];
        match cubes {
            true => case.block(
                [0.4 * radius, 0.5 * radius, 0.6 * radius],
                x,
                [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            ),
            false => case.sphere(radius, x),
        };
    }
    (case.options.dt, case.options.tol, case.options.steps) = (0.01, Some(1e-4), Some(40));
    case
}

/// Instructions of the scene's run.
fn allocations_of(case: &Case) -> Option<Vec<(String, u64)>> {
    case.write();
    counted(&case.path())
}

#[test]
fn balls_do_not_pay_for_what_they_have_not() {
    let Some(balls) = allocations_of(&scene(false, "IQS_CLB", &[0.5])) else { return };
    let all: u64 = balls.iter().map(|(_, cost)| cost).sum();
    assert!(all > 1_000_000 && spent(&balls, &["cd_solve::"]) > 0, "{all}"); // a check of the check
    // Plates are read as cuboids, too; no step has anything of it.
    let mut short = scene(false, "IQS_CLB", &[0.5]);
    short.options.steps = Some(10);
    let short = allocations_of(&short).unwrap();
    assert!(spent(&short, &["cd_solve::"]) < spent(&balls, &["cd_solve::"]));
    for absent in [POLYHEDRA, GRAVITY, ROLLING, FREE_ROTATION] {
        assert_eq!(spent(&balls, absent), spent(&short, absent), "{absent:?}");
    }
    for absent in [GRAVITY, ROLLING, FREE_ROTATION] {
        assert_eq!(spent(&balls, absent), 0, "{absent:?}");
    }
    // Where a scene has them, they are seen.
    let mut cubes = scene(true, "IQS_CLB", &[0.5]);
    (cubes.options.self_gravity, cubes.options.gravity_constant) = (true, 1.0);
    let cubes = allocations_of(&cubes).unwrap();
    for present in [POLYHEDRA, GRAVITY, FREE_ROTATION] {
        assert!(spent(&cubes, present) > 0, "{present:?}");
    }
    let rolling = allocations_of(&scene(false, "IQS_DS_ROLL_CLB", &[0.5, 0.5, 0.1, 0.1])).unwrap();
    assert!(spent(&rolling, ROLLING) > 0);
}

#[test]
fn a_law_without_cohesion_costs_no_more_than_one_that_has_it_at_nothing() {
    let total = |case: &Case| allocations_of(case).map(|costs| spent(&costs, &["cd_solve::"]));
    let Some(plain) = total(&scene(false, "IQS_DS_CLB", &[0.5, 0.5])) else { return };
    let wet = total(&scene(false, "IQS_WET_DS_CLB", &[0.0, 0.0, 0.01, 0.5, 0.5])).unwrap();
    // The same motion; a thousandth for the text of the law's name in files.
    assert!(plain as f64 <= 1.001 * wet as f64, "{plain} {wet}");
}

#[test]
fn a_plan_makes_no_step_that_is_far_too_long() {
    let mut case = Case::new();
    case.gravity = [0.0, 0.0, -9.81];
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    case.options.dt = 1e3;
    case.write();
    let plan = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).arg("--plan").output().unwrap();
    let text = String::from_utf8(plan.stdout).unwrap();
    assert!(
        text.contains("no trial step: dt is more than 100 times the strictest bound") && text.contains("  1000 s is "),
        "{text}"
    );
}

#[test]
fn a_plan_names_the_unknowns_that_friction_adds() {
    for (cubes, law, parameters, expected) in [
        (false, "IQS_CLB", &[0.5][..], None),
        (false, "IQS_CLB", &[0.0], Some("friction (one unknown per contact, not three)")),
        (true, "IQS_CLB", &[0.0], Some("friction (one unknown per contact, not three)")),
        // Their sweeps keep three components.
        (false, "IQS_DS_ROLL_CLB", &[0.0, 0.0, 0.1, 0.1], Some("friction")),
    ] {
        let case = scene(cubes, law, parameters);
        case.write();
        let plan = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).arg("--plan").output().unwrap();
        let text = String::from_utf8(plan.stdout).unwrap();
        let line = text.lines().find_map(|line| line.trim().strip_prefix("inactive")).expect("a line of the plan");
        let found = line.trim().split("; ").find(|name| name.starts_with("friction"));
        assert_eq!(found, expected, "{law} {parameters:?}: {line}");
    }
}

/// Steps are longer than dt where imposed motion is constant.
#[test]
fn a_plan_says_in_what_share_of_the_time_steps_may_be_longer() {
    let table = |points: &[[f64; 2]]| Evolution::Table { name: "speed.dat".into(), points: points.to_vec() };
    for (points, expected) in [
        // The wall starts in the first second of four.
        (&[[0.0, 0.0], [1.0, 1.0], [2.0, 1.0]][..], "400 dt, up to 16 dt per step in the 75.000 % of the time"),
        (&[[0.0, 0.0], [9.0, 1.0]], "400 steps of one dt, because imposed motion changes at all times;"),
        (&[[0.0, 1.0], [9.0, 1.0]], "400 dt, up to 16 dt per step, "),
    ] {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.0]);
        case.sphere(0.5, [0.0, 0.0, 20.0]);
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let wall = case.plate([2.0, 2.0, 0.5], [0.0, 0.0, -9.0], axes);
        case.drive_along(wall, 0, table(points));
        (case.options.dt, case.options.steps) = (0.01, Some(400));
        case.options.adaptive = Some(Adaptive { max_multiple: 16, ..Adaptive::default() });
        case.write();
        let plan = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).arg("--plan").output().unwrap();
        let text = String::from_utf8(plan.stdout).unwrap();
        assert!(text.contains(expected), "{expected}: {text}");
        assert!(text.contains("16 bytes for each pair that touches between two snapshots"), "{text}");
    }
}
