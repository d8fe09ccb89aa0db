//! Forms of LMGC90's files that deviate from those of cd-pre: files of its users, and what cd-solve reports about them.
//! `tests/lmgc90/forms/base` is a sphere on a plate; the other folders have the files that differ.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use cd_formats::snapshot::{Snapshot, snapshot_path};
use tempfile::TempDir;

use crate::case::{BOX, Case};

/// Folder of a case with the base files, and those of a variant in their place.
pub fn folder(variant: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let datbox = folder.path().join("DATBOX");
    fs::create_dir(&datbox).unwrap();
    let forms = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/lmgc90/forms");
    for source in ["base", variant] {
        for entry in fs::read_dir(forms.join(source)).unwrap() {
            let path = entry.unwrap().path();
            fs::copy(&path, datbox.join(path.file_name().unwrap())).unwrap();
        }
    }
    folder
}

/// Exit code and messages, standard output before standard error, with CASE for the folder.
fn messages(case: &Path) -> (i32, String) {
    let flags = ["--dt", "1e-3", "--steps", "100", "--output-every", "100", "--text", "--force"];
    let output = Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case).args(flags).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap().replace(case.to_str().unwrap(), "CASE");
    (output.status.code().unwrap(), text(output.stdout) + &text(output.stderr))
}

fn file(case: &TempDir, name: &str) -> PathBuf {
    case.path().join("DATBOX").join(name)
}

fn edit(case: &TempDir, name: &str, change: impl Fn(&str) -> String) {
    let path = file(case, name);
    let text = fs::read_to_string(&path).unwrap();
    let changed = change(&text);
    assert_ne!(changed, text, "{name}");
    fs::write(path, changed).unwrap();
}

/// Runs a case that must run with these notices and no other; returns force on the floor (N) and number of contacts.
#[track_caller]
fn runs(case: &TempDir, notices: &[&str]) -> (f64, usize) {
    let (code, text) = messages(case.path());
    assert_eq!(code, 0, "{text}");
    let of_options = "DATBOX has no COMPUTE.RON: ";
    let found = text.lines().filter_map(|line| line.strip_prefix("cd-solve: "));
    let found: Vec<&str> = found.filter(|line| !line.starts_with(of_options)).collect();
    assert_eq!(found, [notices, &["done"]].concat(), "{text}");
    let state = Snapshot::read(&snapshot_path(&case.path().join("OUTBOX"), 100)).unwrap();
    (state.contacts.contact_force.iter().map(|force| force[0]).sum(), state.contacts.contact_body.len())
}

#[track_caller]
fn is_refused(case: &TempDir, lines: &[&str]) {
    let expected: String = lines.iter().map(|line| format!("cd-solve: {line}\n")).collect();
    assert_eq!(messages(case.path()), (2, expected));
}

/// Weight of the sphere, N, 4/3 π r³ ρ g; LMGC90's force on the floor has seven digits.
const SPHERE_WEIGHT: f64 = 41.092_03;

/// Residual force at the default tolerance, over the weight.
const AT_REST: f64 = 1e-3;

#[track_caller]
fn weighs(found: (f64, usize), weight: f64, contacts: usize) {
    assert!((found.0 / weight - 1.0).abs() < AT_REST && found.1 == contacts, "{found:?}");
}

#[test]
fn forms_that_lmgc90_reads_give_its_force() {
    for (variant, notices) in [
        ("base", &[][..]),
        (
            "body-number",
            &["BODIES.DAT:12: 1 body has a number other than the position; bodies are counted by position"],
        ),
        ("line-before-bodies", &["BODIES.DAT:1: 1 line outside of the records is skipped"]),
        (
            "time-two-columns-early",
            &[
                "DOF.INI:1: step number and time are read next to $steps and time=",
                "Vloc_Rloc.INI:1: step number and time are read next to $steps and time=",
            ],
        ),
        (
            "unknown-law-without-row",
            &["TACT_BEHAV.DAT:5: 1 law is not computed: mac01 (IQS_BW_CLB); no contact needs it"],
        ),
        ("wire-without-row", &["TACT_BEHAV.DAT:5: 1 law is in no visibility row: wire0 (ELASTIC_WIRE)"]),
        ("contactor-number-over-all", &["Vloc_Rloc.INI:2: 1 contact is numbered over the contactors of all bodies"]),
        ("point", &["BODIES.DAT:11: 1 PT3Dx carries nothing: no row of TACT_BEHAV.DAT joins it by wires or rods"]),
    ] {
        println!("{variant}");
        weighs(runs(&folder(variant), notices), SPHERE_WEIGHT, 1);
    }
}

