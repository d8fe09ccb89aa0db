//! `cd-post state`: profiles, forces, fabric and surface of one snapshot, each table with a figure.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};
use vtkio::model::{Attributes, PolyDataPiece};

use crate::derive::bed::{Bed, Layer};
use crate::derive::coordination::touches_with_force;
use crate::derive::energy::self_gravity_constant;
use crate::derive::fabric::{anisotropy, eigenvalues, fabric_tensor, mobilised_share, probability_density};
use crate::derive::fragments::{Fragment, find_fragments};
use crate::derive::free_surface::{self, FreeSurface};
use crate::derive::motion::RotatingAxes;
use crate::derive::orbits::fragment_orbits;
use crate::derive::plane_fit;
use crate::derive::profile::radial_shells;
use crate::derive::surface::{DirectionGrid, SurfaceFacet, aggregate_surface, rms_noise, slopes_below};
use crate::frame::{Contact, Frame, Grain, Vec3};
use crate::list_snapshots;
use crate::shapes::ShapeCache;
use crate::write::display::{flat_components, scalar_attribute, vector_attribute, vertex_numbers, vtp_bytes};
use crate::write::figure::{Curve, CurveMarks, Figure, FigureAxis};
use crate::write::map::{self, MapSheet};
use crate::write::series::{Column, csv_table, csv_text, csv_with_counts};

/// Name and contents of a file.
pub type File = (&'static str, Vec<u8>);

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
    ("weight", "Pa", "weight above over the area by height"),
    ("v_x", "m/s", "mean velocity along x by height"),
    ("v_y", "m/s", "mean velocity along y by height"),
    ("v_z", "m/s", "mean velocity along z by height"),
    ("density", "kg/m³", "mass over volume by height"),
    ("pressure_kinetic", "Pa", "pressure of the motion about the mean by height"),
    ("vertical_kinetic", "Pa", "vertical stress of the motion about the mean by height"),
    ("shear_kinetic", "Pa", "shear stress of the motion about the mean by height"),
];
/// Columns of forces.csv.
pub const FORCE_COLUMNS: [Column; 4] = [
    ("force_over_mean", "1", ""),
    ("P_normal", "1", "probability density of normal forces between grains that push"),
    ("P_tangential", "1", "probability density of tangential forces between grains"),
    ("P_tension", "1", "probability density of normal forces between grains that pull"),
];
/// Columns of mobilisation.csv.
pub const MOBILISATION_COLUMNS: [Column; 2] = [
    ("share", "1", "tangential force over the largest possible"),
    ("P", "1", "probability density of mobilised friction"),
];
/// Columns of ejecta.csv.
pub const EJECTA_COLUMNS: [Column; 3] = [
    ("speed", "m/s", "speed relative to the largest remnant"),
    ("speed_over_escape", "1", ""),
    ("mass_share_faster", "1", "share of the mass that is as fast or faster"),
];
/// Columns of surface.csv of a heap or bed.
pub const SURFACE_COLUMNS: [Column; 6] = [
    ("x", "m", ""),
    ("y", "m", ""),
    ("z", "m", ""),
    ("height", "m", "height above the lowest point of the grains"),
    ("slope", "°", "angle between the normal and the direction against gravity"),
    ("slope_error", "°", "standard error of the slope that single grains leave"),
];
/// Columns of slopes.csv.
pub const SLOPE_COLUMNS: [Column; 2] =
    [("share_below", "1", "share of the surface"), ("slope", "°", "slope that a share of the surface is below")];

/// Names of all possible files of a state.
const STATE_FILES: [&str; 22] = [
    "ejecta.csv",
    "ejecta.svg",
    "fabric.csv",
    "forces.csv",
    "forces.svg",
    "fragments.csv",
    "layers.csv",
    "layers_Z.svg",
    "layers_nu.svg",
    "layers_stress.svg",
    "mobilisation.csv",
    "mobilisation.svg",
    "profile.csv",
    "profile_Z.svg",
    "profile_nu.svg",
    "profile_stress.svg",
    "slopes.csv",
    "slopes.svg",
    "surface.csv",
    "surface.vtp",
    "surface_height.svg",
    "surface_slope.svg",
];

