//! `cd-post impact`: a projectile that hits a target: momentum enhancement, ejecta and crater.

use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};

use crate::derive::crater::CraterShape;
use crate::derive::impact::{EjectaGrain, ImpactError, ImpactOptions, ImpactRun, ImpactState};
use crate::frame::Frame;
use crate::shapes::ShapeCache;
use crate::snapshots::{progress_bar, select_snapshots};
use crate::write::figure::{Curve, CurveMarks, Figure, FigureAxis};
use crate::write::series::{Column, csv_table, csv_with_counts};

/// Columns of beta.csv: name, unit, meaning.
pub const BETA_COLUMNS: [Column; 18] = [
    ("time", "s", ""),
    ("beta", "1", "momentum enhancement along the stated direction"),
    ("beta_normal", "1", "momentum enhancement along the normal of the surface"),
    ("beta_ejecta", "1", "momentum enhancement along the momentum that is carried away"),
    ("beta_x", "1", "momentum that the target has gained over that of the projectile"),
    ("beta_y", "1", ""),
    ("beta_z", "1", ""),
    ("gained_x", "kg m/s", "momentum that the target has gained"),
    ("gained_y", "kg m/s", ""),
    ("gained_z", "kg m/s", ""),
    ("carried_x", "kg m/s", "momentum that ejecta and projectile carry away"),
    ("carried_y", "kg m/s", ""),
    ("carried_z", "kg m/s", ""),
    ("target_mass", "kg", "mass of the target"),
    ("ejecta", "1", "grains that have left the target"),
    ("ejecta_mass", "kg", "mass of the ejecta"),
    ("escaping", "1", "ejecta above the escape speed"),
    ("escaping_mass", "kg", "mass of the ejecta above the escape speed"),
];

/// Columns of ejecta-grains.csv.
pub const GRAIN_COLUMNS: [Column; 7] = [
    ("body", "1", "number in BODIES.DAT"),
    ("mass", "kg", ""),
    ("speed", "m/s", "speed at the old surface, relative to the target"),
    ("angle", "°", "elevation above the old surface"),
    ("v_x", "m/s", "velocity with this speed"),
    ("v_y", "m/s", ""),
    ("v_z", "m/s", ""),
];

/// Columns of ejecta-speeds.csv.
pub const SPEED_COLUMNS: [Column; 5] = [
    ("speed", "m/s", "speed at the old surface"),
    ("speed_over_impact", "1", "speed over that of the projectile"),
    ("grains_faster", "1", "ejecta that are as fast or faster"),
    ("mass_faster", "kg", "mass of the ejecta that are as fast or faster"),
    ("mass_over_projectile", "1", "this mass over that of the projectile"),
];

/// Columns of ejecta-angles.csv.
pub const ANGLE_COLUMNS: [Column; 5] = [
    ("lower", "°", "lower end of the elevations above the old surface"),
    ("upper", "°", "upper end"),
    ("grains", "1", "ejecta with such an elevation"),
    ("mass", "kg", "mass of these ejecta"),
    ("mean_speed", "m/s", "mean speed of these ejecta, weighted by mass"),
];

/// Columns of crater-size.csv.
pub const SIZE_COLUMNS: [Column; 6] = [
    ("time", "s", ""),
    ("diameter", "m", "diameter of the crater at the level of the old surface"),
    ("depth", "m", "depth of the crater below the old surface"),
    ("volume", "m^3", "volume of the crater below the old surface"),
    ("rim_diameter", "m", "diameter of the crater from rim to rim"),
    ("rim_height", "m", "height of the rim above the old surface"),
];

/// Columns of crater-profile.csv.
pub const PROFILE_COLUMNS: [Column; 3] = [
    ("radius", "m", "distance from the axis"),
    ("before", "m", "height of the surface before"),
    ("after", "m", "height of the surface after"),
];

/// Width of the bins of elevations, degrees.
const ANGLE_BIN: f64 = 10.0;

