//! Input that is rejected: one line a fault in the form `file:line:column: object: found; expected`, exit code 2,
//! and nothing written.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use cd_formats::bodies::{Contactor, ShapeRecord};
use cd_formats::compute::{Compute, Event, EventAction, ExternalField, SweepPrecision, TargetErrors};
use cd_formats::drv_dof::{DrivenComponent, DrivenKind, Evolution};
use cd_formats::probe::{BodySelection, Probe, ProbeQuantity};

use crate::case::{AXES, Case};

/// A ball over a floor.
fn sound() -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.3]);
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    case.options.steps = Some(2);
    case
}

/// Runs the program on DATBOX as it stands; exit code, and standard error with CASE for the case's folder.
pub fn spawn(case: &Case, flags: &[&str]) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).args(flags).output().unwrap();
    let text = String::from_utf8(output.stderr).unwrap().replace(case.path().to_str().unwrap(), "CASE");
    (output.status.code().unwrap(), text)
}

/// Expects that DATBOX as it is is rejected, with these lines.
#[track_caller]
fn expect_rejection(case: &Case, flags: &[&str], lines: &[&str]) {
    let expected: String = lines.iter().map(|line| format!("cd-solve: {line}\n")).collect();
    assert_eq!(spawn(case, flags), (2, expected));
}

/// The same, after writing DATBOX; there are no results then.
#[track_caller]
fn written_refused(case: &Case, flags: &[&str], lines: &[&str]) {
    case.write();
    expect_rejection(case, flags, lines);
    assert!(!case.path().join("OUTBOX").exists());
}

/// Writes DATBOX with one of its files replaced, or removed.
fn with_file(name: &str, text: Option<&str>) -> Case {
    let case = sound();
    case.write();
    let path = case.path().join("DATBOX").join(name);
    match text {
        Some(text) => fs::write(path, text).unwrap(),
        None => fs::remove_file(path).unwrap(),
    }
    case
}

#[test]
fn options_without_effect_are_reported() {
    let mut case = sound();
    case.options.gravity_error = Some(1e-4);
    case.options.narrow_phase = Some(cd_formats::compute::NarrowPhase::Fast);
    case.options.impacts = cd_formats::compute::ImpactOrder::InOrder;
    case.event(1e-3, EventAction::Bond);
    case.event(1.0, EventAction::SetQuench(0.5));
    case.event(1e-3, EventAction::SetQuench(0.0));
    case.event(1.5e-3, EventAction::SetQuench(0.0));
    case.write();
    let expected = "cd-solve: Vloc_Rloc.INI: absent; no contacts are known from an earlier step\n\
                    cd-solve: gravity_error: without effect; needs self_gravity\n\
                    cd-solve: narrow_phase: without effect; needs polyhedra\n\
                    cd-solve: impacts: without effect; needs laws with restitution, such as RST_CLB\n\
                    cd-solve: event 1: without effect; Bond needs a law with bonds, liquid bridges or reference gaps\n\
                    cd-solve: event 2: without effect; no step begins at 1 s or later, the last begins at 0.001 s\n\
                    cd-solve: event 4: without effect; no step begins at 0.0015 s or later, the last begins at 0.001 s\n";
    let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.starts_with(expected), "{text}");
}