/// LMGC90 ignores values behind the end of a record, and laws of rows that no contact needs.
#[test]
fn what_no_record_and_no_contact_has_is_skipped() {
    let case = folder("base");
    let vertex = "                             coo1= 9.3000000E-02  coo2=-1.4000000E-01  coo3= 8.2000000E-02\n";
    edit(&case, "BODIES.DAT", |text| text.replacen("$$$$$$\n", &format!("$$$$$$\n{vertex}{vertex}$$$$$$\n"), 1));
    let row = "$seety\n cdbdy  cdtac  cdcol  behav  anbdy  antac  ancol       alert\n \
               RBDY3  PLANx  FLOOR  nolaw  RBDY3  PLANx  FLOOR       1.0000000E-02\n";
    edit(&case, "TACT_BEHAV.DAT", |text| format!("{text}{row}"));
    let lines = fs::read_to_string(file(&case, "TACT_BEHAV.DAT")).unwrap().lines().count();
    let end = fs::read_to_string(file(&case, "BODIES.DAT")).unwrap();
    let end = end.lines().position(|line| line == "$$$$$$").unwrap() + 2;
    let skipped = format!("BODIES.DAT:{end}: 3 lines outside of the records are skipped");
    let undefined = format!(
        "TACT_BEHAV.DAT:{lines}: 1 visibility row has a law that is not defined: nolaw (first); no contact needs it"
    );
    weighs(runs(&case, &[&skipped, &undefined]), SPHERE_WEIGHT, 1);
    // With a body that moves the row is needed.
    edit(&case, "TACT_BEHAV.DAT", |text| text.replace("iqsc0  RBDY3", "iqsc9  RBDY3"));
    let sides = fs::read_to_string(file(&case, "TACT_BEHAV.DAT")).unwrap();
    let line = sides.lines().position(|line| line.contains("iqsc9")).unwrap() + 1;
    let (code, text) = messages(case.path());
    let fault = format!("CASE/DATBOX/TACT_BEHAV.DAT:{line}: ");
    assert!(
        code == 2 && text.contains(&fault) && text.contains(": law 'iqsc9' is not defined; did you mean iqsc0?"),
        "{text}"
    );
}

#[test]
fn files_may_be_absent() {
    let case = folder("base");
    let contacts = "Vloc_Rloc.INI: absent; no contacts are known from an earlier step";
    fs::remove_file(file(&case, "Vloc_Rloc.INI")).unwrap();
    weighs(runs(&case, &[contacts]), SPHERE_WEIGHT, 1);
    let motion = "DOF.INI: absent; all bodies are at rest at step 0, time 0, with the positions and axes of BODIES.DAT";
    fs::remove_file(file(&case, "DOF.INI")).unwrap();
    weighs(runs(&case, &[motion, contacts]), SPHERE_WEIGHT, 1);
    // The plate falls with the sphere.
    let case = folder("base");
    fs::remove_file(file(&case, "DRV_DOF.DAT")).unwrap();
    let (force, _) = runs(&case, &["DRV_DOF.DAT: absent; no motion or load is imposed"]);
    assert!(force < AT_REST * SPHERE_WEIGHT, "{force}");
    // A shape in its principal axes has no direction without them.
    let case = folder("patches");
    fs::remove_file(file(&case, "DOF.INI")).unwrap();
    let inertia = "                             I1  = 5.0000000E-05  I2  = 5.0000000E-05  I3  = 5.0000000E-05";
    edit(&case, "BODIES.DAT", |text| {
        let (head, body) = text.rsplit_once("$nodty").unwrap();
        format!("{head}{inertia}\n$nodty{body}")
    });
    is_refused(
        &case,
        &["CASE/DATBOX/DOF.INI: file: absent, and body 2 is given in its principal axes; \
           expected the directions of these axes, a, b, g"],
    );
}