/// Reads the snapshots of a case and writes `POSTPRO/impact/`. Returns the folder and notes for the user. Errors: no snapshot,
/// faults of one, or an impact that the options and the first one do not define, see [`ImpactError`].
pub fn write(dir: &Path, options: &ImpactOptions) -> Result<(PathBuf, Vec<String>), Faults> {
    let shapes = ShapeCache::default();
    let paths = select_snapshots(&dir.join("OUTBOX"), 1)?;
    let bar = progress_bar(paths.len());
    let (mut run, mut states): (Option<ImpactRun>, Vec<ImpactState>) = (None, Vec::new());
    let mut forced_step = None;
    for (step, path) in &paths {
        let frame = Frame::read(path, &shapes)?;
        let run = match &mut run {
            Some(run) => run,
            None => run.insert(ImpactRun::new(&frame, options).map_err(|error| impact_fault(error, options))?),
        };
        states.push(run.next_state(&frame));
        forced_step = forced_step.or(run.has_outside_forces(&frame).then_some(*step));
        bar.inc(1);
    }
    bar.finish_and_clear();
    let (Some(run), Some(last)) = (run, states.last()) else { unreachable!("select gives at least one") };
    let mut notes = Vec::new();
    if let Some(step) = forced_step {
        notes.push(format!(
            "walls or fields act on the target from step {step} on: the momentum that it gains contains theirs"
        ));
    }
    if run.axis.is_none() {
        notes.push(
            "the trajectory of the projectile misses the target: there is no normal and no crater; give --point".into(),
        );
    } else if last.crater.is_none() {
        notes.push("no surface is around the point of the impact: there is no crater".into());
    }
    let folder = dir.join("POSTPRO/impact");
    for (name, text) in impact_files(&run, &states, last) {
        atomic::write(&folder.join(name), text.as_bytes())?;
    }
    Ok((folder, notes))
}

/// Fault of an option, with the bodies that it lists.
fn impact_fault(error: ImpactError, options: &ImpactOptions) -> Faults {
    let bodies = match error {
        ImpactError::NoProjectile | ImpactError::NoApproach => format!("{} ", options.projectile),
        ImpactError::NoTarget => options.target.as_ref().map_or(String::new(), |target| format!("{target} ")),
        _ => String::new(),
    };
    let found = format!("{bodies}{}", error.found());
    Fault::new(Path::new("options"), None, error.option(), found, error.expectation()).into()
}

/// Names and texts of the tables and figures.
fn impact_files(run: &ImpactRun, states: &[ImpactState], last: &ImpactState) -> Vec<(&'static str, String)> {
    let escapes = |grain: &&EjectaGrain| grain.speed() >= run.escape_speed;
    let beta_row = |state: &ImpactState| {
        let enhancement = run.enhancement(state);
        let mut row = vec![state.time, enhancement.along_direction, enhancement.along_normal, enhancement.along_ejecta];
        row.extend(enhancement.vector.iter().chain(&state.momentum_gained).chain(&state.momentum_carried));
        row.push(state.target_mass);
        let [ejecta, escaping] = [ejecta_sums(state.ejecta.iter()), ejecta_sums(state.ejecta.iter().filter(escapes))];
        let escaping = if run.escape_speed.is_nan() { [f64::NAN; 2] } else { escaping };
        row.extend(ejecta.into_iter().chain(escaping));
        row
    };
    let beta_rows: Vec<Vec<f64>> = states.iter().map(beta_row).collect();
    let sizes: Vec<[f64; 6]> = states.iter().filter_map(size_row).collect();
    let speeds = speed_rows(run, last);
    let angles = angle_rows(last);
    let rings = last.crater.as_ref().map_or(&[][..], |crater| &crater.rings);
    let profile: Vec<[f64; 3]> = rings.iter().map(|ring| [ring.radius, ring.old_height, ring.new_height]).collect();
    let grain_row = |grain: &EjectaGrain| {
        let v = grain.launch_velocity;
        [grain.body as f64, grain.mass, grain.speed(), grain.elevation.to_degrees(), v.x, v.y, v.z]
    };
    let against_time = |title: &str, quantity: &str, unit: &str, curves: Vec<Curve>| {
        let (x, y) = (FigureAxis::linear("time", "s"), FigureAxis::linear(quantity, unit));
        Figure { title: title.into(), x, y, curves }.to_svg()
    };
    let beta_curve = |name: &str, k: usize| Curve::line(name, beta_rows.iter().map(|row| (row[0], row[k])).collect());
    let size_curve = |name: &str, k: usize| Curve::line(name, sizes.iter().map(|row| (row[0], row[k])).collect());
    let profile_curve = |name: &str, k: usize| Curve::line(name, profile.iter().map(|row| (row[0], row[k])).collect());
    let speed_figure = Figure {
        title: "Speeds of the ejecta".into(),
        x: FigureAxis::logarithmic("speed at the old surface over that of the projectile", "1"),
        y: FigureAxis::logarithmic("mass as fast or faster over that of the projectile", "1"),
        curves: vec![Curve {
            name: "ejecta".into(),
            points: speeds.iter().map(|row| (row[1], row[4])).collect(),
            marks: CurveMarks::Dots,
        }],
    };
    let angle_figure = Figure {
        title: "Elevations of the ejecta".into(),
        x: FigureAxis::linear("elevation above the old surface", "°"),
        y: FigureAxis::linear("mass in ten degrees", "kg"),
        curves: vec![Curve::line("ejecta", angles.iter().map(|row| (0.5 * (row[0] + row[1]), row[3])).collect())],
    };
    let profile_figure = Figure {
        title: "Surface around the axis of the impact".into(),
        x: FigureAxis::linear("distance", "m"),
        y: FigureAxis::linear("height", "m"),
        curves: vec![profile_curve("before", 1), profile_curve("after", 2)],
    };
    let betas = vec![
        beta_curve("along the direction", 1),
        beta_curve("along the normal", 2),
        beta_curve("along the ejecta", 3),
    ];
    let masses = vec![beta_curve("all", 15), beta_curve("above escape", 17)];
    let lengths = vec![size_curve("diameter", 1), size_curve("depth", 2)];
    let header = BETA_COLUMNS.map(|(name, ..)| name);
    vec![
        ("beta.csv", csv_with_counts(&header, &["ejecta", "escaping"], beta_rows.iter())),
        (
            "ejecta-grains.csv",
            csv_with_counts(&GRAIN_COLUMNS.map(|(name, ..)| name), &["body"], last.ejecta.iter().map(grain_row)),
        ),
        (
            "ejecta-speeds.csv",
            csv_with_counts(&SPEED_COLUMNS.map(|(name, ..)| name), &["grains_faster"], speeds.iter()),
        ),
        ("ejecta-angles.csv", csv_with_counts(&ANGLE_COLUMNS.map(|(name, ..)| name), &["grains"], angles.iter())),
        ("crater-size.csv", csv_table(&SIZE_COLUMNS, sizes.iter().copied())),
        ("crater-profile.csv", csv_table(&PROFILE_COLUMNS, profile.iter().copied())),
        ("beta.svg", against_time("Momentum enhancement", "gained over incident momentum", "1", betas)),
        ("ejecta-mass.svg", against_time("Ejecta", "mass", "kg", masses)),
        ("crater-size.svg", against_time("Crater", "length", "m", lengths)),
        ("ejecta-speeds.svg", speed_figure.to_svg()),
        ("ejecta-angles.svg", angle_figure.to_svg()),
        ("crater-profile.svg", profile_figure.to_svg()),
    ]
}