#[test]
fn what_stands_outside_a_hollow_cylinder() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.3]);
    let drum = case.plate([1.0; 3], [0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    case.bodies[drum].contactors[0].shape = ShapeRecord::Cylinder { half_height: 2.0, radius: 1.25, hollow: true };
    case.sphere(0.5, [0.5, 0.0, 0.0]);
    case.sphere(0.5, [0.0, 0.0, 2.25]);
    let line = "CASE/DATBOX/BODIES.DAT:21: body 3: is outside the hollow cylinder of body 1; \
                expected bodies that can touch it inside: it is closed and has contacts on its inside only";
    written_refused(&case, &[], &[line]);
}

#[test]
fn what_is_sound_is_not_rejected() {
    let case = sound();
    case.write();
    assert_eq!(spawn(&case, &[]), (0, String::new()));
}

#[test]
fn files_that_are_not_there() {
    expect_rejection(&sound(), &[], &["CASE: folder: has no DATBOX; expected the files of cd-pre or LMGC90 in it"]);
    for name in ["BODIES.DAT", "BULK_BEHAV.DAT", "TACT_BEHAV.DAT"] {
        let message = format!("CASE/DATBOX/{name}: file: cannot be read: there is no such file");
        expect_rejection(&with_file(name, None), &[], &[&message]);
    }
    // A file that drives nothing, options that are all defaults, and contacts to start from may be absent.
    let mut case = Case::new();
    case.sphere(0.5, [0.0; 3]);
    case.write();
    for name in ["DRV_DOF.DAT", "COMPUTE.RON"] {
        fs::remove_file(case.path().join("DATBOX").join(name)).unwrap();
    }
    assert_eq!(spawn(&case, &["--steps", "1"]), (0, String::new()));
}

#[test]
fn all_faults_of_all_files_are_reported_at_once() {
    let case = with_file("BULK_BEHAV.DAT", Some("nothing"));
    fs::remove_file(case.path().join("DATBOX/TACT_BEHAV.DAT")).unwrap();
    let lines = [
        "CASE/DATBOX/BULK_BEHAV.DAT: file: no $gravy; expected it with grv1 grv2 grv3 on the next line",
        "CASE/DATBOX/TACT_BEHAV.DAT: file: cannot be read: there is no such file",
    ];
    expect_rejection(&case, &[], &lines);
    let materials = "$behav  lawty\n STONE  RIGID                           Umas= 2.5000000E+03\n";
    let case = with_file("BULK_BEHAV.DAT", Some(materials));
    let line = "CASE/DATBOX/BULK_BEHAV.DAT:1: file: no $gravy; expected it with grv1 grv2 grv3 on the next line";
    expect_rejection(&case, &[], &[line]);
}

#[test]
fn nobody_is_free() {
    let mut case = Case::new();
    case.floor();
    let lines = [
        "CASE/DATBOX/DRV_DOF.DAT:6: bodies: none is free to move; expected at least one whose motion is not all imposed",
    ];
    written_refused(&case, &[], &lines);
    let mut case = Case::new();
    written_refused(&case, &[], &["CASE/DATBOX/BODIES.DAT: file: no body; expected a $bdyty for each"]);
    let ball = case.sphere(0.5, [0.0; 3]);
    case.drive_along(ball, 0, Evolution::constant(1.0));
    written_refused(&case, &[], &lines);
}

#[test]
fn motion_imposed_in_part() {
    // Coriolis' force acts on grains alone.
    let mut case = sound();
    case.press(0, 2, 1.0);
    case.options.fields = vec![ExternalField::RotatingFrame { rate: [0.0, 0.0, 1.0], centre: [0.0; 3] }];
    let turning = "CASE/DATBOX/DRV_DOF.DAT:6: body 1: driven in part in a rotating frame; \
                   expected all six components driven or none: Coriolis' force on such a body is not computed";
    written_refused(&case, &[], &[turning]);
}

#[test]
fn bodies_that_do_not_exist() {
    let mut case = sound();
    let evolution = Evolution::constant(1.0);
    case.driven.push(DrivenComponent { line: 0, body: 6, component: 0, kind: DrivenKind::Force, evolution });
    case.dof[1].body = 4;
    let lines = [
        "CASE/DATBOX/DRV_DOF.DAT:18: body 7: does not exist; expected 1 to 2",
        "CASE/DATBOX/DOF.INI:20: body 5: does not exist; expected 1 to 2",
    ];
    written_refused(&case, &[], &lines);
}

#[test]
fn shapes_that_are_not_computed() {
    let mut case = sound();
    case.bodies[1].contactors[0].shape = ShapeRecord::Point { offset: [0.0; 3] };
    let expected =
        "expected SPHER, SPHEb, PLANx, POLYR, CYLND, DNLYC, CAPSx or MESHx: points have no mass and no surface";
    written_refused(&case, &[], &[&format!("CASE/DATBOX/BODIES.DAT:11: body 2: no contactor but PT3Dx; {expected}")]);
    case.bodies[1].contactors[0].shape = ShapeRecord::Cylinder { half_height: 1.0, radius: 1.0, hollow: true };
    let line = "CASE/DATBOX/BODIES.DAT:11: body 2: a DNLYC that may move freely; expected vlocy lines in DRV_DOF.DAT \
                that impose some or all of its motion: a hollow cylinder is a wall, as its outside has no contacts";
    written_refused(&case, &[], &[line]);
}

#[test]
fn pairs_that_have_no_contact() {
    let mut case = sound();
    case.plate([1.0; 3], [0.0, 0.0, 4.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    case.driven.truncate(6); // the plate moves
    case.law_between("PLANx", "PLANx", "IQS_CLB", &[0.3]);
    let line = "CASE/DATBOX/TACT_BEHAV.DAT:15: PLANx WALLx and PLANx WALLx: body 3, which is not all driven, and body 1; \
                expected no such row: LMGC90 has no contact of two plates; make one of them a POLYR with the eight \
                corners of the plate";
    written_refused(&case, &[], &[line]);
}

#[test]
fn polyhedra_that_are_none() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.33332; 3]];
    let refusal = |triangles: Vec<[u32; 3]>| {
        let mut case = sound();
        let vertices = corners[..triangles.iter().flatten().max().map_or(0, |&v| v as usize + 1)].to_vec();
        case.bodies[1].contactors[0].shape = ShapeRecord::Polyhedron { vertices, triangles };
        case.write();
        let (code, text) = spawn(&case, &[]);
        assert_eq!(code, 2, "{text}");
        assert!(text.starts_with("cd-solve: CASE/DATBOX/BODIES.DAT:11: body 2: contactor POLYR: "), "{text}");
        text
    };
    // A side is missing; one is pushed in by no more than the digits of files.
    refusal(vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 1]]);
    let pushed_in = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4], [2, 3, 4], [3, 1, 4]];
    let text = refusal(pushed_in);
    assert!(text.contains("not convex: ") && text.ends_with("or a body of several convex POLYR\n"), "{text}");
}

