//! Files that LMGC90 and its pre wrote, and some by hand for what the sample scenes do not have.

use std::fs;

use cd_formats::bodies::{Bodies, ShapeRecord};
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::dof::Dof;
use cd_formats::drv_dof::{DrivenKind, DrvDof, Evolution};
use cd_formats::law_table::law_parameters;
use cd_formats::scan::AsciiText;
use cd_formats::surface::Surface;
use cd_formats::tact_behav::TactBehav;
use cd_formats::vloc_rloc::VlocRloc;

use crate::{files, folder, kind, rewrite};

/// Lines that count, without trailing blanks and without what writers may differ in.
fn essence(text: &str, kind: &str) -> Vec<String> {
    let lines = text.lines().map(str::trim_end).filter(|line| !line.is_empty() && !line.starts_with(['!', '#']));
    lines
        .map(|line| match kind {
            // Number of the contact; candidate vertex and the antagonist's number over all bodies are not kept.
            "Vloc_Rloc" if line.starts_with("$icdan") => line[..13].to_string(),
            "Vloc_Rloc" if line.starts_with(" RBDY3") => {
                format!("{}     {}", &line[..29], &line[34..line.len().min(76)]).trim_end().to_string()
            }
            _ => line.replace("e+", "E+").replace("e-", "E-"),
        })
        .collect()
}

#[test]
fn samples_come_out_as_they_were() {
    let mut compared = 0;
    for path in files(&folder("good")) {
        let text = fs::read_to_string(&path).unwrap();
        let (kind, shown) = (kind(&path), path.display());
        let once = rewrite(&path, text.as_bytes()).unwrap_or_else(|faults| panic!("{faults}"));
        let twice = rewrite(&path, once.as_bytes()).unwrap_or_else(|faults| panic!("second reading: {faults}"));
        assert_eq!(once, twice, "{shown}: the second writing differs from the first");

        // Input files are written in the style of pre, states in that of LMGC90; the other way round digits differ.
        let is_state = ["DOF", "Vloc_Rloc"].contains(&kind);
        let is_output = path.to_str().unwrap().contains(".OUT");
        if is_state == is_output && !path.starts_with(folder("good/by-hand")) {
            assert_eq!(essence(&once, kind), essence(&text, kind), "{shown}");
            compared += 1;
        }
    }
    assert!(compared > 15, "only {compared} files compared");
}

#[test]
fn a_state_of_lmgc90_is_written_byte_by_byte() {
    let path = folder("good/two-spheres/OUTBOX/DOF.OUT.12");
    let text = fs::read_to_string(&path).unwrap();
    assert_eq!(Dof::read(&path).unwrap().to_text(), text);
}

#[test]
fn bodies_in_all_shapes() {
    let Bodies(bodies) = Bodies::read(&folder("good/by-hand/DATBOX/BODIES.DAT")).unwrap();
    let shapes: Vec<Vec<_>> = bodies
        .iter()
        .map(|body| body.contactors.iter().map(|contactor| contactor.shape.type_name()).collect())
        .collect();
    let expected: [&[&str]; 5] =
        [&["SPHEb", "SPHEb", "PT3Dx"], &["CYLND"], &["DNLYC"], &["PLANx"], &["POLYR", "SPHER"]];
    assert_eq!(shapes, expected);
    assert_eq!((bodies[0].line, bodies[1].line), (1, 16));
    assert_eq!(bodies[0].inertia, Some([1.0, 2.0, 3.0]));
    assert_eq!(bodies[1].inertia, None);
    assert_eq!(bodies[1].material, "iron");
    assert_eq!(bodies[3].equivalent_radius, 1.5);
    assert_eq!(bodies[4].position, [0.0, 0.0, 5.0]);
    assert_eq!(bodies[0].contactors[1].colour, "REDxx");
    assert_eq!(bodies[0].contactors[1].shape, ShapeRecord::OffsetSphere { radius: 0.2, offset: [-0.1, 0.0, 0.1] });
    assert_eq!(bodies[0].contactors[2].shape, ShapeRecord::Point { offset: [0.0, 0.5, 0.0] });
    assert_eq!(bodies[1].contactors[0].shape, ShapeRecord::Cylinder { half_height: 0.5, radius: 0.25, hollow: false });
    assert_eq!(bodies[2].contactors[0].shape, ShapeRecord::Cylinder { half_height: 1.0, radius: 4.0, hollow: true });
    assert_eq!(bodies[3].contactors[0].shape, ShapeRecord::Plane { half_lengths: [3.0, 2.0, 0.1] });
    let frame = bodies[3].contactors[0].local_frame.as_ref().unwrap();
    assert_eq!(frame.axes, [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]);
    assert_eq!(frame.offset, [0.1, 0.2, 0.3]);
    let ShapeRecord::Polyhedron { vertices, triangles } = &bodies[4].contactors[0].shape else {
        panic!("no polyhedron")
    };
    assert_eq!(vertices[3], [0.0, 0.0, 1.0]);
    assert_eq!(triangles[1], [0, 1, 3]);
}

