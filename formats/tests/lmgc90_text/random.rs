//! Random values survive writing and reading; random damage is never a panic.

use std::fs;
use std::path::Path;

use cd_formats::bodies::{Bodies, Body, Contactor, LocalFrame, ShapeRecord};
use cd_formats::bulk_behav::{BulkBehav, Material};
use cd_formats::dof::{BodyDof, Dof};
use cd_formats::drv_dof::{DrivenComponent, DrivenKind, DrvDof, Evolution, table_text};
use cd_formats::law_table::LAW_TABLE;
use cd_formats::scan::{AsciiText, format_d14, fortran_real};
use cd_formats::tact_behav::{LawRecord, TactBehav, VisibilityRow, VisibilitySide};
use cd_formats::vloc_rloc::{ContactRecord, ContactSide, VlocRloc};
use cd_formats::wall_mesh::MeshSides;
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use proptest::sample::{Index, select};

use crate::{KINDS, files, folder, rewrite};

/// Writes, reads, compares all but the numbers of lines, and writes again.
macro_rules! round_trip {
    ($value:expr, $kind:ty, $forget:expr) => {{
        let value: $kind = $value;
        let once = value.to_text();
        let mut read = <$kind>::parse(Path::new("f"), &AsciiText::new(once.as_bytes()))
            .map_err(|faults| TestCaseError::fail(format!("{faults}\n{once}")))?;
        prop_assert_eq!(&read.to_text(), &once, "the second writing differs");
        let forget: fn(&mut $kind) = $forget;
        forget(&mut read);
        prop_assert_eq!(read, value);
    }};
}

// --- values that the files hold exactly: a few decimal digits -------------------------------------------------------

fn decimal(digits: u32, exponents: std::ops::RangeInclusive<i32>) -> impl Strategy<Value = f64> {
    (0..10_u64.pow(digits), exponents)
        .prop_map(|(mantissa, exponent)| format!("{mantissa}e{exponent}").parse().unwrap())
}

/// More than zero, eight digits.
fn size() -> impl Strategy<Value = f64> {
    decimal(8, -90..=32).prop_map(|x| if x == 0.0 { 1.5 } else { x })
}

/// Eight digits, as in input files.
fn real() -> impl Strategy<Value = f64> {
    prop_oneof![1 => select(&[0.0, -0.0][..]), 5 => (decimal(8, -90..=32), any::<bool>()).prop_map(signed)]
}

/// Seven digits, as in state files.
fn state_real() -> impl Strategy<Value = f64> {
    prop_oneof![1 => select(&[0.0, -0.0][..]), 5 => (decimal(7, -90..=32), any::<bool>()).prop_map(signed)]
}

fn signed((x, minus): (f64, bool)) -> f64 {
    if minus { -x } else { x }
}

fn three<S: Strategy<Value = f64>>(one: fn() -> S) -> impl Strategy<Value = [f64; 3]> {
    [one(), one(), one()]
}

/// Orthonormal, right-handed rows with seven digits.
fn frame() -> impl Strategy<Value = [[f64; 3]; 3]> {
    [-1.0..1.0, -1.0..1.0, -1.0..1.0, 0.1..1.0].prop_map(|q: [f64; 4]| {
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        let [x, y, z, w] = q.map(|x| x / norm);
        let rows = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        rows.map(|row| row.map(|x| fortran_real(&format_d14(x)).unwrap()))
    })
}

fn name() -> impl Strategy<Value = String> {
    "[a-zA-Z_+*$][a-zA-Z0-9_+*$]{0,4}"
}

// --- files ----------------------------------------------------------------------------------------------------------