#[test]
fn surfaces_with_dents_are_rejected_in_one_line() {
    // One side of a tetrahedron is pushed in by the digits of files alone, which no piece can have.
    let corners =
        |depth: f64| vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.333_333 - depth; 3]];
    let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4], [2, 3, 4], [3, 1, 4]];
    for others in [1, 5] {
        let mut case = sound();
        let body = case.bodies[1].clone();
        for k in 0..others {
            case.sphere(1.0, [9.0 * (k + 1) as f64, 0.0, 0.0]);
        }
        for k in 1..=others + 1 {
            let vertices = corners(1e-5 + 1e-7 * k as f64);
            let shape = ShapeRecord::Polyhedron { vertices, triangles: triangles.clone() };
            case.bodies[k] = body.clone();
            case.bodies[k].contactors[0].shape = shape;
        }
        case.write();
        let (code, text) = spawn(&case, &[]);
        assert_eq!((code, text.lines().count()), (2, 1), "{text}");
        let more = match others {
            1 => "; 1 more body has such a surface: line ",
            _ => "; 5 more bodies have such surfaces: lines ",
        };
        assert!(text.contains(more) && text.contains("BODIES.DAT:11: body 2: "), "{text}");
    }
}

#[test]
fn materials_and_masses() {
    let mut case = sound();
    case.bodies[1].material = "CHALK".into();
    let line = "CASE/DATBOX/BODIES.DAT:14: body 2: material 'CHALK' is not defined; expected ROCKx";
    written_refused(&case, &[], &[line]);
    let mut case = sound();
    let shape = ShapeRecord::Sphere { radius: 1e-99 };
    case.materials[0].density = 1e-90;
    case.bodies[1].contactors[0].shape = shape;
    let line = "CASE/DATBOX/BODIES.DAT:11: body 2: mass 0 kg; expected mass and inertia to be finite and > 0";
    written_refused(&case, &[], &[line]);
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.5]);
    let block = case.block([0.5; 3], [0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    case.bodies[block].inertia = Some([0.25, 0.0, 0.0]);
    let line = "CASE/DATBOX/BODIES.DAT:1: body 1: principal inertia 0.25, 0, 0 kg m²; \
                expected mass and inertia to be finite and > 0";
    written_refused(&case, &[], &[line]);
}

#[test]
fn laws() {
    let mut case = sound();
    case.sphere(0.5, [4.0, 0.0, 0.5]);
    case.tact.laws[0].kind = "IQS_GLUE".into();
    case.write();
    let (code, text) = spawn(&case, &[]);
    assert_eq!(code, 2);
    let line = "cd-solve: CASE/DATBOX/TACT_BEHAV.DAT:2: law 'law00': its kind 'IQS_GLUE' is not known; expected one of IQS_CLB, ";
    assert!(text.starts_with(line) && text.lines().count() == 1, "{text}");

    case.law("IQS_STICK", &[]);
    let computed = format!("computed are {}", cd_formats::law_table::computed_list());
    let reason = "LMGC90's 3D solver stops at its first contact";
    let lines = [("2", "law00"), ("4", "law01")].map(|(line, name)| {
        format!(
            "CASE/DATBOX/TACT_BEHAV.DAT:{line}: law '{name}': its kind IQS_STICK is not computed: {reason}; {computed}"
        )
    });
    written_refused(&case, &[], &lines.each_ref().map(String::as_str));

    case.law("RST_CLB", &[1.25, 0.0, 0.3]);
    let lines = [("2", "law00"), ("5", "law01")].map(|(line, name)| {
        format!("CASE/DATBOX/TACT_BEHAV.DAT:{line}: law '{name}': normal_restitution (rstn) 1.25; expected 0 to 1")
    });
    written_refused(&case, &[], &lines.each_ref().map(String::as_str));

    case.law("ELASTIC_WIRE", &[1e6, 0.3]);
    let lines = [("7", "SPHER GRAIN", "law00"), ("10", "PLANx WALLx", "law01")].map(|(line, other, name)| {
        format!(
            "CASE/DATBOX/TACT_BEHAV.DAT:{line}: SPHER GRAIN and {other}: law '{name}', ELASTIC_WIRE; expected PT3Dx on \
             both sides"
        )
    });
    written_refused(&case, &[], &lines.each_ref().map(String::as_str));

    // A point meets points only.
    let mut case = sound();
    let shape = ShapeRecord::Point { offset: [0.0; 3] };
    case.bodies[0].contactors.push(Contactor { colour: "WALLx".into(), shape, local_frame: None });
    case.law_between("PT3Dx", "SPHER", "ELASTIC_WIRE", &[1e6, 0.3]);
    case.write();
    let (code, text) = spawn(&case, &[]);
    assert!(code == 2 && text.contains("ELASTIC_WIRE; expected PT3Dx on both sides"), "{text}");

    // Points that are farther apart than alert.
    let mut case = sound();
    for body in &mut case.bodies {
        let shape = ShapeRecord::Point { offset: [0.0; 3] };
        body.contactors.push(Contactor { colour: "WALLx".into(), shape, local_frame: None });
    }
    case.law_between("PT3Dx", "PT3Dx", "ELASTIC_WIRE", &[1e6, 0.3]);
    case.write();
    let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("could join with them are farther away than its alert, at most 0.001 m"), "{text}");

    // A law that no row uses is nobody's concern.
    let mut case = sound();
    case.law_with("SPHER", "ELASTIC_WIRE", &[1e6, 0.3]);
    case.tact.visibility.pop();
    case.write();
    assert_eq!(spawn(&case, &[]).0, 0);
}