/// Shares of the surface with listed slopes: every twentieth.
const SLOPE_SHARE_COUNT: usize = 20;
/// Number of shells of the radial profiles and of layers of a bed.
const SHELL_COUNT: usize = 20;
/// Width of a bin of the distributions of forces, in units of the mean.
const FORCE_BIN_WIDTH: f64 = 0.25;

/// Reads a snapshot, the last without `step`; writes `POSTPRO/state-NNNNNN/` and returns its path and messages for the
/// user. Layers of a bed are means over `mean` snapshots up to that one.
pub fn write(
    dir: &Path,
    step: Option<u64>,
    mean: u32,
    slope_reach: Option<f64>,
) -> Result<(PathBuf, Vec<String>), Faults> {
    let outbox = dir.join("OUTBOX");
    let all = list_snapshots(&outbox)?;
    let (last, _) = all[all.len() - 1];
    let wanted = step.unwrap_or(last);
    let place = all.iter().position(|(step, _)| *step == wanted).ok_or_else(|| {
        let found = format!("holds no snapshot of step {wanted}");
        let before = all.iter().rev().find(|(step, _)| *step < wanted);
        let after = all.iter().find(|(step, _)| *step > wanted);
        let nearest: Vec<String> = before.into_iter().chain(after).map(|(step, _)| step.to_string()).collect();
        let expected = format!("expected one of steps {} to {last}, such as {}", all[0].0, nearest.join(" or "));
        Fault::new(&outbox, None, "folder", found, expected)
    })?;
    let (step, path) = &all[place];
    let first = (place + 1).checked_sub(mean as usize).ok_or_else(|| {
        let found = format!("a mean over {mean} snapshots, of which {} are not later than step {step}", place + 1);
        Fault::new(&outbox, None, "--mean", found, format!("expected at most {}", place + 1))
    })?;
    let shapes = ShapeCache::default();
    let frame = Frame::read(path, &shapes)?;
    let folder = dir.join("POSTPRO").join(format!("state-{step:06}"));
    if frame.grains.is_empty() {
        remove_stale_files(&folder, &[])?;
        return Ok((folder, vec![format!("the snapshot of step {step} holds no grain: nothing is written")]));
    }
    let mut files = state_files(&frame, &added_bodies(dir)?, slope_reach);
    let mut notes = Vec::new();
    if mean > 1 {
        let mut frames = Vec::new();
        for (_, path) in &all[first..place] {
            frames.push(Frame::read(path, &shapes)?);
        }
        frames.push(frame.clone());
        files.retain(|(name, _)| !name.starts_with("layers"));
        let (layers, count) = mean_layers(&frames);
        files.extend(layers);
        if count == 0 {
            notes.push(format!("a bed is in none of {mean} snapshots: there are no layers"));
        } else if count < frames.len() {
            notes.push(format!("a bed is in {count} of {mean} snapshots: the mean layers are those of these"));
        }
    }
    for (name, bytes) in &files {
        atomic::write(&folder.join(name), bytes)?;
    }
    remove_stale_files(&folder, &files)?;
    if frame.cell().is_periodic() {
        notes.push("the scene repeats and has no centre: no profile by radius".into());
    }
    Ok((folder, notes))
}

/// Removes files of an earlier state from the folder that this state does not have, such as the layers of a bed.
fn remove_stale_files(folder: &Path, files: &[File]) -> Result<(), Faults> {
    for name in STATE_FILES.into_iter().filter(|name| files.iter().all(|(made, _)| made != name)) {
        let path = folder.join(name);
        if atomic::path_exists(&path) {
            fs::remove_file(&path).map_err(|error| Fault::from_io(&path, "removed", &error))?;
        }
    }
    Ok(())
}