fn shape() -> impl Strategy<Value = ShapeRecord> {
    let polyhedron = (vec(three(real), 4..9), vec([any::<Index>(), any::<Index>(), any::<Index>()], 4..9)).prop_map(
        |(vertices, triangles)| {
            let count = vertices.len();
            let triangles = triangles.into_iter().map(|corners| {
                // Three different vertices.
                let [a, b, c] = [corners[0].index(count), corners[1].index(count - 1), corners[2].index(count - 2)];
                let b = (a + 1 + b) % count;
                let c = (0..count).filter(|v| ![a, b].contains(v)).nth(c).unwrap();
                [a, b, c].map(|v| v as u32)
            });
            ShapeRecord::Polyhedron { triangles: triangles.collect(), vertices }
        },
    );
    prop_oneof![
        size().prop_map(|radius| ShapeRecord::Sphere { radius }),
        (size(), three(real)).prop_map(|(radius, offset)| ShapeRecord::OffsetSphere { radius, offset }),
        [size(), size(), size()].prop_map(|half_lengths| ShapeRecord::Plane { half_lengths }),
        (size(), size(), any::<bool>()).prop_map(|(half_height, radius, hollow)| ShapeRecord::Cylinder {
            half_height,
            radius,
            hollow
        }),
        polyhedron,
        three(real).prop_map(|offset| ShapeRecord::Point { offset }),
        (size(), any::<bool>(), 0..1000u32).prop_map(|(radius, is_two_sided, number)| ShapeRecord::Mesh {
            radius,
            sides: if is_two_sided { MeshSides::Both } else { MeshSides::One },
            file: format!("wall-{number}.obj").into(),
            surface: None
        }),
    ]
}

fn contactor() -> impl Strategy<Value = Contactor> {
    let local_frame = option::of((frame(), three(real)).prop_map(|(axes, offset)| LocalFrame { axes, offset }));
    (name(), shape(), local_frame).prop_map(|(colour, shape, local_frame)| {
        let framed = matches!(shape, ShapeRecord::Plane { .. } | ShapeRecord::Cylinder { hollow: false, .. });
        Contactor { colour, local_frame: local_frame.filter(|_| framed).map(Box::new), shape }
    })
}

fn body() -> impl Strategy<Value = Body> {
    let inertia = option::of([size(), size(), size()]);
    (name(), size(), inertia, three(real), vec(contactor(), 1..4)).prop_map(
        |(material, equivalent_radius, inertia, position, contactors)| {
            let equivalent_radius = match contactors.as_slice() {
                [Contactor { shape: ShapeRecord::Sphere { radius }, .. }] => *radius,
                _ => equivalent_radius,
            };
            Body { line: 0, material, equivalent_radius, inertia, position, contactors }
        },
    )
}

fn distinct<T>(values: Vec<T>, key: impl Fn(&T) -> String) -> Vec<T> {
    let mut seen = std::collections::HashSet::new();
    values.into_iter().filter(|value| seen.insert(key(value))).collect()
}

fn tact_behav() -> impl Strategy<Value = TactBehav> {
    let law = (name(), select(LAW_TABLE), vec(size(), 10)).prop_map(|(nickname, entry, mut parameters)| {
        parameters.truncate(entry.parameters().count());
        LawRecord { line: 0, nickname, kind: entry.label.to_string(), parameters }
    });
    let side = || {
        const CONTACTORS: [&str; 7] = ["SPHER", "SPHEb", "PLANx", "CYLND", "DNLYC", "POLYR", "PT3Dx"];
        (select(&CONTACTORS[..]), name()).prop_map(|(contactor, colour)| VisibilitySide {
            body: "RBDY3".into(),
            contactor: contactor.into(),
            colour,
        })
    };
    let row = (side(), any::<Index>(), side(), size());
    (vec(law, 1..5), vec(row, 0..5)).prop_map(|(laws, rows)| {
        let laws = distinct(laws, |law| law.nickname.clone());
        let rows = rows.into_iter().map(|(candidate, law, antagonist, alert)| {
            let law = law.get(&laws).nickname.clone();
            VisibilityRow { line: 0, candidate, law, antagonist, alert }
        });
        let visibility = distinct(rows.collect(), |row| {
            let mut sides = [format!("{:?}", row.candidate), format!("{:?}", row.antagonist)];
            sides.sort();
            sides.concat()
        });
        TactBehav { laws, visibility }
    })
}