#[test]
fn laws_that_are_too_many_or_reach_too_far() {
    let mut case = sound();
    for k in 0..256u32 {
        case.law_with("SPHER", "IQS_CLB", &[0.3]);
        let (row, law) = (case.tact.visibility.last_mut().unwrap(), case.tact.laws.last_mut().unwrap());
        (row.antagonist.colour, law.nickname) = (format!("C{k:04}"), format!("L{k:04}"));
        row.law.clone_from(&law.nickname);
        let colour = row.antagonist.colour.clone();
        let sphere = case.sphere(0.5, [2.0 * f64::from(k + 1), 0.0, 0.5]);
        case.bodies[sphere].contactors[0].colour = colour;
    }
    case.write();
    let (code, text) = spawn(&case, &[]);
    assert!(code == 2 && text.contains("is the 257th law in use; expected at most 256 in use"), "{text}");

    let mut case = sound();
    case.law("IQS_WET_DS_CLB", &[1.0, 0.0, 0.3, 0.3, 0.3]);
    case.options.xperiode = Some(2.5);
    let found = "attracts bodies of 0.5 m over 0.3 m in a scene with the period 2.5 m; \
                 expected twice the radius plus the range to be less than half of that";
    let lines = [("2", "law00"), ("6", "law01")]
        .map(|(line, law)| format!("CASE/DATBOX/TACT_BEHAV.DAT:{line}: law '{law}': {found}"));
    written_refused(&case, &[], &lines.each_ref().map(String::as_str));
}

#[test]
fn times_and_events_that_cannot_be() {
    let case = sound();
    let event = "[(time: 0.0, every: 0.001, action: SetQuench(0.1))]";
    let often = "options: event 1: happens 1e9 times up to the end of the run; expected at most 1000000";
    written_refused(&case, &["--end-time", "1e6", "--events", event], &[often]);
    let mut unknown = sound();
    let friction = EventAction::SetFriction("other".into(), 0.1);
    unknown.options.events =
        vec![Event::at_time(0.0, friction), Event::at_time(0.0, EventAction::SetCohesion("law00".into(), 1.0))];
    let lines = [
        "CASE/DATBOX/COMPUTE.RON:39:41: event 1, action 1: law 'other' is not in use; expected one of law00, law01",
        "CASE/DATBOX/COMPUTE.RON:40:41: event 2, action 1: law 'law00' has no cohesion; expected a law with cohesion",
    ];
    written_refused(&unknown, &[], &lines);
    let twice =
        "[RotatingFrame(rate: (0, 0, 1), centre: (0, 0, 0)), RotatingFrame(rate: (0, 0, 1), centre: (0, 0, 0))]";
    let (code, text) = {
        case.write();
        spawn(&case, &["--fields", twice])
    };
    assert!(code == 2 && text.contains("options: field 2: ") && text.contains("expected one RotatingFrame"), "{text}");
    // A time to which no step adds anything.
    let path = case.path().join("DATBOX/DOF.INI");
    let late = fs::read_to_string(&path).unwrap().replacen("time= 0.0000000D+00", "time= 1.0000000D+30", 1);
    fs::write(&path, late).unwrap();
    let lost = "options: dt: 0.001 s is lost in the rounding of the time 1e30 s; expected more than 2.220446049e14 s, or an \
                earlier time of the start";
    assert_eq!(spawn(&case, &["--dt", "1e-3"]), (2, format!("cd-solve: {lost}\n")));
}

