//! Laws that count gaps from those at the start: `IQS_CLB_g0` and `GAP_SGR_CLB_g0`.

use cd_formats::compute::EventAction;
use cd_formats::drv_dof::Evolution;

use crate::case::{Case, Figures, equal, near};

/// Gap at the start, m.
const FIRST: f64 = 1.0 / 64.0;

/// A ball of radius 1/2, its lowest point at `height` over a floor that it sees up to 1/16 m; gravity 8 m/s².
fn over_floor(kind: &str, height: f64) -> Case {
    let mut case = Case::new();
    case.law(kind, &[0.3]);
    case.tact.visibility.iter_mut().for_each(|row| row.alert = 0.0625);
    case.gravity = [0.0, 0.0, -8.0];
    case.options.dt = 1.0 / 1024.0;
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5 + height]);
    case
}

const KINDS: [&str; 2] = ["IQS_CLB_g0", "GAP_SGR_CLB_g0"];

#[test]
fn a_ball_rests_at_its_first_gap() {
    for kind in KINDS {
        let end = over_floor(kind, FIRST).run(100);
        // Rounding of positions of 1 m.
        near(end.x(1), [0.0, 0.0, 0.5 + FIRST], 1e-15);
        let weight = 8.0 * end.mass(1);
        near(end.force(1, 0).unwrap(), [weight, 0.0, 0.0], 1e-12 * weight);
        assert_eq!(end.laws.unwrap().contact_reference_gap, [FIRST]);
    }
}

#[test]
fn overlaps_and_contacts_that_begin_later_count_from_touch() {
    // An overlap is kept by one law, and removed by the other in one step of 1/1024 s, at 16 m/s.
    let end = over_floor("IQS_CLB_g0", -FIRST).run(10);
    near(end.x(1), [0.0, 0.0, 0.5 - FIRST], 1e-15);
    near(over_floor("GAP_SGR_CLB_g0", -FIRST).run(1).v(1), [0.0, 0.0, 16.0], 1e-12 * 16.0);
    for kind in KINDS {
        // Beyond the alert distance at the start: it falls by 1/8 m and touches.
        let end = over_floor(kind, 0.125).run(400);
        near(end.x(1), [0.0, 0.0, 0.5], 1e-15);
        assert_eq!(end.laws.unwrap().contact_reference_gap, [0.0]);
    }
}

#[test]
fn an_event_counts_gaps_anew() {
    // From beyond the alert distance it falls until the event in step k = 70: the middle of this step is at
    // 1/16 + 1/64 - 8 h² (k - 1) k/2 = 0.0597 m, since steps begin and end on the parabola of the velocity 8 h (k - 1).
    let mut case = over_floor("IQS_CLB_g0", 0.0625 + FIRST);
    let (h, k) = (case.options.dt, 70.0);
    case.event((k - 1.0) * h, EventAction::Bond);
    let reference = 0.0625 + FIRST - 4.0 * h * h * (k - 1.0) * k;
    near(case.run(200).x(1), [0.0, 0.0, 0.5 + reference], 1e-15);
    equal(case.last().laws.unwrap().contact_reference_gap[0], reference, 1e-15);
}

#[test]
fn a_resumed_run_and_one_from_text_keep_first_gaps() {
    for kind in KINDS {
        // Thrown up, so that the gap at the break is another one.
        let thrown = || {
            let mut case = over_floor(kind, FIRST);
            case.launch(1, [0.25, 0.0, 0.125], [0.0; 3]);
            case.options.text = true;
            case
        };
        let unbroken = thrown().run(100);
        let mut case = thrown();
        let before = case.run(16).laws.unwrap().contact_reference_gap[0];
        let (datbox, outbox) = (case.path().join("DATBOX"), case.path().join("OUTBOX"));
        let [dof, contacts] = ["DOF.OUT.1", "Vloc_Rloc.OUT.1"].map(|name| std::fs::read(outbox.join(name)).unwrap());
        assert_eq!(case.solve(&["--resume", "--steps", "100"]), 0);
        assert!(case.last().bodies == unbroken.bodies && case.last().laws == unbroken.laws);
        // LMGC90's own way of a restart: its text files, with seven digits.
        std::fs::write(datbox.join("DOF.INI"), dof).unwrap();
        std::fs::write(datbox.join("Vloc_Rloc.INI"), contacts).unwrap();
        assert_eq!(case.solve(&["--force", "--steps", "84"]), 0);
        let end = case.last();
        near(end.x(1), unbroken.x(1), 1e-6);
        let kept = end.laws.unwrap().contact_reference_gap[0];
        equal(kept, before, 0.5e-7 * 0.1); // seven digits of 0.1
    }
}

#[test]
fn the_next_run_keeps_first_gaps() {
    for kind in KINDS {
        let mut start = over_floor(kind, FIRST).run(4);
        start.bodies.body_v[1] = [0.0; 3]; // as in DOF.INI, without rounding
        let mut case = over_floor(kind, FIRST);
        case.options.steps = Some(100);
        case.write();
        std::fs::write(case.path().join("DATBOX/START.npz"), start.to_bytes()).unwrap();
        assert_eq!(case.solve(&[]), 0);
        near(case.last().x(1), [0.0, 0.0, 0.5 + FIRST], 1e-15);
        assert_eq!(case.last().laws.unwrap().contact_reference_gap, [FIRST]);
    }
}