#[test]
fn comments_behind_values_are_skipped() {
    let case = folder("base");
    edit(&case, "TACT_BEHAV.DAT", |text| text.replace("01\n", "01 ! mu\n"));
    let text = fs::read_to_string(file(&case, "TACT_BEHAV.DAT")).unwrap();
    let line = text.lines().position(|line| line.ends_with(" ! mu")).unwrap() + 1;
    let notice = format!("TACT_BEHAV.DAT:{line}: 1 comment behind a blank and ! is skipped");
    weighs(runs(&case, &[&notice]), SPHERE_WEIGHT, 1);
}

#[test]
fn patches_and_pieces_carry_the_weight_of_the_whole() {
    // A cube with the half side 0.1 and the density 1000: 8 kg.
    let patches = "BODIES.DAT:19: 1 POLYF is read as POLYR, with the patches joined at their common vertices";
    weighs(runs(&folder("patches"), &[patches]), 78.48, 4);
    // An L of two legs of 0.2 and 0.1, each 0.1 wide and high: 3 kg; its pieces have four corners each.
    let split = "BODIES.DAT:11: 1 POLYR is not convex and split into 2 convex pieces (first: body 2)";
    let case = folder("not-convex");
    weighs(runs(&case, &[split]), 29.43, 8);
    // All contacts are those of contactor 1 of the file.
    let text = fs::read_to_string(case.path().join("OUTBOX/Vloc_Rloc.OUT.1")).unwrap();
    assert_eq!(text.matches(" RBDY3      2  POLYR      1      0  iqsc0  RBDY3      1  PLANx      1").count(), 8);
    // They are read again, as contacts of the pieces.
    let next = folder("not-convex");
    for (name, from) in [("DOF.INI", "DOF.OUT.1"), ("Vloc_Rloc.INI", "Vloc_Rloc.OUT.1")] {
        fs::copy(case.path().join("OUTBOX").join(from), file(&next, name)).unwrap();
    }
    edit(&next, "BODIES.DAT", |text| text.replace("color  BLUEx", "color  BLUEy"));
    edit(&next, "TACT_BEHAV.DAT", |text| text.replace("POLYR  BLUEx", "POLYR  BLUEy"));
    let (code, text) = messages(next.path());
    assert!(code == 0 && text.contains(split), "{text}");
    let state = Snapshot::read(&snapshot_path(&next.path().join("OUTBOX"), 200)).unwrap();
    let parts: Vec<u32> = state.shapes.unwrap().contacts.contact_rank.iter().map(|pair| pair[0]).collect();
    assert_eq!(parts, [0, 0, 0, 0, 1, 1, 1, 1]);
}

#[test]
fn unused_vertices_inside_of_a_body_are_dropped() {
    // Cube of 0.008 m^3 and 1 kg/m^3 on a plate, with a ninth vertex in the middle of the list.
    let with_vertex = |unused: [f64; 3]| {
        let mut case = Case::new();
        case.gravity = [0.0, 0.0, -9.81];
        case.law_of_all("IQS_CLB", &[0.3]);
        case.floor();
        let corner = |k: u32| [0, 1, 2].map(|i| if k >> i & 1 == 1 { 0.1 } else { -0.1 });
        let vertices: Vec<[f64; 3]> = (0..3).map(corner).chain([unused]).chain((3..8).map(corner)).collect();
        let triangles = BOX.map(|triangle| triangle.map(|v| if v >= 3 { v + 1 } else { v }));
        case.polyhedron(&vertices, &triangles, [0.0, 0.0, 0.1]);
        case.write();
        case
    };
    let case = with_vertex([0.01, 0.02, 0.03]);
    let (code, text) = messages(&case.path());
    let notice = "1 vertex of POLYR that no triangle has as a corner is dropped: it is inside of the body";
    assert!(code == 0 && text.matches(notice).count() == 1, "{text}");
    let state = Snapshot::read(&snapshot_path(&case.path().join("OUTBOX"), 100)).unwrap();
    let forces = &state.contacts.contact_force;
    weighs((forces.iter().map(|force| force[0]).sum(), forces.len()), 0.078_48, 4);

    let (code, text) = messages(&with_vertex([0.0, 0.0, -0.2]).path());
    let fault = "contactor POLYR: vertex 4 is not used; expected a corner of triangles";
    assert!(code == 2 && text.contains(fault), "{text}");
}