#[test]
fn values_of_flags() {
    let case = sound();
    let refusals: [(&[&str], &str); 15] = [
        (&["--dt", "0"], "dt: 0; expected a finite time step > 0 s"),
        (&["--dt", "-1e-3"], "dt: -0.001; expected a finite time step > 0 s"),
        (&["--dt", "nan"], "dt: NaN; expected a finite time step > 0 s"),
        (&["--dt", "inf"], "dt: inf; expected a finite time step > 0 s"),
        (&["--end-time", "-2"], "end_time: -2; expected a finite time >= 0 s"),
        (&["--theta", "0.3"], "theta: 0.3; expected 0.5 to 1"),
        (&["--theta", "1.01"], "theta: 1.01; expected 0.5 to 1"),
        (&["--tol", "0"], "tol: 0; expected more than 0 and less than 1"),
        (
            &["--adaptive", "(max_multiple: 0)"],
            "adaptive: (max_multiple:0,travel:0.1,penetration:0.001); expected max_multiple from 1 to 1000000, travel and penetration > 0",
        ),
        (&["--max-sweeps", "0"], "max_sweeps: 0; expected at least 1"),
        (&["--alert", "-1"], "alert: -1; expected a finite distance >= 0 m"),
        (&["--gravity-error", "0"], "gravity_error: 0; expected at least 1e-14"),
        (&["--quench=2"], "quench: 2; expected 0 to 1"),
        (&["--output-every", "0"], "output_every: 0; expected at least 1"),
        (&["--threads", "1000000"], "threads: 1000000; expected 0 to 1024"),
    ];
    for (flags, message) in refusals {
        written_refused(&case, flags, &[&format!("options: {message}")]);
    }
    for (flags, line) in [
        (["--dt", "x"], "cd-solve: --dt: x; expected a number (s)\n"),
        (["--steps", "-1"], "cd-solve: --steps: -1; expected an integer of 0 or more\n"),
        (["--steps", "1.5"], "cd-solve: --steps: 1.5; expected an integer\n"),
    ] {
        assert_eq!(spawn(&case, &flags), (2, line.to_string()));
    }
    let help = "see cd-solve --help";
    let nothing = "expected one of those that cd-solve --help lists";
    for (flags, message) in [
        (&["--bogus"][..], format!("--bogus: is no option of cd-solve; {nothing}")),
        (&["--tool", "1e-3"], "--tool: is no option of cd-solve; did you mean --tol?".into()),
        (&["--end_tim=2"], "--end_tim: is no option of cd-solve; did you mean --end-time?".into()),
        (&["--quench", "0.1"], "0.1: is not expected here; did you mean --quench=0.1?".into()),
        (&["other"], "other: is not expected here; expected one DIR".into()),
        (&["--dt", "1e400"], "--dt: 1e400; expected a number below 1.8e308 in magnitude".into()),
        (&["--resume", "--force"], format!("the argument '--resume' cannot be used with '--force'; {help}")),
        (
            &["--events", "[(time: 1)]"],
            format!(
                "invalid value '[(time: 1)]' for '--events <RON>': column 2: item 1: no field 'action'; expected the \
                 field action; {help}"
            ),
        ),
    ] {
        assert_eq!(spawn(&case, flags), (2, format!("cd-solve: {message}\n")));
    }
    // More steps than an f64 counts.
    let many = "end_time: 1e18 s with dt 0.001 s are 1e21 steps; expected at most 9e15 steps: a larger dt or a smaller end_time";
    written_refused(&case, &["--end-time", "1e18", "--dt", "1e-3"], &[&format!("options: {many}")]);
    let many = "options: steps: 10000000000000000; expected at most 9e15";
    written_refused(&case, &["--steps", "10000000000000000"], &[many]);
}

#[test]
fn steps_of_which_no_problem_can_be_written() {
    let mut case = sound();
    let expected_step = |first: u64| format!("expected a step that the run makes, after {first} and up to 2");
    for step in ["0", "3", "99"] {
        written_refused(
            &case,
            &["--dump-problem", step],
            &[&format!("options: --dump-problem: {step}; {}", expected_step(0))],
        );
    }
    // A run that has ended makes no step.
    assert_eq!(spawn(&case, &[]).0, 0);
    let flags = ["--resume", "--dump-problem", "2"];
    expect_rejection(&case, &flags, &[&format!("options: --dump-problem: 2; {}", expected_step(2))]);
    // Results of before stay where --force is rejected.
    let flags = ["--force", "--dump-problem", "3"];
    expect_rejection(&case, &flags, &[&format!("options: --dump-problem: 3; {}", expected_step(0))]);
    assert!(case.path().join("OUTBOX/steps.csv").exists());

    case.law("IQS_DS_ROLL_CLB", &[0.3, 0.3, 0.1, 0.1]);
    fs::remove_dir_all(case.path().join("OUTBOX")).unwrap();
    let moments = "expected laws without moments, which the format cannot hold";
    written_refused(&case, &["--dump-problem", "1"], &[&format!("options: --dump-problem: 1; {moments}")]);
    // The last step of a run is one of its steps.
    let case = sound();
    case.write();
    assert_eq!(spawn(&case, &["--dump-problem", "2"]), (0, String::new()));
    assert!(case.path().join("problem-000002.fc3d").exists());
}

#[test]
fn options_in_the_file() {
    let names: Vec<String> = Compute::option_table().into_iter().map(|(name, ..)| name.to_string()).collect();
    let unknown = format!("3:5: options: unknown field 'speed'; expected one of {}", names.join(", "));
    let lines = [
        ("(\n    dt: 1e-3,\n    speed: 3.0,\n)", unknown.as_str()),
        ("(\n    theta: \"a\",\n)", "2:12: theta: \"a\"; expected a number"),
        ("(dt: 1e-3 tol: 0.1)", "1:10: dt: no ',' before 'tol'; expected ',' here"),
    ];
    for (text, message) in lines {
        expect_rejection(&with_file("COMPUTE.RON", Some(text)), &[], &[&format!("CASE/DATBOX/COMPUTE.RON:{message}")]);
    }
    let text = "(dt: -1.0, // gravity_moved: 0.0\n gravity_opening: 1.5,\n gravity_moved: 0.0,\n \
                fields: [PointMass(mass: 0.0, position: (0.0, 0.0, 0.0))],\n \
                events: [\n (time: 1.0, action: Bond),\n (time: 1.0, action: SetQuench(3.0)),\n ])";
    let case = with_file("COMPUTE.RON", Some(text));
    let lines = [
        "CASE/DATBOX/COMPUTE.RON:1:6: dt: -1.0; expected a finite time step > 0 s",
        "CASE/DATBOX/COMPUTE.RON:2:19: gravity_opening: 1.5; expected more than 0 and less than 1",
        "CASE/DATBOX/COMPUTE.RON:3:17: gravity_moved: 0.0; expected a finite number > 0",
        "CASE/DATBOX/COMPUTE.RON:4:11: field 1: PointMass(mass: 0.0, position: (0.0, 0.0...; \
         expected finite values, mass and radius > 0, an axis other than 0",
        "CASE/DATBOX/COMPUTE.RON:7:22: event 2, action: SetQuench(3.0); expected 0 to 1",
    ];
    expect_rejection(&case, &[], &lines);
}