fn driven(evolution: impl Strategy<Value = Evolution>) -> impl Strategy<Value = DrivenComponent> {
    let kind = select(&[DrivenKind::Velocity, DrivenKind::Force][..]);
    (0..99_999_999_usize, 0..6_usize, kind, evolution).prop_map(|(body, component, kind, evolution)| DrivenComponent {
        line: 0,
        body,
        component,
        kind,
        evolution,
    })
}

fn drv_dof(evolution: impl Strategy<Value = Evolution>) -> impl Strategy<Value = DrvDof> {
    vec(driven(evolution), 0..8).prop_map(|all| {
        let mut all = distinct(all, |d| format!("{} {}", d.body, d.component));
        all.sort_by_key(|driven| driven.body);
        DrvDof(all)
    })
}

fn harmonic() -> impl Strategy<Value = Evolution> {
    (three(real), three(real)).prop_map(|([constant, amplitude, omega], [phase, ramp_start, ramp_rate])| {
        Evolution::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate }
    })
}

fn dof() -> impl Strategy<Value = Dof> {
    let six = || [state_real(), state_real(), state_real(), state_real(), state_real(), state_real()];
    let body = (0..9_999_999_usize, six(), six(), frame()).prop_map(|(body, displacement, velocity, axes)| BodyDof {
        line: 0,
        body,
        displacement,
        velocity,
        axes,
    });
    (0..9_999_999_u64, state_real(), vec(body, 0..5)).prop_map(|(step, time, bodies)| Dof {
        step,
        time,
        bodies: distinct(bodies, |body| body.body.to_string()),
    })
}

/// In the order of the file.
const CONTACTS: [&str; 10] = ["CDCDx", "CDPLx", "PRPLx", "PRPRx", "PTPT3", "SPCDx", "SPDCx", "SPPLx", "SPPRx", "SPSPx"];

fn contact() -> impl Strategy<Value = ContactRecord> {
    // SPSPx beyond 99 999 have a layout of their own.
    let side = |wide: bool| {
        let bodies = 0..if wide { 9_999_999_usize } else { 99_999 };
        (bodies, name(), 0..99_999_usize).prop_map(|(body, contactor, number)| ContactSide { body, contactor, number })
    };
    let kind =
        select(&CONTACTS[..]).prop_flat_map(move |kind| (Just(kind), side(kind == "SPSPx"), side(kind == "SPSPx")));
    let vectors = (three(state_real), three(state_real), state_real(), frame(), three(state_real));
    (kind, name(), name(), vectors, vec(state_real(), 0..20)).prop_map(
        |((kind, candidate, antagonist), law, status, (force, velocity, gap, mut frame, point), internals)| {
            if kind == "PTPT3" {
                frame[1..].fill([0.0; 3]);
            }
            let kind = kind.to_string();
            ContactRecord {
                line: 0,
                kind,
                candidate,
                antagonist,
                law,
                status,
                force,
                velocity,
                gap,
                frame,
                is_left_handed: false,
                point,
                internals,
            }
        },
    )
}

fn vloc_rloc() -> impl Strategy<Value = VlocRloc> {
    (0..9_999_999_u64, state_real(), vec(contact(), 0..6)).prop_map(|(step, time, mut contacts)| {
        contacts.sort_by(|a, b| a.kind.cmp(&b.kind)); // stable; the order of the file is that of the alphabet
        VlocRloc { step, time, contacts }
    })
}