#[test]
fn left_handed_axes_of_symmetric_shapes_are_accepted() {
    let left_handed = |text: &str| {
        let record = |k: usize| {
            let rows = ["X(1)", "X(4)", "V(1)", "V(4)"].map(|name| {
                let (letter, first) = (&name[..1], name[2..3].parse::<u32>().unwrap());
                let cell = |k: u32| format!("{letter}({})= 0.0000000D+00", first + k);
                [0, 1, 2].map(cell).join("  ")
            });
            let axis =
                |name: &str, [x, y, z]: [f64; 3]| format!("{name}(1)={x:14.7}  {name}(2)={y:14.7}  {name}(3)={z:14.7}");
            let axes =
                [("a", [1.0, 0.0, 0.0]), ("b", [0.0, 1.0, 0.0]), ("g", [0.0, 0.0, -1.0])].map(|(n, v)| axis(n, v));
            let lines: Vec<String> = rows.into_iter().chain(axes).collect();
            let indent = format!("\n{:29}", "");
            format!("$bdyty\n RBDY3  {k:7}\n$nodty\n NO6xx      1                {}\n$$$$$$\n", lines.join(&indent))
        };
        format!("{text}{}{}", record(1), record(2))
    };
    let notice = "DOF.INI:3: left-handed axes of 2 bodies: one is reversed, which leaves the shape as it is";
    let case = folder("base");
    edit(&case, "DOF.INI", left_handed);
    weighs(runs(&case, &[notice]), SPHERE_WEIGHT, 1);
    let patches = "BODIES.DAT:19: 1 POLYF is read as POLYR, with the patches joined at their common vertices";
    let case = folder("patches");
    edit(&case, "DOF.INI", left_handed);
    weighs(runs(&case, &[patches, notice]), 78.48, 4);
    // A corner is cut back: the shape is not its mirror image across any of its axes.
    edit(&case, "BODIES.DAT", |text| {
        let corner = "coo1= 1.0000000E-01  coo2= 1.0000000E-01  coo3= 1.0000000E-01";
        let inner = "coo1= 0.9000000E-01  coo2= 0.9500000E-01  coo3= 0.9000000E-01";
        text.replace(corner, inner)
    });
    let (code, text) = messages(case.path());
    assert!(
        code == 2 && text.contains("DOF.INI:14: body 2: axes a, b, g are left-handed; expected a right-handed"),
        "{text}"
    );
    // Left-handed axes are also rejected if the rotation about the axis is imposed.
    let case = folder("base");
    edit(&case, "DOF.INI", left_handed);
    for component in 4..=6 {
        let row = format!("vlocy      {component}  0.0000000E+00");
        edit(&case, "DRV_DOF.DAT", |text| text.replace(&row, &row.replace(" 0.0000000E+00", " 1.0000000E+00")));
    }
    let (code, text) = messages(case.path());
    assert!(code == 2 && text.contains("DOF.INI:3: body 1: axes a, b, g are left-handed"), "{text}");
}