/// Numbers of the bodies that `cd-pre from-outbox` added to those of another run, such as a lander: the bodies without a
/// case in DATBOX/ORIGIN.csv. Empty if there is no such file.
pub fn added_bodies(dir: &Path) -> Result<HashSet<u64>, Faults> {
    let path = dir.join("DATBOX/ORIGIN.csv");
    if !atomic::path_exists(&path) {
        return Ok(HashSet::new());
    }
    let text = atomic::read_text(&path)?;
    let (mut numbers, mut faults) = (HashSet::new(), Faults::default());
    for (number, line) in (1..).zip(text.lines()).skip(1) {
        // The name of a case may have commas.
        match line.split_once(',').map(|(body, origin)| (body.parse::<u64>(), origin)) {
            Some((Ok(body), ",,")) => drop(numbers.insert(body)),
            Some((Ok(_), _)) => {}
            _ => faults.push(Fault::new(&path, Some(number), "row", line, "expected body,case,step,number")),
        }
    }
    faults.into_result(numbers)
}

/// Files of a frame with grains; `newcomers`: bodies that never count as ejecta; `slope_reach`: mean radii over which
/// planes are fitted to a surface.
pub fn state_files(frame: &Frame, newcomers: &HashSet<u64>, slope_reach: Option<f64>) -> Vec<File> {
    let fragments = find_fragments(frame);
    let mut files = force_files(frame);
    files.push(("fabric.csv", fabric_table(frame).into_bytes()));
    files.extend(ejecta_files(frame, &fragments, newcomers));
    if let Some(bed) = Bed::from_frame(frame, &fragments) {
        files.extend(layer_files(&bed.layers(frame, SHELL_COUNT, bed.top_height(frame))));
    }
    if !frame.cell().is_periodic() {
        files.extend(profile_files(frame, &fragments[0]));
    }
    match FreeSurface::from_frame(frame, &fragments, slope_reach.unwrap_or(free_surface::REACH)) {
        // Under self-gravity verticals have no common direction.
        Some(surface) if self_gravity_constant(frame).is_none() => files.extend(free_surface_files(&surface)),
        _ if !frame.cell().is_periodic() => {
            files.extend(surface_files(frame, &fragments[0], slope_reach.unwrap_or(plane_fit::DEFAULT_FIT_REACH)));
        }
        _ => {}
    }
    files
}

fn text_file(name: &'static str, text: String) -> File {
    (name, text.into_bytes())
}

/// Figure of curves against a length.
fn curve_figure(length: &str, title: &str, quantity: &str, unit: &str, curves: Vec<Curve>) -> String {
    Figure { title: title.into(), x: FigureAxis::linear(length, "m"), y: FigureAxis::linear(quantity, unit), curves }
        .to_svg()
}