proptest! {
    #[test]
    fn bodies_survive(bodies in vec(body(), 1..5)) {
        round_trip!(Bodies(bodies), Bodies, |read| read.0.iter_mut().for_each(|body| body.line = 0));
    }

    #[test]
    fn materials_survive(gravity in three(real), materials in vec((name(), size()), 0..5)) {
        let materials = materials.into_iter().map(|(name, density)| Material { name, density }).collect();
        let materials = distinct(materials, |material| material.name.clone());
        round_trip!(BulkBehav { gravity, materials }, BulkBehav, |_| {});
    }

    #[test]
    fn laws_survive(tact in tact_behav()) {
        round_trip!(tact, TactBehav, |read| {
            read.laws.iter_mut().for_each(|law| law.line = 0);
            read.visibility.iter_mut().for_each(|row| row.line = 0);
        });
    }

    #[test]
    fn driven_components_survive(drv in drv_dof(harmonic())) {
        round_trip!(drv, DrvDof, |read| read.0.iter_mut().for_each(|driven| driven.line = 0));
    }

    #[test]
    fn states_survive(state in dof()) {
        round_trip!(state, Dof, |read| read.bodies.iter_mut().for_each(|body| body.line = 0));
    }

    #[test]
    fn contacts_survive(state in vloc_rloc()) {
        round_trip!(state, VlocRloc, |read| read.contacts.iter_mut().for_each(|contact| contact.line = 0));
    }

    /// Random bytes, mostly those that such files are made of.
    #[test]
    fn garbage_is_no_panic(text in "([ $!#+*.0-9DEx\\-\n\r\t]|\\$bdyty\n|\\$\\$\\$\\$\\$\\$\n| RBDY3 |\\PC){0,400}", bytes in vec(any::<u8>(), 0..200)) {
        for kind in KINDS {
            let _ = rewrite(Path::new(kind), text.as_bytes());
            let _ = rewrite(Path::new(kind), &bytes);
        }
    }

    /// Good files with lines and bytes changed, taken out and put in.
    #[test]
    fn damage_is_no_panic(
        file in any::<Index>(),
        lines in vec((any::<Index>(), any::<Index>(), 0..3), 0..4),
        bytes in vec((any::<Index>(), prop_oneof![any::<u8>(), select(&b" 0123456789.*$-ED\n"[..])], 0..3), 0..6),
    ) {
        let files = files(&folder("good"));
        let path = file.get(&files);
        let text = fs::read(path).unwrap();
        let mut all: Vec<_> = text.split_inclusive(|&byte| byte == b'\n').collect();
        all.truncate(400);
        for (at, other, what) in lines {
            let (at, other) = (at.index(all.len()), other.index(all.len()));
            match what {
                0 => all.swap(at, other),
                1 => all.insert(at, all[other]),
                _ => drop((all.len() > 1).then(|| all.remove(at))),
            }
        }
        let mut text = all.concat();
        for (at, byte, what) in bytes {
            let at = at.index(text.len());
            match what {
                0 => text[at] = byte,
                1 => text.insert(at, byte),
                _ => drop((text.len() > 1).then(|| text.remove(at))),
            }
        }
        // What is still read is written in a form that is read again, unless the damage made a number
        // too large for its columns, or a length so small that it is written as zero.
        if let Ok(written) = rewrite(path, &text) {
            match rewrite(path, written.as_bytes()) {
                Ok(again) => prop_assert_eq!(again, written),
                Err(faults) => prop_assert!(
                    written.contains("**") || faults.to_string().contains("is 0.0; expected more"),
                    "{}", faults
                ),
            }
        }
    }
}

#[test]
fn tables_survive() {
    let folder = tempfile::tempdir().unwrap();
    let points = vec![[-1.5, 1.0 / 3.0], [0.0, -1.2345678e-30], [200000.001, 0.1], [200000.002, f64::MIN_POSITIVE]];
    let table = Evolution::Table { name: "push-north.dat".into(), points: points.clone() };
    let drv = DrvDof(vec![
        DrivenComponent { line: 6, body: 4, component: 2, kind: DrivenKind::Force, evolution: table },
        DrivenComponent {
            line: 7,
            body: 4,
            component: 0,
            kind: DrivenKind::Velocity,
            evolution: Evolution::constant(1.0),
        },
    ]);
    fs::write(folder.path().join("push-north.dat"), table_text(&points)).unwrap();
    fs::write(folder.path().join("DRV_DOF.DAT"), drv.to_text()).unwrap();
    assert_eq!(DrvDof::read(&folder.path().join("DRV_DOF.DAT")).unwrap(), drv);
}