#[test]
fn rows_and_laws_that_no_contact_needs_do_not_stop_a_run() {
    let case = folder("unknown-law-without-row");
    let row = |sides: [&str; 2]| {
        let titles = " cdbdy  cdtac  cdcol  behav  anbdy  antac  ancol       alert";
        format!("$seety\n{titles}\n {}  mac01  {}       1.0000000E-02\n", sides[0], sides[1])
    };
    edit(&case, "TACT_BEHAV.DAT", |text| {
        let absent = row(["RBDY3  POLYR  BLUEx", "RBDY3  PLANx  FLOOR"]);
        // One sphere and one plate: these meet no other of their kind.
        let alone = row(["RBDY3  SPHER  BLUEx", "RBDY3  SPHER  BLUEx"]);
        let foreign = row(["MAILx  CSpxx  BLUEx", "MAILx  ASpxx  FLOOR"]);
        let driven = row(["RBDY3  PLANx  FLOOR", "RBDY3  PLANx  FLOOR"]);
        // SPHER BLUEx and PLANx FLOOR have another law: this row has no effect.
        let offset_spheres = row(["RBDY3  SPHEb  BLUEx", "RBDY3  PLANx  FLOOR"]);
        text.to_string() + &absent + &alone + &foreign + &driven + &offset_spheres
    });
    let notices = [
        "TACT_BEHAV.DAT:21: 1 visibility row for 2D or deformable bodies is skipped",
        "TACT_BEHAV.DAT:5: 1 law is not computed: mac01 (IQS_BW_CLB); no contact needs it",
        "TACT_BEHAV.DAT:27: 1 visibility row is for SPHEb, which LMGC90 ignores in visibility rows, and so does cd-solve: SPHER stands for all spheres there",
        "TACT_BEHAV.DAT:15: 1 visibility row is for contactors or colours that no body has",
        "TACT_BEHAV.DAT:24: 1 visibility row is for bodies whose motion is all imposed (of spheres: their translation): these do not meet",
    ];
    weighs(runs(&case, &notices), SPHERE_WEIGHT, 1);
    // With a contact it is needed.
    edit(&case, "TACT_BEHAV.DAT", |text| text.replace("iqsc0  RBDY3", "mac01  RBDY3"));
    let (code, text) = messages(case.path());
    assert!(code == 2 && text.contains("TACT_BEHAV.DAT:5: law 'mac01': its kind"), "{text}");
}

#[test]
fn rows_of_a_point_and_another_contactor_and_lines_behind_laws_are_reported() {
    let case = folder("point");
    edit(&case, "TACT_BEHAV.DAT", |text| {
        let row = " RBDY3  PT3Dx  VERTx  iqsc0  RBDY3  PLANx  FLOOR       1.0000000E-02";
        format!("{text}  some words\n$seety\n cdbdy  cdtac  cdcol  behav  anbdy  antac  ancol       alert\n{row}\n")
    });
    let lines = fs::read_to_string(file(&case, "TACT_BEHAV.DAT")).unwrap().lines().count();
    let outside = format!("TACT_BEHAV.DAT:{}: 1 line outside of the records is skipped", lines - 3);
    let row = format!("TACT_BEHAV.DAT:{lines}: 1 visibility row is for PT3Dx and another contactor: these do not meet");
    let points = "BODIES.DAT:11: 1 PT3Dx carries nothing: no row of TACT_BEHAV.DAT joins it by wires or rods";
    weighs(runs(&case, &[&outside, &row, points]), SPHERE_WEIGHT, 1);
    // A second law or material under one keyword would be lost; a law matters only if a row names it.
    let with_second = |name: &str| {
        let case = folder("base");
        edit(&case, name, |text| {
            let record = text.lines().skip_while(|line| !line.starts_with("$behav")).nth(1).unwrap();
            text.replacen(record, &format!("{record}\n{}", record.replacen(&record[1..6], "other", 1)), 1)
        });
        case
    };
    let is_refused_as = |case: &TempDir, expected: &str| {
        let (code, text) = messages(case.path());
        assert!(code == 2 && text.ends_with(expected) && text.lines().count() == 1, "{text}");
    };
    is_refused_as(
        &with_second("BULK_BEHAV.DAT"),
        ": file: a material that LMGC90 would skip; expected $behav before it\n",
    );
    let case = with_second("TACT_BEHAV.DAT");
    weighs(runs(&case, &["TACT_BEHAV.DAT:3: 1 line outside of the records is skipped"]), SPHERE_WEIGHT, 1);
    edit(&case, "TACT_BEHAV.DAT", |text| text.replace("  iqsc0  RBDY3", "  other  RBDY3"));
    is_refused_as(&case, ":3: file: a law that LMGC90 would skip; expected $behav before it, from column 1\n");
}