/// A cube in six patches: their vertices become one where they are the same.
#[test]
fn patches_are_joined() {
    let path = folder("good/by-hand/BODIES.patches.DAT");
    let text = AsciiText::read_file(&path).unwrap();
    let (Bodies(bodies), notices) = Bodies::parse_with_notices(&path, &text).unwrap();
    let expected = "BODIES.patches.DAT:9: 1 POLYF is read as POLYR, with the patches joined at their common vertices";
    assert_eq!(
        notices[0],
        "BODIES.patches.DAT:2: 1 body has a number other than the position; bodies are counted by position"
    );
    assert_eq!(notices[1..], [expected]);
    let ShapeRecord::Polyhedron { vertices, triangles } = &bodies[0].contactors[0].shape else {
        panic!("no polyhedron")
    };
    assert_eq!((vertices.len(), triangles.len()), (8, 12));
    let volume = Surface::new(vertices, triangles).unwrap().volume();
    assert!((volume - 8e-3).abs() < 1e-17, "{volume}");
}

/// A cube of twelve triangles with three vertices each: those at one position become one.
#[test]
fn triangles_without_common_vertices_are_joined() {
    let path = folder("good/by-hand/BODIES.patches.DAT");
    let Bodies(mut bodies) = Bodies::read(&path).unwrap();
    let contactor = &mut bodies[0].contactors[0];
    let cube = contactor.shape.clone();
    let ShapeRecord::Polyhedron { vertices, triangles } = &cube else { panic!("no polyhedron") };
    contactor.shape = ShapeRecord::Polyhedron {
        vertices: triangles.iter().flatten().map(|&k| vertices[k as usize]).collect(),
        triangles: (0..12).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
    };
    bodies.truncate(1);
    let text = Bodies(bodies).to_text();
    let (Bodies(read), notices) = Bodies::parse_with_notices(&path, &AsciiText::new(text.as_bytes())).unwrap();
    let expected = "28 vertices of POLYR are joined to another at the same position, up to the digits of the file";
    assert!(notices.len() == 1 && notices[0].ends_with(expected), "{notices:?}");
    let ShapeRecord::Polyhedron { vertices, triangles } = &read[0].contactors[0].shape else { panic!("no polyhedron") };
    assert_eq!((vertices.len(), triangles.len()), (8, 12));
    let volume = Surface::new(vertices, triangles).unwrap().volume();
    assert!((volume - 8e-3).abs() < 1e-9, "{volume}"); // digits of the file
}

#[test]
fn gravity_and_materials() {
    let bulk = BulkBehav::read(&folder("good/by-hand/DATBOX/BULK_BEHAV.DAT")).unwrap();
    assert_eq!(bulk.gravity, [1.0, 0.0, -9.81]);
    let materials: Vec<_> = bulk.materials.iter().map(|m| (m.name.as_str(), m.density)).collect();
    assert_eq!(materials, [("ROCKx", 2700.0), ("iron", 7800.0)]);
}

#[test]
fn laws_and_rows() {
    let tact = TactBehav::read(&folder("good/by-hand/DATBOX/TACT_BEHAV.DAT")).unwrap();
    // Parameters are 1/8, 2/8, 3/8 ... through the file.
    let all: Vec<f64> = tact.laws.iter().flat_map(|law| law.parameters.clone()).collect();
    let expected: Vec<f64> = (1..=all.len()).map(|k| k as f64 / 8.0).collect();
    assert_eq!(all, expected);
    for law in &tact.laws {
        assert_eq!(law.parameters.len(), law_parameters(&law.kind).count(), "{}", law.kind);
    }
    assert_eq!(tact.laws[3].kind, "RST_CLB");
    assert_eq!(tact.laws[3].nickname, "law03");
    assert_eq!(tact.laws[3].parameters.len(), 3);
    assert_eq!(tact.visibility.len(), 2, "a repeated row is dropped");
    let row = &tact.visibility[0];
    assert_eq!((row.candidate.contactor.as_str(), row.candidate.colour.as_str()), ("SPHER", "BLUEx"));
    assert_eq!((row.antagonist.contactor.as_str(), row.antagonist.colour.as_str()), ("PLANx", "FLOOR"));
    assert_eq!((row.law.as_str(), row.alert), ("law00", 0.01));
    assert_eq!(tact.visibility[1].law, "a");
}

#[test]
fn driven_components() {
    let DrvDof(driven) = DrvDof::read(&folder("good/by-hand/DATBOX/DRV_DOF.DAT")).unwrap();
    let places: Vec<_> = driven.iter().map(|d| (d.line, d.body, d.component, d.kind)).collect();
    let expected =
        [(6, 3, 0, DrivenKind::Velocity), (7, 3, 2, DrivenKind::Force), (14, 1_234_566, 5, DrivenKind::Velocity)];
    assert_eq!(places, expected);
    let harmonic =
        Evolution::Harmonic { constant: 1.0, amplitude: 2.0, omega: 3.0, phase: 4.0, ramp_start: 5.0, ramp_rate: 6.0 };
    assert_eq!(driven[0].evolution, harmonic);
    let points = vec![[0.0, -2.5], [1.0, 5.0], [2.5, 0.75]];
    assert_eq!(driven[1].evolution, Evolution::Table { name: "fz.dat".into(), points });
    assert_eq!(driven[2].evolution, Evolution::constant(0.0));
    assert_eq!(DrvDof::read(&folder("good/by-hand/DATBOX/absent.DAT")).unwrap(), DrvDof::default());
    assert_eq!(DrvDof::read(&folder("good/two-spheres/DATBOX/DRV_DOF.DAT")).unwrap(), DrvDof::default());
}