/// Numbers of twelve digits; those of eight stand as in the plain text.
#[test]
fn long_texts_hold_what_their_columns_hold() {
    let [long, short] = [1.23456789012, 0.25];
    let body = |x: f64| Body {
        line: 1,
        material: "ROCKx".into(),
        equivalent_radius: x,
        inertia: Some([x; 3]),
        position: [x; 3],
        contactors: vec![Contactor {
            colour: "BLUEx".into(),
            shape: ShapeRecord::Sphere { radius: x },
            local_frame: None,
        }],
    };
    let bodies = |x| Bodies(vec![body(x)]);
    let bulk = |x: f64| BulkBehav { gravity: [-x; 3], materials: vec![Material { name: "ROCKx".into(), density: x }] };
    let side = || VisibilitySide { body: "RBDY3".into(), contactor: "SPHER".into(), colour: "BLUEx".into() };
    let tact = |x| TactBehav {
        laws: vec![LawRecord { line: 2, nickname: "iqsc0".into(), kind: "IQS_CLB".into(), parameters: vec![x] }],
        visibility: vec![VisibilityRow {
            line: 5,
            candidate: side(),
            law: "iqsc0".into(),
            antagonist: side(),
            alert: x,
        }],
    };
    let driven = |x: f64| {
        let evolution =
            Evolution::Harmonic { constant: x, amplitude: -x, omega: x, phase: -x, ramp_start: x, ramp_rate: -x };
        DrvDof(vec![DrivenComponent { line: 6, body: 0, component: 0, kind: DrivenKind::Force, evolution }])
    };
    let path = Path::new("f");
    assert_eq!(Bodies::parse(path, &AsciiText::new(bodies(long).to_long_text().as_bytes())), Ok(bodies(long)));
    assert_eq!(BulkBehav::parse(path, &AsciiText::new(bulk(long).to_long_text().as_bytes())), Ok(bulk(long)));
    assert_eq!(TactBehav::parse(path, &AsciiText::new(tact(long).to_long_text().as_bytes())), Ok(tact(long)));
    assert_eq!(DrvDof::parse(path, &AsciiText::new(driven(long).to_long_text().as_bytes())), Ok(driven(long)));
    assert_eq!(bodies(short).to_long_text(), bodies(short).to_text());
    assert_eq!(bulk(short).to_long_text(), bulk(short).to_text());
    assert_eq!(tact(short).to_long_text(), tact(short).to_text());
    assert_eq!(driven(short).to_long_text(), driven(short).to_text());
}

#[test]
#[should_panic(expected = "contacts of kind 'SPXXx' cannot be written")]
fn a_contact_of_unknown_kind_is_not_lost_in_writing() {
    let side = ContactSide { body: 0, contactor: "SPHER".into(), number: 0 };
    let contact = ContactRecord {
        line: 0,
        kind: "SPXXx".into(),
        candidate: side.clone(),
        antagonist: side,
        law: "iqsc0".into(),
        status: "stick".into(),
        force: [0.0; 3],
        velocity: [0.0; 3],
        gap: 0.0,
        frame: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        is_left_handed: false,
        point: [0.0; 3],
        internals: Vec::new(),
    };
    VlocRloc { step: 0, time: 0.0, contacts: vec![contact] }.to_text();
}

#[test]
fn files_that_cannot_be_opened_are_faults() {
    let absent = folder("good/absent");
    for faults in [
        Bodies::read(&absent).unwrap_err(),
        BulkBehav::read(&absent).unwrap_err(),
        TactBehav::read(&absent).unwrap_err(),
        Dof::read(&absent).unwrap_err(),
        VlocRloc::read(&absent).unwrap_err(),
        DrvDof::read(&folder("good")).unwrap_err(), // a folder is there, and no file
    ] {
        assert_eq!(faults.0.len(), 1);
        assert!(faults.to_string().contains("file: cannot be read"), "{faults}");
    }
}