/// Contacts need their reference gap in Vloc_Rloc.INI, as without it they would count from touch.
#[test]
fn contacts_of_a_file_without_a_reference_gap_are_rejected() {
    let mut case = over_floor("IQS_CLB_g0", FIRST);
    case.options.text = true;
    case.run(5);
    let [dof, contacts] = case.first_text_states();
    let datbox = case.path().join("DATBOX");
    std::fs::write(datbox.join("DOF.INI"), dof).unwrap();
    let exit_code = |text: &str| {
        std::fs::write(datbox.join("Vloc_Rloc.INI"), text).unwrap();
        case.solve(&["--force"])
    };
    assert_eq!(exit_code(&contacts), 0);
    let (head, _) = contacts.split_once("#internals\n").unwrap();
    assert_eq!(exit_code(head), 2);
    assert_eq!(exit_code(&format!("{head}#internals\n \n")), 2);
}

#[test]
fn blocks_rest_on_the_mortar_gap_between_their_faces() {
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for kind in KINDS {
        let mut case = Case::new();
        case.law_of_all(kind, &[0.5]);
        case.tact.visibility.iter_mut().for_each(|row| row.alert = 0.0625);
        case.gravity = [0.0, 0.0, -8.0];
        case.options.dt = 1.0 / 1024.0;
        case.floor();
        for k in 0..3 {
            case.block([0.5, 0.25, 0.25], [0.0, 0.0, 0.25 + FIRST + f64::from(k) * (0.5 + FIRST)], axes);
        }
        let end = case.run(20);
        for (k, body) in (0..).zip(1..4) {
            // Solved to 1e-12 of weights that change velocities by 8 h in a step.
            near(end.x(body), [0.0, 0.0, 0.25 + FIRST + f64::from(k) * (0.5 + FIRST)], 1e-11);
        }
        assert_eq!(end.contacts.contact_gap.len(), 12);
        assert!(end.contacts.contact_gap.iter().all(|gap| (gap - FIRST).abs() < 1e-11));
    }
}

#[test]
fn a_keystone_rests_in_joints_that_are_wedges() {
    // The joints open upwards by an angle of 1/32: the nearest features of two blocks are their lower edges.
    let half_angle: f64 = 1.0 / 64.0;
    let (s, c) = ((2.0 * half_angle).sin(), (2.0 * half_angle).cos());
    let mut case = Case::new();
    case.law_of_all("IQS_CLB_g0", &[0.5]);
    case.tact.visibility.iter_mut().for_each(|row| row.alert = 0.0625);
    case.gravity = [0.0, 0.0, -8.0];
    case.options.dt = 1.0 / 1024.0;
    let z = 0.25 * (c - s) - 0.25 - FIRST * half_angle.tan();
    for side in [-1.0, 1.0] {
        let axes = [[c, 0.0, -side * s], [0.0, 1.0, 0.0], [side * s, 0.0, c]];
        let held = case.block([0.25; 3], [side * (0.25 + FIRST + 0.25 * (c + s)), 0.0, z], axes);
        case.drive(held, [0.0; 6].map(Evolution::constant));
    }
    let keystone = case.block([0.25; 3], [0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let end = case.run(20);
    // The residual of 1e-12 of the impulses leaves that part of the fall of 8 (20/1024)²/2 = 1.5e-3 m.
    near(end.x(keystone), [0.0; 3], 1e-11);
    let mut gaps = end.laws.unwrap().contact_reference_gap;
    gaps.sort_by(f64::total_cmp);
    let near_edge = FIRST / half_angle.cos();
    // Edges of 1/2 m, seen along the middle of both faces; positions have twelve digits in the files.
    for (k, gap) in gaps.iter().enumerate() {
        equal(*gap, near_edge + if k < 4 { 0.0 } else { half_angle.sin() }, 1e-11);
    }
    assert_eq!(gaps.len(), 8);
}

/// Files of text do not name the corners in contact: those without force keep their reference gap, too, by their positions.
#[test]
fn corners_without_force_keep_their_reference_gap_through_text() {
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for kind in KINDS {
        let mut case = Case::new();
        case.law_of_all(kind, &[0.3]);
        case.tact.visibility.iter_mut().for_each(|row| row.alert = 0.0625);
        case.gravity = [0.0, 0.0, -8.0];
        case.options.dt = 1.0 / 1024.0;
        case.options.text = true;
        case.floor();
        // It falls by 1/8 m, 1/16 m of it within the alert distance, and touches in step 181.
        let block = case.block([0.25; 3], [0.0, 0.0, 0.375], axes);
        case.launch(block, [0.25, 0.0, 0.0], [0.0; 3]);
        assert!(case.run(150).contacts.contact_gap.iter().all(|gap| *gap > 0.01));
        let middle = case.first_text_states();
        let restarted = case.run_from_text(&middle, 50);
        // Digits of the files.
        equal(restarted.x(block).z, 0.25, 1e-7);
        assert_eq!(restarted.laws.unwrap().contact_reference_gap, [0.0; 4]);
    }
}

/// A run from text begins no reference gaps of its own: what comes into reach in its first step counts from touch.
#[test]
fn contacts_that_begin_in_the_first_step_after_text_count_from_touch() {
    let mut case = over_floor("IQS_CLB_g0", 0.0625 + FIRST);
    case.options.text = true;
    let count_at = |case: &mut Case, step: u64| case.run(step).contacts.contact_gap.len();
    // The last step before the ball is within the alert distance.
    let before = (40..120).find(|&step| count_at(&mut case, step + 1) == 1).unwrap();
    assert_eq!(count_at(&mut case, before), 0);
    let restarted = case.run_from_text(&case.first_text_states(), 200);
    near(restarted.x(1), [0.0, 0.0, 0.5], 1e-7);
    assert_eq!(restarted.laws.unwrap().contact_reference_gap, [0.0]);
}