/// Radial profiles of the largest remnant.
fn profile_files(frame: &Frame, largest: &Fragment) -> Vec<File> {
    let shells = radial_shells(frame, &largest.grains, largest.whole.x, SHELL_COUNT);
    let rows =
        shells.iter().map(|s| [s.inner, s.outer, s.nu, s.grains as f64, s.z, s.pressure, s.radial, s.tangential]);
    let points = |of: &dyn Fn(usize) -> f64| -> Vec<(f64, f64)> {
        (0..shells.len()).map(|k| (0.5 * (shells[k].inner + shells[k].outer), of(k))).collect()
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
fn mean_layers(frames: &[Frame]) -> (Vec<File>, usize) {
    let of = |frame| Bed::from_frame(frame, &find_fragments(frame)).map(|bed| (bed, frame));
    let beds: Vec<(Bed, &Frame)> = frames.iter().filter_map(of).collect();
    let top = beds.iter().map(|(bed, frame)| bed.top_height(frame)).fold(0.0, f64::max);
    let of_frames: Vec<Vec<Layer>> = beds.iter().map(|(bed, frame)| bed.layers(frame, SHELL_COUNT, top)).collect();
    let layer = |k: usize| Layer::mean_over_times(of_frames.iter().map(|layers| &layers[k]));
    let mean: Vec<Layer> = (0..SHELL_COUNT).map(layer).collect();
    (if beds.is_empty() { Vec::new() } else { layer_files(&mean) }, beds.len())
}

/// Files of the layers of a bed.
fn layer_files(layers: &[Layer]) -> Vec<File> {
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
    let curve = |name: &str, of: fn(&Layer) -> f64| {
        Curve::line(name, layers.iter().map(|l| (0.5 * (l.lower + l.upper), of(l))).collect())
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

/// Distributions of the forces between grains, and of the mobilised friction.
fn force_files(frame: &Frame) -> Vec<File> {
    let between = || frame.active_contacts().filter(|c| c.grain_pair().is_some());
    let over_mean = |of: fn(&Contact) -> f64| probability_density(between().map(of), FORCE_BIN_WIDTH);
    let densities = [over_mean(|c| c.normal_force), over_mean(|c| c.tangential_force), over_mean(|c| -c.normal_force)];
    // A contact that only pulls at a distance carries no pressure.
    let touching = between().filter(|contact| touches_with_force(contact));
    let shares: Vec<f64> = touching.filter_map(|c| mobilised_share(c, &frame.laws)).collect();
    // Twenty bins from 0 to 1; what round-off puts beyond is all of it.
    let mut bins = [0.0; 20];
    shares.iter().for_each(|share| bins[((share * 20.0) as usize).min(19)] += 20.0 / shares.len() as f64);
    let mobilised: Vec<(f64, f64)> = (0..20).map(|k| ((k as f64 + 0.5) / 20.0, bins[k])).collect();
    let longest = densities.iter().map(Vec::len).max().unwrap_or(0);
    let rows = (0..longest).map(|k| {
        let [normal, tangential, tension] = [0, 1, 2].map(|of: usize| densities[of].get(k).map_or(0.0, |bin| bin.1));
        [(k as f64 + 0.5) * FORCE_BIN_WIDTH, normal, tangential, tension]
    });
    let carried = ["normal", "tangential", "tension"].into_iter().zip(&densities).filter(|(_, bins)| !bins.is_empty());
    let forces = Figure {
        title: "Forces between grains".into(),
        x: FigureAxis::linear("force / mean", "1"),
        y: FigureAxis::logarithmic("probability density", "1"),
        curves: carried.map(|(name, bins)| Curve::line(name, bins.clone())).collect(),
    };
    let friction = Figure {
        title: "Mobilised friction".into(),
        x: FigureAxis::linear("tangential force / largest possible", "1"),
        y: FigureAxis::linear("probability density", "1"),
        curves: vec![Curve::line("contacts", if shares.is_empty() { Vec::new() } else { mobilised.clone() })],
    };
    let of_friction = mobilised.iter().filter(|_| !shares.is_empty()).map(|(x, p)| [*x, *p]);
    vec![
        text_file("forces.csv", csv_table(&FORCE_COLUMNS, rows)),
        text_file("forces.svg", forces.to_svg()),
        text_file("mobilisation.csv", csv_table(&MOBILISATION_COLUMNS, of_friction)),
        text_file("mobilisation.svg", friction.to_svg()),
    ]
}

fn fabric_table(frame: &Frame) -> String {
    let f = fabric_tensor(frame);
    let [first, second, third] = eigenvalues(&f);
    let header = ["F_xx", "F_yy", "F_zz", "F_xy", "F_xz", "F_yz", "F_1", "F_2", "F_3", "anisotropy"];
    let row = [f[(0, 0)], f[(1, 1)], f[(2, 2)], f[(0, 1)], f[(0, 2)], f[(1, 2)], first, second, third, anisotropy(&f)];
    csv_text(&header, [row.to_vec()])
}

/// Files of the fragments with their orbits about the largest, and of the speeds of escaping grains.
fn ejecta_files(frame: &Frame, fragments: &[Fragment], newcomers: &HashSet<u64>) -> Vec<File> {
    let constant = self_gravity_constant(frame).unwrap_or(0.0);
    let cell = frame.cell();
    let periods = [cell.0[0], cell.0[1], None];
    let largest = &fragments[0].whole;
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
        let whole = &fragment.whole;
        let (v, w, [a, b, c]) = (whole.velocity(), whole.spin(), whole.semi_axes());
        let mut row = vec![k as f64, fragment.grains.len() as f64, whole.mass];
        row.extend(
            (0..3).map(|axis| if periods[axis].is_some() { f64::NAN } else { whole.x[axis] }).chain(v.iter().copied()),
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

    let native = |grain: &&Grain| !newcomers.contains(&grain.id);
    let mass: f64 = frame.grains.iter().filter(native).map(|grain| grain.mass).sum();
    let others = fragments.iter().skip(1).flat_map(|fragment| fragment.grains.iter().map(|&i| &frame.grains[i]));
    let axes = RotatingAxes::from_frame(frame);
    let speed = |grain: &Grain| (grain.v + axes.velocity(grain.x) - largest.velocity()).norm();
    let mut speeds: Vec<(f64, f64)> = others.filter(native).map(|grain| (speed(grain), grain.mass / mass)).collect();
    speeds.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut faster = 0.0;
    let mut cumulated: Vec<(f64, f64)> = Vec::new();
    // Grains of equal speed have one share: each is as fast as the others.
    for equal in speeds.chunk_by(|a, b| a.0 == b.0) {
        faster += equal.iter().map(|(_, share)| share).sum::<f64>();
        cumulated.extend(equal.iter().map(|(speed, _)| (*speed, faster)));
    }
    let [a, b, c] = largest.semi_axes();
    let escape = (2.0 * constant * largest.mass / (a * b * c).cbrt()).sqrt();
    let rows = cumulated
        .iter()
        .rev()
        .map(|&(speed, share)| [speed, if escape > 0.0 { speed / escape } else { f64::NAN }, share]);
    let figure = Figure {
        title: "Grains that have left the largest remnant".into(),
        x: FigureAxis::linear("speed relative to it", "m/s"),
        y: FigureAxis::linear("share of the mass that is as fast or faster", "1"),
        curves: vec![Curve { name: "grains".into(), points: cumulated.clone(), marks: CurveMarks::Dots }],
    };
    vec![
        text_file("fragments.csv", groups),
        text_file("ejecta.csv", csv_table(&EJECTA_COLUMNS, rows)),
        text_file("ejecta.svg", figure.to_svg()),
    ]
}

/// Height, gravity and slope of the largest remnant by direction.
fn surface_files(frame: &Frame, largest: &Fragment, slope_reach: f64) -> Vec<File> {
    let grid = DirectionGrid::STANDARD;
    let constant = self_gravity_constant(frame).unwrap_or(0.0);
    let facets = aggregate_surface(frame, &largest.grains, &largest.whole, constant, grid, slope_reach);
    let header =
        ["latitude", "longitude", "x", "y", "z", "height", "g_x", "g_y", "g_z", "slope", "area", "slope_error"];
    let row = |f: &SurfaceFacet| {
        let mut row = vec![f.latitude.to_degrees(), f.longitude.to_degrees()];
        row.extend(f.x.iter());
        row.push(f.height);
        row.extend(f.gravity.iter());
        row.extend([f.slope.to_degrees(), f.area, f.error.to_degrees()]);
        row
    };
    let heights: Vec<f64> = facets.iter().map(|f| f.height).collect();
    let slopes: Vec<f64> = facets.iter().map(|f| f.slope.to_degrees()).collect();
    let sheet = MapSheet::of_directions(grid);
    let x: Vec<Vec3> = facets.iter().map(|f| f.x).collect();
    let gravity: Vec<Vec3> = facets.iter().map(|f| f.gravity).collect();
    let counts = [grid.longitudes, grid.latitudes];
    let noise = noise_text(rms_noise(&facets));
    let mut files =
        slope_files(&format!("Slopes against gravity and rotation{noise}"), &slopes_below(&facets, &slope_shares()));
    files.extend([
        text_file("surface.csv", csv_text(&header, facets.iter().map(row))),
        // From east to west the sphere closes; at the poles it is left open.
        ("surface.vtp", surface_vtp(counts, [true, false], &x, &heights, &slopes, Some(&gravity))),
        text_file("surface_height.svg", map::svg("Height above the centre of mass", "height", "m", &heights, &sheet)),
        text_file(
            "surface_slope.svg",
            map::svg(&format!("Slope against gravity and rotation{noise}"), "slope", "°", &slopes, &sheet),
        ),
    ]);
    files
}

/// Height and slope of a heap or bed by verticals.
fn free_surface_files(surface: &FreeSurface) -> Vec<File> {
    let columns = &surface.columns;
    let heights: Vec<f64> = columns.iter().map(|c| c.height).collect();
    let slopes: Vec<f64> = columns.iter().map(|c| c.slope.to_degrees()).collect();
    let x: Vec<Vec3> = columns.iter().map(|c| c.x).collect();
    let known = columns.iter().filter(|c| c.height.is_finite());
    let sheet = MapSheet::from_above(surface);
    let noise = noise_text(surface.noise);
    let mut files = slope_files(&format!("Slopes against gravity{noise}"), &surface.slopes_below(&slope_shares()));
    files.extend([
        text_file(
            "surface.csv",
            csv_table(
                &SURFACE_COLUMNS,
                known.map(|c| [c.x.x, c.x.y, c.x.z, c.height, c.slope.to_degrees(), c.error.to_degrees()]),
            ),
        ),
        ("surface.vtp", surface_vtp(surface.counts, [false; 2], &x, &heights, &slopes, None)),
        text_file("surface_height.svg", map::svg("Height of the free surface", "height", "m", &heights, &sheet)),
        text_file(
            "surface_slope.svg",
            map::svg(&format!("Slope of the free surface{noise}"), "slope", "°", &slopes, &sheet),
        ),
    ]);
    files
}

/// Part of a title on the noise of slopes, rad.
fn noise_text(noise: f64) -> String {
    if noise.is_finite() { format!("; standard error {:.2}°", noise.to_degrees()) } else { String::new() }
}

/// Shares of a surface: every twentieth.
fn slope_shares() -> Vec<f64> {
    (1..=SLOPE_SHARE_COUNT).map(|k| k as f64 / SLOPE_SHARE_COUNT as f64).collect()
}

/// The slopes (rad) that [`slope_shares`] of a surface are below.
fn slope_files(title: &str, below: &[f64]) -> Vec<File> {
    let below: Vec<(f64, f64)> = slope_shares().into_iter().zip(below.iter().map(|slope| slope.to_degrees())).collect();
    let figure = Figure {
        title: title.into(),
        x: FigureAxis::linear("share of the surface that is below", "1"),
        y: FigureAxis::linear("slope", "°"),
        curves: vec![Curve::line("surface", below.clone())],
    };
    vec![
        text_file("slopes.csv", csv_table(&SLOPE_COLUMNS, below.into_iter().map(|(share, slope)| [share, slope]))),
        text_file("slopes.svg", figure.to_svg()),
    ]
}

/// Quadrilaterals between four neighbours of a grid of `columns` by `rows`, closed along the axes where `closes` is true.
/// Slopes in degrees.
fn surface_vtp(
    [columns, rows]: [usize; 2],
    closes: [bool; 2],
    x: &[Vec3],
    heights: &[f64],
    slopes: &[f64],
    gravity: Option<&[Vec3]>,
) -> Vec<u8> {
    let mut number = vec![None; x.len()];
    let mut kept: Vec<usize> = Vec::new();
    // Without gravity and spin nothing is level.
    let level = slopes.iter().any(|slope| slope.is_finite());
    for k in (0..x.len()).filter(|&k| heights[k].is_finite() && (slopes[k].is_finite() || !level)) {
        number[k] = Some(kept.len() as u64);
        kept.push(k);
    }
    let corner = |row: usize, column: usize| number[row % rows * columns + column % columns];
    let [wide, high] = [columns - usize::from(!closes[0]), rows - usize::from(!closes[1])];
    let quads = (0..high).flat_map(|row| (0..wide).map(move |column| (row, column)));
    let quads = quads.filter_map(|(row, column)| {
        Some([corner(row, column)?, corner(row, column + 1)?, corner(row + 1, column + 1)?, corner(row + 1, column)?])
    });
    let of = |values: &[f64]| kept.iter().map(|&k| values[k]).collect::<Vec<f64>>();
    let vectors_of = |values: &[Vec3]| kept.iter().map(|&k| values[k]).collect::<Vec<Vec3>>();
    let mut point = vec![scalar_attribute("height", of(heights))];
    if level {
        point.push(scalar_attribute("slope", of(slopes)));
    }
    point.extend(gravity.map(|gravity| vector_attribute("gravity", vectors_of(gravity).into_iter())));
    vtp_bytes(PolyDataPiece {
        points: flat_components(vectors_of(x).into_iter()).into(),
        polys: vertex_numbers(quads),
        data: Attributes { point, cell: vec![] },
        ..Default::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    #[test]
    fn without_gravity_there_are_heights_distances_and_speeds() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        let other = scene.grain([0.0, 0.0, 5.0], 0.5);
        scene.snapshot.bodies.body_v[other] = [0.0, 2.0, 0.0];
        let file = |scene: &Scene, name: &str| -> Option<String> {
            let found =
                state_files(&scene.frame(), &HashSet::new(), Some(3.0)).into_iter().find(|file| file.0 == name)?;
            Some(String::from_utf8(found.1).unwrap())
        };
        let surface = file(&scene, "surface.vtp").unwrap();
        assert!(surface.contains("height") && !surface.contains("slope") && !surface.contains("NumberOfPoints=\"0\""));
        let fields = |scene: &Scene| -> Vec<String> {
            let table = file(scene, "fragments.csv").unwrap();
            table.lines().nth(2).unwrap().split(',').map(str::to_string).collect()
        };
        // Distance and speed, the rest of the orbit has no meaning.
        assert_eq!(fields(&scene)[16..], ["5.0", "2.0", "", "", "", "", "", "", ""]);
        scene.snapshot.meta.parameters.xperiode = Some(8.0);
        assert_eq!(fields(&scene)[3..6], ["", "0.0", "5.0"]);
        assert_eq!(fields(&scene)[9..18], ["", "", "", "", "", "", "", "", "2.0"]);
        // There is no centre, from which a profile or a surface could be measured.
        assert!(["surface.csv", "slopes.csv", "profile.csv"].iter().all(|name| file(&scene, name).is_none()));
    }

    #[test]
    fn a_lander_is_no_ejecta() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("DATBOX/ORIGIN.csv");
        assert!(added_bodies(folder.path()).unwrap().is_empty());
        atomic::write(&path, b"body,case,step,number\n1,a, b,7,1\n2,a, b,7,3\n3,,,\n").unwrap();
        let lander = added_bodies(folder.path()).unwrap();
        assert_eq!(lander, HashSet::from([3]));
        let mut scene = Scene::default();
        for (k, radius) in [2.0, 1.0, 1.5].into_iter().enumerate() {
            scene.grain([10.0 * k as f64, 0.0, 0.0], radius);
        }
        let found = state_files(&scene.frame(), &lander, Some(3.0));
        let table = String::from_utf8(found.iter().find(|file| file.0 == "ejecta.csv").unwrap().1.clone()).unwrap();
        let share: f64 = table.lines().nth(1).unwrap().split(',').nth(2).unwrap().parse().unwrap();
        assert!(table.lines().count() == 2 && (share - 1.0 / 9.0).abs() < 1e-15, "{table}"); // of 8 + 1
        atomic::write(&path, b"body,case,step,number\nfirst,,,\n\n").unwrap();
        let faults = added_bodies(folder.path()).unwrap_err().to_string();
        assert!(faults.lines().count() == 2 && faults.contains("ORIGIN.csv:2: row: first,,,; expected"), "{faults}");
    }

    #[test]
    fn every_file_of_a_state_is_known_by_its_name() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        let made = state_files(&scene.frame(), &HashSet::new(), Some(3.0)).into_iter().chain(layer_files(&[]));
        let made: HashSet<&str> = made.map(|(name, _)| name).collect();
        assert_eq!(made, STATE_FILES.into_iter().collect());
    }

    #[test]
    fn equal_speeds_have_equal_shares() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 2.0);
        for (k, speed) in [1.0, 2.0, 1.0].into_iter().enumerate() {
            let grain = scene.grain([10.0 * (k + 1) as f64, 0.0, 0.0], 1.0);
            scene.snapshot.bodies.body_v[grain] = [speed, 0.0, 0.0];
        }
        let found = state_files(&scene.frame(), &HashSet::new(), Some(3.0));
        let table = String::from_utf8(found.iter().find(|file| file.0 == "ejecta.csv").unwrap().1.clone()).unwrap();
        let share = |line: &str| line.split(',').nth(2).unwrap().parse::<f64>().unwrap();
        let shares: Vec<f64> = table.lines().skip(1).map(share).collect();
        // The total mass is 8 + 3; rounding of a few sums.
        assert!(shares[0] == shares[1] && (shares[0] - 3.0 / 11.0).abs() < 1e-15, "{table}");
        assert!((shares[2] - 1.0 / 11.0).abs() < 1e-15, "{table}");
    }

    #[test]
    fn forces_that_pull_have_a_density_of_their_own() {
        let mut scene = Scene::default();
        for k in 0..5 {
            scene.grain([2.0 * k as f64, 0.0, 0.0], 1.0);
        }
        for (k, force) in [3.0, 5.0, -1.0, -3.0].into_iter().enumerate() {
            scene.push(k + 1, k, force);
        }
        let files = force_files(&scene.frame());
        let file = |name: &str| String::from_utf8(files.iter().find(|file| file.0 == name).unwrap().1.clone()).unwrap();
        let table = file("forces.csv");
        // Over their means, 4 and 2: pushes of 3/4 and 5/4, pulls of 1/2 and 3/2, in bins of 1/4.
        let filled = |column: usize| -> Vec<usize> {
            let rows = table.lines().skip(1).map(|line| line.split(',').nth(column).unwrap()).enumerate();
            rows.filter(|(_, p)| *p == "2.0").map(|(k, _)| k).collect()
        };
        assert_eq!((filled(1), filled(2), filled(3)), (vec![3, 5], vec![], vec![2, 6]), "{table}");
        assert!(file("forces.svg").contains("tension") && !file("forces.svg").contains("tangential"));
        // Nothing joins what empty bins part.
        let forces_svg = file("forces.svg");
        let lines: Vec<&str> = forces_svg.lines().filter(|line| line.contains("<polyline fill")).collect();
        let joins = |line: &&&str| line.contains("stroke-width=\"4\"") && line.matches(',').count() > 1;
        assert!(!lines.is_empty() && lines.iter().filter(joins).count() == 0, "{lines:?}");
        let nothing = force_files(&Scene::default().frame());
        assert_eq!(nothing[0].1, b"force_over_mean,P_normal,P_tangential,P_tension\n");
    }
}
