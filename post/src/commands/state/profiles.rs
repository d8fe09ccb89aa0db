//! Profiles by radius, and layers of a bed.

use crate::commands::state::file::{StateFile, text_file};
use crate::derive::bed::{Bed, Layer};
use crate::derive::fragments::{Fragment, find_fragments};
use crate::derive::profile::radial_shells;
use crate::frame::Frame;
use crate::write::figure::{Curve, Figure, FigureAxis};
use crate::write::series::{Column, csv_table};

/// Columns of profile.csv.
pub const PROFILE_COLUMNS: [Column; 8] = [
    ("inner", "m", "distance from the centre of mass"),
    ("outer", "m", ""),
    ("nu", "1", "solid fraction by radius"),
    ("grains", "1", "grains with their centre in the shell"),
    ("Z", "1", "neighbours per grain by radius"),
    ("pressure", "Pa", "pressure by radius"),
    ("radial_stress", "Pa", "radial stress by radius"),
    ("tangential_stress", "Pa", "tangential stress by radius"),
];

/// Columns of layers.csv.
pub const LAYER_COLUMNS: [Column; 17] = [
    ("lower", "m", "height above the floor"),
    ("upper", "m", ""),
    ("nu", "1", "solid fraction by height"),
    ("grains", "1", "grains with their centre in the layer"),
    ("Z", "1", "neighbours per grain by height"),
    ("pressure", "Pa", "pressure by height"),
    ("vertical_stress", "Pa", "vertical stress by height"),
    ("horizontal_stress", "Pa", "horizontal stress by height"),
    ("shear_stress", "Pa", "shear stress by height"),
    ("weight", "Pa", "weight above, divided by the area, by height"),
    ("v_x", "m/s", "mean velocity along x by height"),
    ("v_y", "m/s", "mean velocity along y by height"),
    ("v_z", "m/s", "mean velocity along z by height"),
    ("density", "kg/m³", "mass over volume by height"),
    ("pressure_kinetic", "Pa", "kinetic pressure by height, of velocities relative to the mean"),
    ("vertical_kinetic", "Pa", "vertical kinetic stress by height"),
    ("shear_kinetic", "Pa", "shear kinetic stress by height"),
];

/// Number of shells of the radial profiles and of layers of a bed.
pub const SHELL_COUNT: usize = 20;

/// Figure of curves against a length.
fn curve_figure(length: &str, title: &str, quantity: &str, unit: &str, curves: Vec<Curve>) -> String {
    Figure { title: title.into(), x: FigureAxis::linear(length, "m"), y: FigureAxis::linear(quantity, unit), curves }
        .to_svg()
}

/// Radial profiles of the largest remnant.
pub fn profile_files(frame: &Frame, largest: &Fragment) -> Vec<StateFile> {
    let shells = radial_shells(frame, &largest.grains, largest.sums.x, SHELL_COUNT);
    let rows =
        shells.iter().map(|s| [s.inner, s.outer, s.nu, s.grains as f64, s.z, s.pressure, s.radial, s.tangential]);
    let points = |value: &dyn Fn(usize) -> f64| -> Vec<(f64, f64)> {
        (0..shells.len()).map(|k| (0.5 * (shells[k].inner + shells[k].outer), value(k))).collect()
    };
    let figure =
        |title, quantity, unit, curves| curve_figure("distance from the centre of mass", title, quantity, unit, curves);
    let nu = vec![Curve::line("ν", points(&|k| shells[k].nu))];
    let z = vec![Curve::line("Z", points(&|k| shells[k].z))];
    let stress = vec![
        Curve::line("pressure", points(&|k| shells[k].pressure)),
        Curve::line("radial", points(&|k| shells[k].radial)),
        Curve::line("tangential", points(&|k| shells[k].tangential)),
    ];
    vec![
        text_file("profile.csv", csv_table(&PROFILE_COLUMNS, rows)),
        text_file("profile_nu.svg", figure("Solid fraction by radius", "ν", "1", nu)),
        text_file("profile_Z.svg", figure("Neighbours per grain by radius", "Z", "1", z)),
        text_file("profile_stress.svg", figure("Stress by radius", "stress", "Pa", stress)),
    ]
}

/// Files of the mean layers of a bed over the frames that have one, from the floor to its highest point in any of them; and
/// the number of these frames.
pub fn mean_layers(frames: &[Frame]) -> (Vec<StateFile>, usize) {
    let bed_of = |frame| Bed::from_frame(frame, &find_fragments(frame)).map(|bed| (bed, frame));
    let beds: Vec<(Bed, &Frame)> = frames.iter().filter_map(bed_of).collect();
    let top = beds.iter().map(|(bed, frame)| bed.top_height(frame)).fold(0.0, f64::max);
    let layers_by_frame: Vec<Vec<Layer>> =
        beds.iter().map(|(bed, frame)| bed.layers(frame, SHELL_COUNT, top)).collect();
    let layer = |k: usize| Layer::mean_over_times(layers_by_frame.iter().map(|layers| &layers[k]));
    let mean: Vec<Layer> = (0..SHELL_COUNT).map(layer).collect();
    (if beds.is_empty() { Vec::new() } else { layer_files(&mean) }, beds.len())
}

/// Files of the layers of a bed.
pub fn layer_files(layers: &[Layer]) -> Vec<StateFile> {
    let row = |l: &Layer| {
        let (stress, motion, v) = (l.contact_stress(), l.kinetic_stress(), l.velocity());
        [
            l.lower,
            l.upper,
            l.nu,
            l.grains,
            l.mean_coordination(),
            stress.pressure,
            stress.vertical,
            stress.horizontal,
            stress.shear.norm(),
            l.weight,
            v.x,
            v.y,
            v.z,
            l.density,
            motion.pressure,
            motion.vertical,
            motion.shear.norm(),
        ]
    };
    let curve = |name: &str, value: fn(&Layer) -> f64| {
        Curve::line(name, layers.iter().map(|l| (0.5 * (l.lower + l.upper), value(l))).collect())
    };
    let figure = |title, quantity, unit, curves| curve_figure("height above the floor", title, quantity, unit, curves);
    let stress = vec![
        curve("vertical", |l| l.contact_stress().vertical),
        curve("horizontal", |l| l.contact_stress().horizontal),
        curve("shear", |l| l.contact_stress().shear.norm()),
        curve("weight above", |l| l.weight),
    ];
    vec![
        text_file("layers.csv", csv_table(&LAYER_COLUMNS, layers.iter().map(row))),
        text_file("layers_nu.svg", figure("Solid fraction by height", "ν", "1", vec![curve("ν", |l| l.nu)])),
        text_file(
            "layers_Z.svg",
            figure("Neighbours per grain by height", "Z", "1", vec![curve("Z", Layer::mean_coordination)]),
        ),
        text_file("layers_stress.svg", figure("Stress by height", "stress", "Pa", stress)),
    ]
}