#[test]
fn results_that_are_there() {
    let mut case = sound();
    case.run(2);
    let before = case.last();
    let line = "CASE/OUTBOX: results: snapshot-000002.npz exists; \
                use --resume to continue from it, --force to overwrite all results";
    expect_rejection(&case, &[], &[line]);
    // A rejected --force has removed nothing.
    expect_rejection(&case, &["--force", "--dt", "0"], &["options: dt: 0; expected a finite time step > 0 s"]);
    assert_eq!(case.last(), before);
    let line = "options: steps: 1 is before step 2, from which the run continues; expected a later step";
    expect_rejection(&case, &["--resume", "--steps", "1"], &[line]);
    let time = before.meta.time;
    let line = format!("options: end_time: 0.001; expected at least {time} s, from which the run continues");
    expect_rejection(&case, &["--resume", "--end-time", "0.001", "--dt", "0.001"], &[&line]);
}

#[test]
fn results_of_lmgc90_are_not_written_over() {
    let case = sound();
    case.write();
    fs::create_dir(case.path().join("OUTBOX")).unwrap();
    fs::write(case.path().join("OUTBOX/DOF.OUT.1"), "theirs").unwrap();
    let line = "CASE/OUTBOX: results: DOF.OUT.1 exists; \
                --text would overwrite it; use --force to remove such files";
    for flags in [&["--text"][..], &["--text", "--resume"]] {
        expect_rejection(&case, flags, &[line]);
    }
    assert_eq!(fs::read(case.path().join("OUTBOX/DOF.OUT.1")).unwrap(), b"theirs");
}

#[test]
fn files_of_a_run_that_ended_before_its_first_snapshot_are_written_anew() {
    let mut case = sound();
    (case.options.text, case.options.output_every) = (true, 1);
    case.options.probes =
        vec![Probe { name: "all".into(), every: 1, quantity: ProbeQuantity::Energy { of: BodySelection::Free } }];
    case.write();
    fs::write(case.path().join("DATBOX/POSTPRO.DAT"), "KINETIC ENERGY\nSTEP 1\nEND\n").unwrap();
    assert_eq!(spawn(&case, &["--resume"]), (0, String::new()));
    let results = || -> Vec<(PathBuf, Vec<u8>)> {
        let names = ["OUTBOX", "POSTPRO"].into_iter().flat_map(|name| fs::read_dir(case.path().join(name)).unwrap());
        let mut files: Vec<PathBuf> = names.map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files.into_iter().map(|path| (path.clone(), fs::read(path).unwrap())).collect()
    };
    let unbroken = results();
    let is_snapshot = |path: &Path| path.extension().is_some_and(|extension| extension == "npz");
    let snapshots = unbroken.iter().filter(|(path, _)| is_snapshot(path));
    assert_eq!(snapshots.map(|(path, _)| fs::remove_file(path).unwrap()).count(), 3);
    let line = "CASE/OUTBOX: results: DOF.OUT.1 exists; --text would overwrite it; use --force to remove such files";
    expect_rejection(&case, &[], &[line]);
    assert_eq!(spawn(&case, &["--resume"]), (0, String::new()));
    assert!(results() == unbroken);
}

#[test]
fn snapshots_that_are_damaged() {
    let mut case = sound();
    case.run(2);
    let path = case.path().join("OUTBOX/snapshot-000002.npz");
    let sound = fs::read(&path).unwrap();
    let refusal = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let (code, text) = spawn(&case, &["--resume", "--steps", "3"]);
        assert!(code == 2 && text.starts_with("cd-solve: CASE/OUTBOX/snapshot-000002.npz: "), "{code} {text}");
        text
    };
    for part in [0, 1, sound.len() / 2, sound.len() - 1] {
        let text = refusal(&sound[..part]);
        let end =
            "; expected an .npz file of cd-solve; --resume --skip-damaged continues from the last sound snapshot\n";
        assert!(text.ends_with(end), "{text}");
    }
    // Any flipped bit in what is stored is found by the archive's checksums.
    for place in (2000..sound.len() - 3000).step_by(997) {
        let mut flipped = sound.clone();
        flipped[place] ^= 0x10;
        fs::write(&path, &flipped).unwrap();
        let (code, text) = spawn(&case, &["--resume", "--steps", "3"]);
        assert!(code == 2 || code == 0, "byte {place}: {code} {text}");
        assert!(!text.contains("panicked"), "{text}");
    }
}

