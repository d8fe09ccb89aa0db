//! Report of numbers with more digits than the columns of DATBOX hold, which are rounded when they are written.

use std::fmt::Display;

use cd_formats::bodies::{Body, Contactor, LocalFrame, ShapeRecord};
use cd_formats::drv_dof::{DrivenComponent, DrvDof, Evolution};
use cd_formats::law_table::{LawParameter, law_parameters};
use cd_formats::scan::{format_long14, wide_fortran_real};

use super::tables::BehaviourTables;

/// Largest number of values of a file that are reported one by one.
const MAX_REPORTED_NUMBERS: usize = 5;

/// Report of the numbers that are not written with all their digits: the first five of each file, a line each, then the
/// count of the others.
///
/// `bodies` are the bodies of other runs. Their positions do not count, since START.npz has them.
pub fn lost_digits(bodies: &[Body], tables: &BehaviourTables, driven: &DrvDof) -> String {
    let body_texts =
        (1..).zip(bodies).flat_map(|(k, body)| inexact_numbers(format_args!("body {k}"), body_numbers(body)));
    let gravity = inexact_numbers("gravity", ["grv1", "grv2", "grv3"].into_iter().zip(tables.bulk.gravity));
    let materials = tables.bulk.materials.iter();
    let materials = materials.flat_map(|m| inexact_numbers(format_args!("material {}", m.name), [("Umas", m.density)]));
    let laws = tables.tact.laws.iter().flat_map(|law| {
        let labels = law_parameters(&law.kind).map(LawParameter::label);
        inexact_numbers(format_args!("law '{}'", law.nickname), labels.zip(law.parameters.iter().copied()))
    });
    let rows = (1..).zip(&tables.tact.visibility);
    let rows = rows.flat_map(|(k, row)| inexact_numbers(format_args!("visibility row {k}"), [("alert", row.alert)]));
    let functions = driven.0.iter().flat_map(|DrivenComponent { body, component, evolution, .. }| match *evolution {
        Evolution::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate } => {
            let names = ["CT", "AMP", "OMEGA", "PHI", "RAMPI", "RAMP"];
            let values = [constant, amplitude, omega, phase, ramp_start, ramp_rate];
            inexact_numbers(
                format_args!("body {}, component {}", body + 1, component + 1),
                names.into_iter().zip(values),
            )
        }
        Evolution::Table { .. } => Vec::new(),
    });
    let files: [(&str, Vec<String>); 4] = [
        ("BODIES.DAT", body_texts.collect()),
        ("BULK_BEHAV.DAT", gravity.into_iter().chain(materials).collect()),
        ("TACT_BEHAV.DAT", laws.chain(rows).collect()),
        ("DRV_DOF.DAT", functions.collect()),
    ];
    let mut text = String::new();
    for (file, lost) in files {
        lost.iter()
            .take(MAX_REPORTED_NUMBERS)
            .for_each(|lost| text += &format!("{file}: {lost}, the largest number of digits that fits its columns\n"));
        if lost.len() > MAX_REPORTED_NUMBERS {
            text += &format!(
                "{file}: {} more numbers are written with fewer digits than they have\n",
                lost.len() - MAX_REPORTED_NUMBERS
            );
        }
    }
    text
}

/// Numbers of an object, by their labels, that are not written with all their digits, in words.
fn inexact_numbers(object: impl Display, numbers: impl IntoIterator<Item = (&'static str, f64)>) -> Vec<String> {
    let lost = numbers.into_iter().filter(|(_, x)| wide_fortran_real(&format_long14(*x)) != Ok(*x));
    lost.map(|(label, x)| format!("{object}: {label} {x:?} is written as {}", format_long14(x).trim())).collect()
}

/// Numbers that determine the mass and the shape of a body.
fn body_numbers(body: &Body) -> Vec<(&'static str, f64)> {
    let mut numbers = vec![("avrd", body.equivalent_radius)];
    let mut add = |label, values: &[f64]| numbers.extend(values.iter().map(|x| (label, *x)));
    body.inertia.iter().for_each(|moments| add("I", moments));
    for Contactor { shape, local_frame, .. } in &body.contactors {
        match shape {
            ShapeRecord::Sphere { radius } => add("byrd", &[*radius]),
            ShapeRecord::OffsetSphere { radius, offset } => {
                add("byrd", &[*radius]);
                add("coo", offset);
            }
            ShapeRecord::Plane { half_lengths } => add("axe", half_lengths),
            ShapeRecord::Cylinder { half_height, radius, .. }
            | ShapeRecord::Capsule { half_length: half_height, radius } => {
                add("High", &[*half_height]);
                add("byrd", &[*radius]);
            }
            ShapeRecord::Polyhedron { vertices, .. } => add("coo", vertices.as_flattened()),
            ShapeRecord::Point { offset } => add("coo", offset),
            ShapeRecord::Mesh { radius, .. } => add("byrd", &[*radius]),
        }
        if let Some(LocalFrame { axes, offset }) = local_frame.as_deref() {
            add("localframe", axes.as_flattened());
            add("localframe", offset);
        }
    }
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_fit_their_columns_are_not_reported() {
        let messages =
            inexact_numbers("gravity", [("grv1", -9.80665), ("grv2", 1.23456789012), ("grv3", 1.2345678e-30)]);
        assert!(messages.is_empty(), "{messages:?}");
        let messages = inexact_numbers("gravity", [("grv1", 1.0 / 3.0), ("grv2", -1.23456789e-4), ("grv3", 0.0)]);
        let expected = [
            "gravity: grv1 0.3333333333333333 is written as 0.33333333333",
            "gravity: grv2 -0.000123456789 is written as -1.2345679E-04",
        ];
        assert_eq!(messages, expected);
    }

    #[test]
    fn all_numbers_of_a_body_count() {
        let third = 1.0 / 3.0;
        let contactor = |shape| Contactor { colour: "BLUEx".into(), shape, local_frame: None };
        let shapes = [
            (ShapeRecord::Sphere { radius: third }, 1),
            (ShapeRecord::OffsetSphere { radius: third, offset: [third; 3] }, 4),
            (ShapeRecord::Plane { half_lengths: [third; 3] }, 3),
            (ShapeRecord::Cylinder { half_height: third, radius: third, hollow: true }, 2),
            (ShapeRecord::Polyhedron { vertices: vec![[third; 3]; 4], triangles: Vec::new() }, 12),
            (ShapeRecord::Point { offset: [third; 3] }, 3),
        ];
        for (shape, count) in shapes {
            let mut body = Body {
                line: 0,
                material: "ROCKx".into(),
                equivalent_radius: third,
                inertia: Some([third; 3]),
                position: [third; 3],
                contactors: vec![contactor(shape)],
            };
            assert_eq!(inexact_numbers("body 1", body_numbers(&body)).len(), 4 + count, "{body:?}");
            body.contactors[0].local_frame = Some(Box::new(LocalFrame { axes: [[third; 3]; 3], offset: [third; 3] }));
            assert_eq!(inexact_numbers("body 1", body_numbers(&body)).len(), 16 + count);
        }
    }
}