/// Number and mass (kg) of some ejecta.
fn ejecta_sums<'a>(ejecta: impl Iterator<Item = &'a EjectaGrain>) -> [f64; 2] {
    ejecta.fold([0.0; 2], |[count, mass], grain| [count + 1.0, mass + grain.mass])
}

/// Row of crater-size.csv; None without a surface.
fn size_row(state: &ImpactState) -> Option<[f64; 6]> {
    let CraterShape { size, .. } = state.crater.as_ref()?;
    Some([state.time, size.diameter, size.depth, size.volume, size.rim_diameter, size.rim_height])
}

/// Rows of ejecta-speeds.csv, by rising speed. Grains of equal speed have one row: each is as fast as the others.
fn speed_rows(run: &ImpactRun, state: &ImpactState) -> Vec<[f64; 5]> {
    let impact_speed = run.incident.norm() / run.projectile_mass;
    let mut speeds: Vec<(f64, f64)> = state.ejecta.iter().map(|grain| (grain.speed(), grain.mass)).collect();
    speeds.retain(|(speed, _)| speed.is_finite());
    speeds.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (mut count, mut mass) = (0.0, 0.0);
    let mut rows = Vec::new();
    for equal in speeds.chunk_by(|a, b| a.0 == b.0) {
        count += equal.len() as f64;
        mass += equal.iter().map(|(_, mass)| mass).sum::<f64>();
        rows.push([equal[0].0, equal[0].0 / impact_speed, count, mass, mass / run.projectile_mass]);
    }
    rows.reverse();
    rows
}

/// Rows of ejecta-angles.csv: bins of ten degrees from -90 to 90.
fn angle_rows(state: &ImpactState) -> Vec<[f64; 5]> {
    let count = (180.0 / ANGLE_BIN) as usize;
    let mut bins = vec![[0.0; 3]; count];
    for grain in state.ejecta.iter().filter(|grain| grain.elevation.is_finite()) {
        let bin = (((grain.elevation.to_degrees() + 90.0) / ANGLE_BIN) as usize).min(count - 1);
        let [grains, mass, momentum] = bins[bin];
        bins[bin] = [grains + 1.0, mass + grain.mass, momentum + grain.mass * grain.speed()];
    }
    let row = |(k, [grains, mass, momentum]): (usize, [f64; 3])| {
        let lower = k as f64 * ANGLE_BIN - 90.0;
        [lower, lower + ANGLE_BIN, grains, mass, momentum / mass]
    };
    bins.into_iter().enumerate().map(row).collect()
}