#[test]
fn snapshots_of_another_scene() {
    let mut case = sound();
    case.run(2);
    let snapshot = "CASE/OUTBOX/snapshot-000002.npz";
    case.sphere(0.5, [3.0, 0.0, 0.5]);
    case.write();
    expect_rejection(&case, &["--resume"], &[&format!("{snapshot}: snapshot: 2 bodies; expected the 3 of DATBOX")]);

    let mut other = sound();
    other.run(2);
    other.bodies[1].contactors[0].shape = ShapeRecord::Sphere { radius: 0.25 };
    other.write();
    let (code, text) = spawn(&other, &["--resume"]);
    let line = format!("cd-solve: {snapshot}: body 2: mass 0.523598");
    assert!(code == 2 && text.starts_with(&line) && text.contains("expected as in DATBOX: mass 0.06544"), "{text}");

    // As heavy, but of another shape.
    let brick = |half: [f64; 3]| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.3]);
        case.block(half, [0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        case
    };
    let mut cube = brick([1.0; 3]);
    cube.run(2);
    cube.bodies = brick([2.0, 1.0, 0.5]).bodies;
    cube.write();
    let (code, text) = spawn(&cube, &["--resume"]);
    assert!(code == 2 && text.starts_with(&format!("cd-solve: {snapshot}: body 1: mass 8 kg")), "{text}");

    // A law more, or of another friction.
    let laws = |names: &str, expected: &str| {
        format!("{snapshot}: snapshot: laws {names}; expected those of DATBOX: {expected}")
    };
    let (one, two) = ("law00 IQS_CLB [0.3]", "law00 IQS_CLB [0.3], law01 IQS_CLB [0.3]");
    let mut other = sound();
    other.run(2);
    other.tact.visibility.pop();
    other.write();
    expect_rejection(&other, &["--resume"], &[&laws(two, one)]);
    other = sound();
    other.run(2);
    other.tact.laws[1].parameters = vec![0.5];
    other.write();
    expect_rejection(&other, &["--resume"], &[&laws(two, "law00 IQS_CLB [0.3], law01 IQS_CLB [0.5]")]);
}

#[test]
fn a_folder_that_cannot_be_written() {
    let case = sound();
    case.write();
    fs::write(case.path().join("OUTBOX"), "a file").unwrap();
    let (code, text) = spawn(&case, &[]);
    assert!(code == 2 && text.starts_with("cd-solve: CASE/OUTBOX"), "{code} {text}");
}

#[test]
fn a_floor_narrower_than_the_period_is_reported() {
    let printed = |half: [f64; 3], axes: [[f64; 3]; 3], periods: [Option<f64>; 3]| {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.3]);
        case.plate(half, [0.0, 0.0, -0.5], axes);
        case.sphere(0.5, [0.0, 2.0, 0.5]);
        case.options.steps = Some(2);
        [case.options.xperiode, case.options.yperiode, case.options.zperiode] = periods;
        case.write();
        let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
        assert_eq!(output.status.code(), Some(0));
        let text = String::from_utf8(output.stdout).unwrap();
        text.lines().find(|line| line.contains("widest")).map(String::from)
    };
    let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let level = [Some(4.0), Some(6.0), None];
    assert_eq!(printed([2.0, 3.0, 0.5], [x, y, z], level), None);
    // Turned by 90 degrees about z.
    assert_eq!(printed([3.0, 2.0, 0.5], [y, x.map(|c| -c), z], level), None);
    let note = "cd-solve: xperiode: the widest plate spans 3.8 m of the period 4 m; grains that miss it fall forever";
    assert_eq!(printed([1.9, 3.0, 0.5], [x, y, z], level).as_deref(), Some(note));
    // A floor need not span a period along its normal; a plate along it must.
    let upright = [None, None, Some(4.0)];
    assert_eq!(printed([2.0, 3.0, 0.5], [x, y, z], upright), None);
    let note = "cd-solve: zperiode: the widest plate spans 3.8 m of the period 4 m; grains that miss it fall forever";
    assert_eq!(printed([1.9, 3.0, 0.5], [z, x, y], upright).as_deref(), Some(note));
}

/// A floor that leans along a period, and a baffle that does, which is narrower.
#[test]
fn plates_on_a_slope_along_a_period() {
    let (sin, cos) = (0.28, 0.96);
    let axes = [[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]];
    let case = |half: [f64; 3]| {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.3]);
        case.plate(half, [0.0, 0.0, -1.5], axes);
        case.sphere(0.5, [0.0, 0.0, 1.5]);
        case.options.steps = Some(2);
        (case.options.xperiode, case.options.yperiode) = (Some(4.0), Some(6.0));
        case
    };
    let line = "CASE/DATBOX/BODIES.DAT:1: body 1: a plate as wide as xperiode whose normal [0.2800, 0.0000, 0.9600] is inclined along it; \
                expected x 0 of the normal: images of an inclined plate form stairs; incline gravity instead";
    written_refused(&case([3.0, 4.0, 0.5]), &[], &[line]);
    let baffle = case([1.0, 4.0, 0.5]);
    baffle.write();
    assert_eq!(spawn(&baffle, &[]).0, 0);
}