#[test]
fn half_turns_are_read_from_axes() {
    // The long side of the plate lies along y under the sphere, after half a turn about the diagonal of x and y.
    let long_plate = || {
        let case = folder("base");
        edit(&case, "BODIES.DAT", |text| {
            let text = text.replace("axe2= 2.0000000E+00", "axe2= 5.0000000E-02");
            let (plate, sphere) = text.split_at(text.rfind("$bdyty").unwrap());
            plate.to_string() + &sphere.replace("coo2= 0.0000000E+00", "coo2= 1.0000000E+00")
        });
        case
    };
    let (zero, one) = (" 0.0000000E+00", " 1.0000000E+00");
    let rows = |names: [&str; 3], [open, close]: [&str; 2]| {
        let axes = [[zero, one, zero], [one, zero, zero], [zero, zero, "-1.0000000E+00"]];
        let row = |(name, axis): (&str, [&str; 3])| {
            let cells: Vec<String> = (1..).zip(axis).map(|(k, x)| format!("{name}{open}{k}{close}={x}")).collect();
            format!("{:29}{}\n", "", cells.join("  "))
        };
        names.into_iter().zip(axes).map(row).collect::<String>()
    };
    // By the axes of its localframe, and by those of DOF.INI.
    let case = long_plate();
    let centre = format!("{:29}coo1={zero}  coo2={zero}  coo3={zero}\n", "");
    edit(&case, "BODIES.DAT", |text| {
        let line = text.lines().find(|line| line.contains("PLANx")).unwrap();
        let frame = format!("{:29}localframe\n{}{centre}", "", rows(["alp", "bet", "gam"], ["", ""]));
        text.replace(&format!("{line}\n"), &format!("{line}\n{frame}"))
    });
    weighs(runs(&case, &[]), SPHERE_WEIGHT, 1);
    let case = long_plate();
    edit(&case, "DOF.INI", |text| {
        let motion: String = ["X", "V"]
            .iter()
            .flat_map(|letter| [1, 4].map(|first| (letter, first)))
            .map(|(letter, first)| {
                let cells: Vec<String> = (first..first + 3).map(|k| format!("{letter}({k})={zero}")).collect();
                format!("{:29}{}\n", "", cells.join("  "))
            })
            .collect();
        let axes = rows(["a", "b", "g"], ["(", ")"]);
        format!("{text}$bdyty\n RBDY3      1\n$nodty\n NO6xx      1{}{axes}$$$$$$\n", &motion[13..])
    });
    weighs(runs(&case, &[]), SPHERE_WEIGHT, 1);
}

#[test]
fn folders_of_other_bodies_are_rejected_in_one_line() {
    for (word, kind) in [("RBDY2", "2D"), ("MAILx", "deformable bodies")] {
        let case = folder("base");
        for name in ["BODIES.DAT", "DRV_DOF.DAT", "TACT_BEHAV.DAT"] {
            edit(&case, name, |text| text.replace("RBDY3", word).replace("SPHER", "DISKx").replace("PLANx", "JONCx"));
        }
        let line = format!(
            "CASE/DATBOX/BODIES.DAT:2: file: 2 bodies of type {word}: {kind}; \
             expected RBDY3 only: rigid bodies in 3D are computed"
        );
        is_refused(&case, &[&line]);
    }
}

#[test]
fn bodies_are_named_by_position() {
    let case = folder("base");
    edit(&case, "BODIES.DAT", |text| text.replacen("RBDY3      2", "RBDY3      9", 1));
    let notice = "BODIES.DAT:12: 1 body has a number other than the position; bodies are counted by position";
    weighs(runs(&case, &[notice]), SPHERE_WEIGHT, 1);
    for no_number in [" ", "abc", "1.0"] {
        let case = folder("base");
        edit(&case, "BODIES.DAT", |text| text.replacen("RBDY3      2", &format!("RBDY3 {no_number:>6}"), 1));
        let notice = "BODIES.DAT:12: 1 body has no whole number after RBDY3; bodies are counted by position";
        weighs(runs(&case, &[notice]), SPHERE_WEIGHT, 1);
    }
    edit(&case, "DRV_DOF.DAT", |text| text.replace("RBDY3      1", "RBDY3      9"));
    let (code, text) = messages(case.path());
    let expected = "DRV_DOF.DAT:6: body 9: does not exist; expected 1 to 2: bodies are counted by position, \
                    and the one with the number 9 in BODIES.DAT is body 2";
    assert!(code == 2 && text.contains(expected), "{text}");
}
