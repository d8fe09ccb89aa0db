//! Fragments with their orbits, and speeds of ejected grains.

use std::collections::HashSet;

use crate::commands::state::file::{StateFile, text_file};
use crate::derive::energy::self_gravity_constant;
use crate::derive::fragments::Fragment;
use crate::derive::motion::RotatingAxes;
use crate::derive::orbits::fragment_orbits;
use crate::frame::{Frame, Grain};
use crate::write::figure::{Curve, CurveMarks, Figure, FigureAxis};
use crate::write::series::{Column, csv_table, csv_with_counts};

/// Columns of ejecta.csv.
pub const EJECTA_COLUMNS: [Column; 3] = [
    ("speed", "m/s", "speed relative to the largest remnant"),
    ("speed_over_escape", "1", ""),
    ("mass_share_faster", "1", "share of the mass that is as fast or faster"),
];

/// Files of the fragments with their orbits about the largest, and of the speeds of the grains outside it, without
/// `added_bodies`.
pub fn ejecta_files(frame: &Frame, fragments: &[Fragment], added_bodies: &HashSet<u64>) -> Vec<StateFile> {
    let constant = self_gravity_constant(frame).unwrap_or(0.0);
    let cell = frame.cell();
    let largest = &fragments[0].sums;
    let mut orbits = fragment_orbits(fragments, constant).into_iter().map(Some).collect::<Vec<_>>();
    orbits.insert(0, None);
    let header = [
        "fragment",
        "grains",
        "mass",
        "x",
        "y",
        "z",
        "v_x",
        "v_y",
        "v_z",
        "a",
        "b",
        "c",
        "spin_x",
        "spin_y",
        "spin_z",
        "period",
        "distance",
        "speed",
        "bound",
        "orbit_a",
        "orbit_e",
        "inclination",
        "pericentre",
        "orbit_period",
        "speed_at_infinity",
    ];
    let row = |(k, (fragment, orbit)): (usize, (&Fragment, Option<crate::derive::orbits::Orbit>))| {
        let sums = &fragment.sums;
        let (x, v) = (frame.origin.written_position(sums.x), frame.origin.written_velocity(sums.velocity()));
        let (w, [a, b, c]) = (sums.spin(), sums.semi_axes());
        let mut row = vec![k as f64, fragment.grains.len() as f64, sums.mass];
        row.extend(
            (0..3).map(|axis| if cell.periods[axis].is_some() { f64::NAN } else { x[axis] }).chain(v.iter().copied()),
        );
        // In a periodic scene arms would depend on the position of the border.
        let arms = [a, b, c, w.x, w.y, w.z, std::f64::consts::TAU / w.norm(), orbit.map_or(f64::NAN, |o| o.distance)];
        row.extend(arms.map(|value| if cell.is_periodic() { f64::NAN } else { value }));
        row.push(orbit.map_or(f64::NAN, |o| o.speed));
        match orbit.filter(|_| constant > 0.0) {
            Some(o) => {
                row.extend([f64::from(u8::from(o.is_bound())), o.a, o.e]);
                row.extend([o.inclination, o.pericentre, o.period, o.speed_at_infinity]);
            }
            None => row.extend([f64::NAN; 7]),
        }
        row
    };
    let groups =
        csv_with_counts(&header, &["fragment", "grains", "bound"], fragments.iter().zip(orbits).enumerate().map(row));

    let is_native = |grain: &&Grain| !added_bodies.contains(&grain.id);
    let mass: f64 = frame.grains.iter().filter(is_native).map(|grain| grain.mass).sum();
    let others = fragments.iter().skip(1).flat_map(|fragment| fragment.grains.iter().map(|&i| &frame.grains[i]));
    let axes = RotatingAxes::from_frame(frame);
    let speed = |grain: &Grain| (grain.v + axes.velocity(grain.x) - largest.velocity()).norm();
    let mut speeds: Vec<(f64, f64)> = others.filter(is_native).map(|grain| (speed(grain), grain.mass / mass)).collect();
    speeds.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut share_faster = 0.0;
    let mut cumulative: Vec<(f64, f64)> = Vec::new();
    // Grains of equal speed have one share: each is as fast as the others.
    for equal in speeds.chunk_by(|a, b| a.0 == b.0) {
        share_faster += equal.iter().map(|(_, share)| share).sum::<f64>();
        cumulative.extend(equal.iter().map(|(speed, _)| (*speed, share_faster)));
    }
    let [a, b, c] = largest.semi_axes();
    let escape = (2.0 * constant * largest.mass / (a * b * c).cbrt()).sqrt();
    let rows = cumulative
        .iter()
        .rev()
        .map(|&(speed, share)| [speed, if escape > 0.0 { speed / escape } else { f64::NAN }, share]);
    let figure = Figure {
        title: "Grains that have left the largest remnant".into(),
        x: FigureAxis::linear("speed relative to it", "m/s"),
        y: FigureAxis::linear("share of the mass that is as fast or faster", "1"),
        curves: vec![Curve { name: "grains".into(), points: cumulative.clone(), marks: CurveMarks::Dots }],
    };
    vec![
        text_file("fragments.csv", groups),
        text_file("ejecta.csv", csv_table(&EJECTA_COLUMNS, rows)),
        text_file("ejecta.svg", figure.to_svg()),
    ]
}