#[test]
fn contacts_of_vloc_rloc_that_are_in_doubt() {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[0.3]);
    case.gravity = [0.0, 0.0, -1.0];
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    case.options.text = true;
    case.run(2);
    let (datbox, outbox) = (case.path().join("DATBOX"), case.path().join("OUTBOX"));
    for kind in ["DOF", "Vloc_Rloc"] {
        fs::copy(outbox.join(format!("{kind}.OUT.1")), datbox.join(format!("{kind}.INI"))).unwrap();
    }
    let text = fs::read_to_string(datbox.join("Vloc_Rloc.INI")).unwrap();
    let record = &text[text.find("$icdan").unwrap()..];
    let messages = |text: &str| {
        fs::write(datbox.join("Vloc_Rloc.INI"), text).unwrap();
        spawn(&case, &["--force", "--steps", "3"])
    };
    assert_eq!(messages(&text).0, 0);
    for (changed, expected) in [
        (text.replace(" stick", " stuck"), "status: stuck; expected one of LMGC90's"),
        (text.replacen("$steps        2", "$steps        3", 1), "head: step 3, time"),
        (format!("{text}{record}"), "bodies 2 and 1 occur 2 times; expected each contact once"),
        (text.replace("  law", "  lav"), "contact: a law 'lav"),
    ] {
        let (code, printed) = messages(&changed);
        assert!(code == 2 && printed.contains("CASE/DATBOX/Vloc_Rloc.INI") && printed.contains(expected), "{printed}");
    }
}

#[test]
fn contactors_that_no_row_lets_meet_are_reported() {
    let printed = |spheres: u32, rows: &[&str]| {
        let mut case = Case::new();
        rows.iter().for_each(|antagonist| case.law_with(antagonist, "IQS_CLB", &[0.3]));
        case.floor();
        (0..spheres).for_each(|k| _ = case.sphere(0.5, [2.0 * f64::from(k), 0.0, 0.5]));
        case.options.steps = Some(1);
        case.write();
        let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
        assert_eq!(output.status.code(), Some(0));
        let text = String::from_utf8(output.stdout).unwrap();
        text.lines().find_map(|line| Some(line.split_once("no row for ")?.1.to_string()))
    };
    assert_eq!(printed(2, &["SPHER", "PLANx"]), None);
    assert_eq!(printed(2, &["SPHER"]).as_deref(), Some("SPHER GRAIN and PLANx WALLx: they pass through each other"));
    assert_eq!(printed(2, &["PLANx"]).as_deref(), Some("SPHER GRAIN and SPHER GRAIN: they pass through each other"));
    // One alone has none of its own to meet.
    assert_eq!(printed(1, &["PLANx"]), None);
    let all = "SPHER GRAIN and SPHER GRAIN, SPHER GRAIN and PLANx WALLx: they pass through each other";
    assert_eq!(printed(2, &[]).as_deref(), Some(all));
}

#[test]
fn a_law_of_several_pairs_is_reported_once() {
    let mut case = sound();
    case.law("RST_CLB", &[1.5, 0.0, 0.3]);
    // One law for spheres among each other and with walls.
    case.tact.visibility[1].law = "law00".into();
    let line = "CASE/DATBOX/TACT_BEHAV.DAT:2: law 'law00': normal_restitution (rstn) 1.5; expected 0 to 1";
    written_refused(&case, &[], &[line]);
}

#[test]
fn an_event_that_wets_contacts_has_an_effect() {
    let mut case = sound();
    case.law("xQS_WET_DS_CLB", &[1.0, 0.0, 0.01, 0.2, 0.3]);
    case.event(1e-3, EventAction::Bond);
    case.write();
    let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
    assert!(!String::from_utf8(output.stdout).unwrap().contains("without effect"));
}

#[test]
fn the_precision_of_sweeps_matters_to_polyhedra_and_not_to_springs() {
    let has_no_effect = |law: &str, parameters: &[f64]| {
        let mut case = Case::new();
        case.law_of_all(law, parameters);
        case.block([0.5; 3], [0.0; 3], AXES);
        case.block([0.5; 3], [0.0, 0.0, 1.0], AXES);
        case.options.sweep_precision = SweepPrecision::Double;
        case.options.steps = Some(1);
        case.write();
        let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).unwrap().contains("sweep_precision: without effect; needs solver auto or nlgs")
    };
    assert!(!has_no_effect("IQS_CLB", &[0.3]) && has_no_effect("ELASTIC_REPELL_CLB", &[1e5, 0.3]));
}

#[test]
fn target_errors_out_of_range_are_rejected() {
    let mut case = sound();
    let cases = [
        (TargetErrors::default(), "()", "z, nu, pressure, semi_axes or energy, each from 1e-4 to 0.3"),
        (
            TargetErrors { nu: Some(0.5), ..TargetErrors::default() },
            "(nu:0.5)",
            "z, nu, pressure, semi_axes or energy, each from 1e-4 to 0.3",
        ),
    ];
    for (targets, found, expected) in cases {
        case.options.target_error = Some(targets);
        case.write();
        let (code, text) = spawn(&case, &[]);
        assert_eq!(code, 2);
        assert!(text.contains("target_error") && text.contains(&format!("{found}; expected {expected}")), "{text}");
    }
    case.options.target_error = Some(TargetErrors { nu: Some(0.01), ..TargetErrors::default() });
    case.write();
    let (code, text) = spawn(&case, &["--accuracy", "draft"]);
    assert_eq!(code, 2);
    assert!(text.contains("expected either target_error or accuracy"), "{text}");
}