#[test]
fn contacts_of_all_layouts() {
    let state = VlocRloc::read(&folder("good/by-hand/DATBOX/Vloc_Rloc.INI")).unwrap();
    assert_eq!((state.step, state.time), (1_234_567, 1.25));
    let kinds: Vec<_> = state.contacts.iter().map(|contact| contact.kind.as_str()).collect();
    assert_eq!(kinds, ["PRPRx", "PTPT3", "SPCDx", "SPPLx", "SPPRx", "SPSPx"]);
    for contact in &state.contacts {
        let kind = &contact.kind;
        let far = if kind == "SPSPx" { 100_000 } else { 99_998 };
        assert_eq!((contact.candidate.body, contact.candidate.number), (1, 0), "{kind}");
        assert_eq!((contact.antagonist.body, contact.antagonist.number), (far, 11), "{kind}");
        assert_eq!(contact.law, "iqs00");
        // Written with the signs of LMGC90, read with ours: 1, 2, 3 along n, t, s and n x t = s.
        assert_eq!((contact.force, contact.velocity), ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]), "{kind}");
        assert_eq!((contact.gap, contact.point), (-0.25, [7.0, 8.0, 9.0]));
        let s = if kind == "PTPT3" { [0.0; 3] } else { [0.0, 1.0, 0.0] };
        let t = if kind == "PTPT3" { [0.0; 3] } else { [1.0, 0.0, 0.0] };
        assert_eq!(contact.frame, [[0.0, 0.0, 1.0], t, s], "{kind}");
    }
    let statuses: Vec<_> = state.contacts.iter().map(|contact| contact.status.as_str()).collect();
    assert_eq!(statuses, ["slide", "stick", "stick", "noctc", "Wstck", "stick"]);
    assert_eq!(state.contacts[4].antagonist.contactor, "POLYR");
    // The fourth is the sliding of an interface along s.
    let all_of_the_line: Vec<f64> = (1..20).map(|k| if k == 4 { -4.0 } else { f64::from(k) }).collect();
    assert_eq!(state.contacts[3].internals, all_of_the_line);
    assert_eq!(state.contacts[5].internals, [0.5]);
    assert!(state.contacts[4].internals.is_empty());
}

/// The relative velocity of a contact, computed from the motion of its bodies, is that of the file along
/// n, t and s: sides, normal and the turn of s are read with the right signs.
#[test]
fn signs_agree_with_the_bodies_motion() {
    let contacts = VlocRloc::read(&folder("good/two-spheres/OUTBOX/Vloc_Rloc.OUT.12")).unwrap();
    let dof = Dof::read(&folder("good/two-spheres/OUTBOX/DOF.OUT.12")).unwrap();
    assert_eq!((contacts.step, contacts.time), (dof.step, dof.time));
    let Bodies(bodies) = Bodies::read(&folder("good/two-spheres/DATBOX/BODIES.DAT")).unwrap();
    let contact = &contacts.contacts[0];
    let radius = [1.0, 0.8];
    // Velocity of both surfaces at the contact: v + omega x (arm), omega given along the body's axes.
    let surface = |k: usize, sign: f64| -> [f64; 3] {
        let BodyMotion { v, omega } = BodyMotion::from_dof(&dof, k);
        let arm = contact.frame[0].map(|n| sign * radius[k] * n);
        let turn = cross(omega, arm);
        [0, 1, 2].map(|c| v[c] + turn[c])
    };
    let (candidate, antagonist) = (surface(0, -1.0), surface(1, 1.0));
    for (row, expected) in contact.frame.iter().zip(contact.velocity) {
        let u: f64 = (0..3).map(|c| row[c] * (candidate[c] - antagonist[c])).sum();
        assert!((u - expected).abs() < 1e-4, "{u} {expected}"); // the bodies turned by half a step since
    }
    let centre = |k: usize| [0, 1, 2].map(|c| bodies[k].position[c] + dof.bodies[k].displacement[c]);
    let (a, b) = (centre(0), centre(1));
    let along: f64 = (0..3).map(|c| contact.frame[0][c] * (a[c] - b[c])).sum();
    assert!(along > 1.8, "n points to the candidate");
}

struct BodyMotion {
    v: [f64; 3],
    omega: [f64; 3],
}

impl BodyMotion {
    fn from_dof(dof: &Dof, k: usize) -> Self {
        let body = &dof.bodies[k];
        let [v1, v2, v3, w1, w2, w3] = body.velocity;
        let omega = [0, 1, 2].map(|c| w1 * body.axes[0][c] + w2 * body.axes[1][c] + w3 * body.axes[2][c]);
        BodyMotion { v: [v1, v2, v3], omega }
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
