//! `cd-post track`: one body in a bed of grains, such as a lander: displacement, force, bounce and crater.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};
use cd_formats::field::FieldModel;
use cd_formats::geometry::periodic_cell::PeriodicCell;

use crate::axes::{AxesOrigin, OutputAxes};
use crate::derive::energy::{external_fields, self_gravity_constant};
use crate::derive::fragments::{Fragment, find_fragments};
use crate::derive::surface::ball_attraction;
use crate::derive::walls::supported_grains;
use crate::frame::{ContactBody, Frame, Grain, GrainId, Wall, WallShape};
use crate::math::Vec3;
use crate::shapes::ShapeCache;
use crate::snapshots::select_snapshots;
use crate::tables::is_at_or_after;
use crate::write::figure::{Curve, Figure, FigureAxis};
use crate::write::series::{Column, csv_table, csv_with_counts};

/// Columns of track.csv: name, unit, meaning.
pub const COLUMNS: [Column; 13] = [
    ("time", "s", ""),
    ("x", "m", "centre of mass"),
    ("y", "m", ""),
    ("z", "m", ""),
    ("v_x", "m/s", "velocity; empty where all of it is imposed"),
    ("v_y", "m/s", ""),
    ("v_z", "m/s", ""),
    ("depth", "m", "depth of its lowest point below the surface that was under it at the start"),
    ("f_x", "N", "sum of the contact forces on it, mean over the step"),
    ("f_y", "N", ""),
    ("f_z", "N", ""),
    ("force", "N", "force of the contacts against gravity"),
    ("contacts", "1", "contacts that carry force"),
];

/// Columns of crater.csv.
pub const CRATER_COLUMNS: [Column; 3] = [
    ("radius", "m", "distance from the axis"),
    ("before", "m", "height of the surface before"),
    ("after", "m", "height of the surface after"),
];

/// Columns of impact.csv.
pub const IMPACT_COLUMNS: [Column; 6] = [
    ("contact_time", "s", "of the first snapshot in which it is touched, or has been since the one before"),
    ("impact_speed", "m/s", "along gravity, in the snapshot before"),
    ("restitution", "1", "its largest speed against gravity afterwards, 0 at least, over that"),
    ("largest_depth", "m", ""),
    ("largest_force", "N", "of the snapshots, along the vertical"),
    ("final_depth", "m", ""),
];

/// Largest distance of unit vectors that count as one direction: rounding of a length.
const SAME_DIRECTION: f64 = 1e-9;
/// Rings of the crater's profile, and points in each.
const CRATER_RINGS: usize = 20;
const POINTS_PER_RING: usize = 48;

/// The body in one frame.
struct TrackedBody {
    time: f64,
    /// Origin of the axes in which position and velocity are written.
    origin: AxesOrigin,
    x: Vec3,
    /// Velocity; None if all of the motion is imposed.
    v: Option<Vec3>,
    /// Distance from the centre to the lowest point, m.
    reach: f64,
    force: Vec3,
    contacts: usize,
    /// Start of the time for which the snapshot records contacts, s; NaN without a record.
    record_start: f64,
    /// Whether a contact has pushed or pulled the body since then.
    touched_since: bool,
    /// Acceleration of the body without contacts, m/s^2; None in rotating axes, where it depends on more than the position.
    free_fall: Option<Vec3>,
}

/// Reads the snapshots of a case and writes `POSTPRO/track-N/`: track.csv, impact.csv, crater.csv and their figures. Returns
/// the folder and notes for the user.
///
/// `body`: the number of the body in BODIES.DAT, free or with imposed motion. Errors: no such body in all snapshots, no
/// snapshot, or those of [`Frame::read_for_axes`].
pub fn write(dir: &Path, body: u64, axes: OutputAxes) -> Result<(PathBuf, Vec<String>), Faults> {
    let mut states: Vec<TrackedBody> = Vec::new();
    let (mut first, mut last) = (None, None);
    let mut up = Vec3::z();
    // Step and direction of the first uniform gravity, which defines heights, and the first step with another direction.
    let (mut gravity, mut turning_step) = (None, None);
    let shapes = ShapeCache::default();
    let paths = select_snapshots(&dir.join("OUTBOX"), 1)?;
    let tracked_body = |frame: &Frame, up: &Vec3| -> Result<TrackedBody, Faults> {
        find_body(frame, body, up).ok_or_else(|| {
            if frame.absent.contains(&body) {
                let found = format!("{body} is not in the run at step {}", frame.meta.step);
                let expected = "expected a body that is in the run in all snapshots";
                return Fault::new(Path::new("options"), None, "--body", found, expected).into();
            }
            let count = frame.grains.len() + frame.walls.len() + frame.absent.len();
            let expected = format!("expected the number of a body in BODIES.DAT, 1 to {count}");
            Fault::new(Path::new("options"), None, "--body", format!("{body}"), expected).into()
        })
    };
    for (k, (step, path)) in paths.iter().enumerate() {
        let frame = Frame::read_for_axes(path, &shapes, axes)?;
        match (gravity, against_gravity(&frame)) {
            (None, Some(direction)) => {
                gravity = Some((*step, direction));
                up = direction;
                // The lowest points of earlier rows were computed for another direction.
                for (k, (_, path)) in paths[..k].iter().enumerate() {
                    states[k] = tracked_body(&Frame::read_for_axes(path, &shapes, axes)?, &up)?;
                }
            }
            (Some((_, direction)), Some(other)) if (other - direction).norm() > SAME_DIRECTION => {
                turning_step = turning_step.or(Some(*step));
            }
            _ => {}
        }
        if first.is_none() {
            // Gravity from all sides takes its direction at the start.
            up = gravity.map(|(_, direction)| direction).or(upward_direction(&frame, body)).unwrap_or(up);
            first = Some(frame.clone());
        }
        states.push(tracked_body(&frame, &up)?);
        last = Some(frame);
    }
    let (Some(first), Some(last)) = (first, last) else { unreachable!("select gives at least one") };
    let mut notes = Vec::new();
    if let (Some((step, _)), Some(turning_step)) = (gravity, turning_step) {
        notes.push(format!(
            "gravity changes direction at step {turning_step}: up is opposite to the gravity of step {step} throughout"
        ));
    }
    let level = ground_level(&first, body, &up, &states[0]);
    let rows: Vec<TrackRow> = states.iter().map(|s| TrackRow::new(s, &up, level)).collect();
    let folder = dir.join(format!("POSTPRO/track-{body}"));
    let write_file = |name: &str, text: String| atomic::write(&folder.join(name), text.as_bytes());
    // A plate may be at the side of a bed as well as on it.
    let is_tracked_plate = |wall: &Wall| wall.id == body && matches!(wall.shape, WallShape::Plate(_));
    if rows.iter().all(|row| row.depth.is_nan()) && !first.walls.iter().any(is_tracked_plate) {
        notes.push(format!("no surface is under body {body} in the first snapshot: its depth is empty"));
    }
    write_file(
        "track.csv",
        csv_with_counts(&COLUMNS.map(|column| column.0), &["contacts"], rows.iter().map(|row| row.to_columns())),
    )?;
    axes.record(&folder)?;
    write_file("impact.csv", csv_table(&IMPACT_COLUMNS, [impact_row(&states, &rows, &up)]))?;
    let crater = crater_profile(&first, &last, body, &up, &states[0].x, level);
    write_file("crater.csv", csv_table(&CRATER_COLUMNS, crater.clone()))?;
    let against_time = |title: &str, column: &str, unit: &str, value: fn(&TrackRow) -> f64| {
        let points = rows.iter().map(|row| (row.time, value(row))).collect();
        let (x, y) = (FigureAxis::linear("time", "s"), FigureAxis::linear(column, unit));
        Figure { title: title.into(), x, y, curves: vec![Curve::line(column, points)] }
    };
    write_file(
        "depth.svg",
        against_time(&format!("Depth of body {body} below the surface"), "depth", "m", |row| row.depth).to_svg(),
    )?;
    write_file(
        "force.svg",
        against_time(&format!("Force of the contacts on body {body}, upward"), "force", "N", |row| row.upward_force)
            .to_svg(),
    )?;
    let profile = |name: &str, k: usize| Curve::line(name, crater.iter().map(|row| (row[0], row[k])).collect());
    let figure = Figure {
        title: format!("Surface around the axis of body {body}"),
        x: FigureAxis::linear("distance", "m"),
        y: FigureAxis::linear("height", "m"),
        curves: vec![profile("before", 1), profile("after", 2)],
    };
    write_file("crater.svg", figure.to_svg())?;
    Ok((folder, notes))
}

/// Direction against uniform gravity, length 1; None without uniform gravity.
fn against_gravity(frame: &Frame) -> Option<Vec3> {
    (-Vec3::from(frame.meta.parameters.uniform_gravity)).try_normalize(0.0)
}

/// Direction against the acceleration of a grain, length 1.
fn upward_direction(frame: &Frame, body: u64) -> Option<Vec3> {
    let grain = frame.grain_ids().find(|&grain| frame.grains[grain].id == body)?;
    (-free_fall(frame, grain)?).try_normalize(0.0)
}

/// Acceleration of a grain without contacts, m/s^2; None in rotating axes.
fn free_fall(frame: &Frame, grain: GrainId) -> Option<Vec3> {
    let (x, fields) = (frame.grains[grain].x, external_fields(frame));
    let turns = fields.iter().any(|field| matches!(field, FieldModel::RotatingAxes { .. }));
    let others = frame.grain_ids().filter(|other| *other != grain);
    let pull = self_gravity_constant(frame).map_or(Vec3::zeros(), |constant| {
        others.map(|other| ball_attraction(&frame.grains[other], x)).sum::<Vec3>() * constant
    });
    let from_outside: Vec3 = fields.iter().map(|field| field.acceleration_and_potential(&x).0).sum();
    (!turns).then(|| Vec3::from(frame.meta.parameters.uniform_gravity) + pull + from_outside)
}

/// State of the body with this number in BODIES.DAT; None if there is none.
fn find_body(frame: &Frame, body: u64, up: &Vec3) -> Option<TrackedBody> {
    // Depth below the centre of the lowest point of these balls.
    let lowest_depth = |points: &mut dyn Iterator<Item = (Vec3, f64)>| {
        points.map(|(point, radius)| radius - point.dot(up)).fold(0.0, f64::max)
    };
    let (tracked, x, v, reach) = if let Some(k) = frame.grain_ids().find(|&k| frame.grains[k].id == body) {
        let grain = &frame.grains[k];
        let points = grain.vertices().map(|corner| (corner, 0.0)).chain(grain.balls());
        let reach = lowest_depth(&mut points.map(|(point, radius)| (point - grain.x, radius)));
        // In a periodic scene the path continues across images.
        (ContactBody::Grain(k), grain.x - grain.cell_shift, Some(grain.v), reach)
    } else {
        let k = frame.wall_ids().find(|&k| frame.walls[k].id == body)?;
        let wall = &frame.walls[k];
        let reach = match &wall.shape {
            WallShape::Ball(radius) => *radius,
            WallShape::Polyhedron(solid) => {
                let points = solid.vertices.iter().map(|corner| (corner, 0.0));
                let balls = solid.balls.iter().map(|(centre, radius)| (centre, *radius));
                lowest_depth(&mut points.chain(balls).map(|(point, radius)| (wall.rotation * point, radius)))
            }
            WallShape::Plate(half) => (0..3).map(|k| half[k] * (wall.rotation.inverse() * up)[k].abs()).sum(),
        };
        (ContactBody::Wall(k), wall.x, wall.v, reach)
    };
    let (mut force, mut contacts) = (Vec3::zeros(), 0);
    for contact in frame.contacts.iter().filter(|contact| contact.active) {
        if contact.candidate == tracked {
            force += contact.force;
            contacts += 1;
        } else if contact.antagonist == tracked {
            force -= contact.force;
            contacts += 1;
        }
    }
    // Walls are excluded: a wall with a force does not fall freely.
    let free_fall = tracked.grain_id().and_then(|grain| free_fall(frame, grain));
    let record_start = frame.meta.time - frame.interval.length;
    let touched_since = frame.interval.touched_pairs.iter().any(|pair| pair.bodies.contains(&tracked));
    let (time, origin) = (frame.meta.time, frame.origin);
    Some(TrackedBody { time, origin, x, v, reach, force, contacts, record_start, touched_since, free_fall })
}

/// Row of track.csv.
#[derive(Debug, Clone, Copy)]
struct TrackRow {
    time: f64,
    x: Vec3,
    /// Velocity; NaN if all of the motion is imposed.
    v: Vec3,
    depth: f64,
    force: Vec3,
    upward_force: f64,
    contacts: usize,
}

impl TrackRow {
    /// Row of a body; `level`: height of the surface along `up`, m.
    fn new(tracked: &TrackedBody, up: &Vec3, level: f64) -> TrackRow {
        let &TrackedBody { time, origin, x, force, contacts, .. } = tracked;
        TrackRow {
            time,
            x: origin.written_position(x),
            v: tracked.v.map_or(Vec3::repeat(f64::NAN), |v| origin.written_velocity(v)),
            depth: level - (x.dot(up) - tracked.reach),
            force,
            upward_force: force.dot(up),
            contacts,
        }
    }

    /// Values in the order of [`COLUMNS`].
    fn to_columns(self) -> [f64; COLUMNS.len()] {
        let TrackRow { time, x, v, depth, force, upward_force, contacts } = self;
        let contacts = contacts as f64;
        [time, x.x, x.y, x.z, v.x, v.y, v.z, depth, force.x, force.y, force.z, upward_force, contacts]
    }
}

/// Change of velocity in excess of free fall, divided by the larger speed, that indicates a shock between two
/// snapshots.
const SHOCK_THRESHOLD: f64 = 0.01;

/// Row of impact.csv; empty if nothing touched the body. Contacts between two snapshots are recorded by the second. If it
/// has no record, or not of the whole interval, a change of velocity in excess of free fall indicates contact. If the
/// acceleration of free fall is unknown, only contacts count. Between two snapshots this acceleration is the mean of both,
/// with half of their difference as tolerance.
fn impact_row(states: &[TrackedBody], rows: &[TrackRow], up: &Vec3) -> [f64; 6] {
    let speed = |s: &TrackedBody| s.v.map_or(f64::NAN, |v| v.dot(up));
    let largest_depth = rows.iter().map(|row| row.depth).fold(f64::NAN, f64::max);
    let largest_force = rows.iter().map(|row| row.upward_force).fold(f64::NAN, f64::max);
    let final_depth = rows.last().map_or(f64::NAN, |row| row.depth);
    let is_shock_between = |before: &TrackedBody, now: &TrackedBody| {
        let [v, w, a, b] = [before.v?, now.v?, before.free_fall?, now.free_fall?];
        let half_time = 0.5 * (now.time - before.time);
        Some(
            (w - v - (a + b) * half_time).norm()
                > SHOCK_THRESHOLD * v.norm().max(w.norm()) + (b - a).norm() * half_time,
        )
    };
    let is_struck = |k: usize| {
        if k == 0 {
            return false;
        }
        let (before, now) = (&states[k - 1], &states[k]);
        match is_at_or_after(before.time, now.record_start) {
            true => now.touched_since,
            false => is_shock_between(before, now) == Some(true),
        }
    };
    let Some(touched) = (0..states.len()).find(|&k| states[k].contacts > 0 || is_struck(k)) else {
        return [f64::NAN, f64::NAN, f64::NAN, largest_depth, largest_force, final_depth];
    };
    let arrival = -speed(&states[touched.saturating_sub(1)]);
    let departure = states[touched..].iter().map(speed).fold(f64::NAN, f64::max).max(0.0);
    let restitution = if arrival > 0.0 && states[touched].v.is_some() { departure / arrival } else { f64::NAN };
    [states[touched].time, arrival, restitution, largest_depth, largest_force, final_depth]
}

/// Mean height of the bed's surface under the body: on its vertical and on circles of a quarter to three quarters of the
/// body's `reach`.
fn ground_level(frame: &Frame, body: u64, up: &Vec3, tracked: &TrackedBody) -> f64 {
    let points = std::iter::once(tracked.x)
        .chain([0.25, 0.5, 0.75].into_iter().flat_map(|k| circle_points(&tracked.x, up, k * tracked.reach)));
    let (ground, cell) = (ground_grains(frame, body), frame.cell());
    let heights: Vec<f64> = points.filter_map(|point| ground_height(&ground, &cell, up, &point)).collect();
    heights.iter().sum::<f64>() / heights.len() as f64
}

/// Points on a circle about a vertical.
fn circle_points(centre: &Vec3, up: &Vec3, radius: f64) -> Vec<Vec3> {
    let across = up.cross(&if up.x.abs() < 0.9 { Vec3::x() } else { Vec3::y() }).normalize();
    let along = up.cross(&across);
    let angles = (0..POINTS_PER_RING).map(|k| TAU * k as f64 / POINTS_PER_RING as f64);
    angles.map(|angle| centre + (across * angle.cos() + along * angle.sin()) * radius).collect()
}

/// Grains that form the surface, without the body: the fragments that a wall touches with force, and the
/// largest remnant. All grains if none touch, or if no wall bears any and the largest remnant has less than half of the mass,
/// as during free fall.
fn ground_grains(frame: &Frame, body: u64) -> Vec<&Grain> {
    let fragments = find_fragments(frame);
    let members_without_body = |fragment: &Fragment| -> Vec<GrainId> {
        fragment.grains.iter().copied().filter(|&i| frame.grains[i].id != body).collect()
    };
    let mass = |grains: &[GrainId]| grains.iter().map(|&i| frame.grains[i].mass).sum::<f64>();
    let others = fragments.iter().map(members_without_body).filter(|grains| grains.len() > 1);
    let heaviest = others.max_by(|a, b| mass(a).total_cmp(&mass(b))).unwrap_or_default();
    let mut is_supported = vec![false; frame.grains.len()];
    let supported = supported_grains(frame, &fragments);
    let all_others: Vec<GrainId> = frame.grain_ids().filter(|&i| frame.grains[i].id != body).collect();
    let is_falling = supported.is_empty() && 2.0 * mass(&heaviest) < mass(&all_others);
    supported.into_iter().chain(heaviest).for_each(|i| is_supported[i.index()] = true);
    let other_grains = || frame.grains.iter().zip(&is_supported).filter(|(grain, _)| grain.id != body);
    let counts_all = is_falling || !other_grains().any(|(_, is_supported)| *is_supported);
    other_grains().filter(|(_, is_supported)| **is_supported || counts_all).map(|(grain, _)| grain).collect()
}

/// Height along `up` of the ground on the vertical through `point`: of the highest sphere there; a polyhedron counts as the
/// sphere of equal volume, and in a periodic scene the nearest image counts. None without grains there.
fn ground_height(ground: &[&Grain], cell: &PeriodicCell, up: &Vec3, point: &Vec3) -> Option<f64> {
    let top = ground.iter().filter_map(|grain| {
        let x = grain.x - cell.nearest_shift(&(grain.x - point));
        let arm = x - point;
        let distance_squared = (arm - up * arm.dot(up)).norm_squared();
        (distance_squared < grain.radius.powi(2)).then(|| x.dot(up) + (grain.radius.powi(2) - distance_squared).sqrt())
    });
    top.fold(None, |best, height| Some(best.map_or(height, |best: f64| best.max(height))))
}

/// Rings about the vertical through `axis`: radius, mean height above `level` before and after.
fn crater_profile(first: &Frame, last: &Frame, body: u64, up: &Vec3, axis: &Vec3, level: f64) -> Vec<[f64; 3]> {
    let cell = first.cell();
    let axis_distance = |x: &Vec3| {
        let arm = x - axis - cell.nearest_shift(&(x - axis));
        (arm - up * arm.dot(up)).norm()
    };
    let farthest =
        first.grains.iter().filter(|grain| grain.id != body).map(|grain| axis_distance(&grain.x)).fold(0.0, f64::max);
    // The farthest grain of a box is in a corner: 1 / sqrt(2) of its distance is to the middle of a side. Beyond half a
    // period a ring would meet itself.
    let widest = cell.periods.iter().flatten().map(|period| 0.5 * period).fold(farthest * FRAC_1_SQRT_2, f64::min);
    let mean = |ground: &[&Grain], radius: f64| {
        let heights: Vec<f64> = circle_points(axis, up, radius)
            .iter()
            .filter_map(|point| ground_height(ground, &cell, up, point))
            .collect();
        // Beyond a wall or where the floor is bare there is no surface.
        if heights.len() < POINTS_PER_RING / 2 {
            f64::NAN
        } else {
            heights.iter().sum::<f64>() / heights.len() as f64 - level
        }
    };
    let [before, after] = [first, last].map(|frame| ground_grains(frame, body));
    // Without a bed outside the axis all rings would be one point.
    (0..if widest > 0.0 { CRATER_RINGS } else { 0 })
        .map(|k| widest * (k as f64 + 0.5) / CRATER_RINGS as f64)
        .map(|radius| [radius, mean(&before, radius), mean(&after, radius)])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    /// A bed of four touching spheres of radius 1 with the top at height 1, and a sphere of radius 0.5 over it.
    fn frame(height: f64, speed: f64, touched: bool) -> Frame {
        let mut scene = Scene::default();
        scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -1.0];
        scene.snapshot.meta.time = 10.0 - height;
        for (x, y) in [(0.0, 0.0), (2.0, 0.0), (-2.0, 0.0), (0.0, 2.0)] {
            scene.grain([x, y, 0.0], 1.0);
        }
        let lander = scene.grain([0.0, 0.0, height], 0.5);
        scene.snapshot.bodies.body_v[lander] = [0.0, 0.0, speed];
        (1..4).for_each(|k| scene.push(0, k, 1.0));
        if touched {
            scene.push(lander, 0, 3.0);
        }
        scene.frame()
    }

    fn height_of(frame: &Frame, body: u64, place: &Vec3) -> Option<f64> {
        ground_height(&ground_grains(frame, body), &frame.cell(), &Vec3::z(), place)
    }

    #[test]
    fn depth_force_and_bounce_of_a_lander() {
        let frames = [frame(3.0, -2.0, false), frame(1.4, -1.0, true), frame(2.0, 0.5, false)];
        let up = against_gravity(&frames[0]).unwrap();
        assert_eq!(up, Vec3::z());
        let level = height_of(&frames[0], 5, &Vec3::new(0.0, 0.0, 3.0)).unwrap();
        assert_eq!(level, 1.0);
        let seen: Vec<TrackedBody> = frames.iter().map(|frame| find_body(frame, 5, &up).unwrap()).collect();
        let rows: Vec<TrackRow> = seen.iter().map(|s| TrackRow::new(s, &up, level)).collect();
        let near = |found: &[f64], expected: &[f64]| {
            // Round-off of sums of a few numbers of order 1.
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14), "{found:?} {expected:?}");
        };
        near(&rows.iter().map(|row| row.depth).collect::<Vec<_>>(), &[-1.5, 0.1, -0.5]);
        near(&rows.iter().map(|row| row.upward_force).collect::<Vec<_>>(), &[0.0, 3.0, 0.0]);
        near(&impact_row(&seen, &rows, &up), &[8.6, 2.0, 0.25, 0.1, 3.0, -0.5]);
        assert!(find_body(&frames[0], 99, &up).is_none());
    }

    #[test]
    fn depth_and_crater_do_not_depend_on_where_the_border_is() {
        let up = Vec3::z();
        // A bed of 8 by 8 of uneven height, seen from the middle of the cell and from its border.
        let measured = |shift: f64| {
            let mut scene = Scene::default();
            (scene.snapshot.meta.parameters.xperiode, scene.snapshot.meta.parameters.yperiode) = (Some(8.0), Some(8.0));
            for (i, j) in (0..8).flat_map(|i| (0..8).map(move |j| (f64::from(i), f64::from(j)))) {
                scene.grain([i + shift, j + shift, 0.25 * (i - j).sin()], 0.75);
            }
            let lander = scene.grain([4.0 + shift, 4.0 + shift, 3.0], 0.5);
            let frame = scene.frame();
            let seen = find_body(&frame, lander as u64 + 1, &up).unwrap();
            assert_eq!(seen.x, Vec3::new(4.0 + shift, 4.0 + shift, 3.0), "the trajectory continues");
            let level = ground_level(&frame, lander as u64 + 1, &up, &seen);
            (level, crater_profile(&frame, &frame, lander as u64 + 1, &up, &seen.x, level))
        };
        let (level, crater) = measured(-4.0);
        assert!(level > 0.5 && crater.iter().all(|ring| ring[0] < 4.0 && ring[1].is_finite()), "{crater:?}");
        let (shifted, around) = measured(4.0);
        assert!((shifted - level).abs() < 1e-13); // rounding of sums
        for (ring, other) in crater.iter().flatten().zip(around.iter().flatten()) {
            assert!((ring - other).abs() < 1e-13, "{crater:?} {around:?}");
        }
    }

    #[test]
    fn only_what_is_more_than_rounding_is_a_shock() {
        let up = Vec3::z();
        let touched = |fall: Option<[f64; 3]>, speeds: [f64; 3]| {
            let frames: Vec<Frame> = speeds.iter().zip([3.0, 2.0, 1.0]).map(|(v, z)| frame(z, *v, false)).collect();
            let mut seen: Vec<TrackedBody> = frames.iter().map(|frame| find_body(frame, 5, &up).unwrap()).collect();
            assert!(seen.iter().all(|seen| seen.free_fall == Some(-up)));
            for (k, seen) in seen.iter_mut().enumerate() {
                seen.free_fall = fall.map(|fall| up * fall[k]);
            }
            let rows: Vec<TrackRow> = seen.iter().map(|s| TrackRow::new(s, &up, 1.0)).collect();
            impact_row(&seen, &rows, &up)[0]
        };
        let same = Some([-0.1; 3]);
        // From rest, a second apart.
        assert!(touched(same, [0.0, -0.1 * (1.0 + 1e-15), -0.2]).is_nan());
        assert_eq!(touched(same, [0.0, -0.1, 0.0]), 9.0);
        // If gravity changes along the path, the result is no more accurate than that.
        let grows = Some([-0.1, -0.2, -0.4]);
        assert!(touched(grows, [0.0, -0.17, -0.4]).is_nan());
        assert_eq!(touched(grows, [0.0, -0.17, 0.0]), 9.0);
        // If free fall is unknown, only contacts count.
        assert!(touched(None, [0.0, -0.1, 0.0]).is_nan());
    }

    #[test]
    fn what_contacts_do_not_do_is_no_impact() {
        let up = Vec3::z();
        // Slower at once: by an event, or by a contact between the snapshots.
        let touched = |since: Option<f64>, exchanged: bool| {
            let frames = [(3.0, -2.0), (2.0, -0.5)].map(|(z, v)| frame(z, v, false));
            let mut seen: Vec<TrackedBody> = frames.iter().map(|frame| find_body(frame, 5, &up).unwrap()).collect();
            assert!(seen[1].record_start.is_nan() && !seen[1].touched_since);
            (seen[1].record_start, seen[1].touched_since) = (since.unwrap_or(f64::NAN), exchanged);
            let rows: Vec<TrackRow> = seen.iter().map(|s| TrackRow::new(s, &up, 1.0)).collect();
            impact_row(&seen, &rows, &up)[0]
        };
        assert!(touched(Some(7.0), false).is_nan());
        assert_eq!(touched(Some(7.0), true), 8.0);
        // If the snapshot does not record the whole interval, the velocity decides.
        assert_eq!((touched(Some(7.5), false), touched(None, false)), (8.0, 8.0));
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        scene.grain([0.0, 0.0, 2.0], 1.0);
        scene.snapshot.meta.time = 1.0;
        scene.since(0.25, &[([1, 0], 0.1)]);
        let seen = find_body(&scene.frame(), 1, &up).unwrap();
        assert_eq!((seen.record_start, seen.touched_since), (0.25, true));
    }

    #[test]
    fn up_is_away_from_what_attracts() {
        let mut scene = Scene::self_gravitating(2.0);
        scene.grain([1.0, 0.0, 0.0], 1.0);
        let lander = scene.grain([1.0, 5.0, 0.0], 0.5);
        let frame = scene.frame();
        assert_eq!(upward_direction(&frame, lander as u64 + 1), Some(Vec3::y()));
        let expected = -2.0 * frame.grains[0].mass / 25.0;
        assert!((free_fall(&frame, GrainId::new(lander)).unwrap() - Vec3::y() * expected).norm() < 1e-15);
    }

    #[test]
    fn a_bed_of_nothing_or_of_one_column_has_no_rings() {
        let mut scene = Scene::default();
        scene.grain([0.0, 0.0, 9.0], 0.5);
        let rings =
            |scene: &Scene| crater_profile(&scene.frame(), &scene.frame(), 1, &Vec3::z(), &Vec3::zeros(), 0.0).len();
        assert_eq!(rings(&scene), 0);
        scene.grain([0.0; 3], 1.0);
        assert_eq!(rings(&scene), 0);
        scene.grain([2.0, 0.0, 0.0], 1.0);
        assert_eq!(rings(&scene), CRATER_RINGS);
    }

    #[test]
    fn where_no_grain_carries_force_all_are_the_surface() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        let lander = scene.grain([0.0, 0.0, 3.0], 1.0) as u64 + 1;
        assert_eq!(height_of(&scene.frame(), lander, &Vec3::zeros()), Some(1.0));
    }

    #[test]
    fn of_grains_that_fall_all_are_the_surface() {
        // Two that touch, four apart; no wall bears any.
        let mut scene = Scene::default();
        let first = scene.grain([0.0; 3], 1.0);
        let second = scene.grain([2.0, 0.0, 0.0], 1.0);
        for k in 2..6 {
            scene.grain([5.0 * f64::from(k), 0.0, 0.0], 1.0);
        }
        scene.push(first, second, 1.0);
        let height = |scene: &Scene| height_of(&scene.frame(), 99, &Vec3::new(10.0, 0.0, 0.0));
        assert_eq!(height(&scene), Some(1.0));
        // A heaviest with half of the mass, and a wall that bears it, are the bed.
        scene.snapshot.bodies.body_mass[..2].iter_mut().for_each(|mass| *mass *= 2.0);
        assert_eq!(height(&scene), None);
        scene.snapshot.bodies.body_mass[..2].iter_mut().for_each(|mass| *mass /= 4.0);
        let floor = scene.plate([0.0, 0.0, -1.1], [9.0, 9.0, 0.1]);
        assert_eq!(height(&scene), Some(1.0));
        scene.contact_at(first, floor, [0.0, 0.0, -1.0], Vec3::z());
        assert_eq!(height(&scene), None);
    }

    #[test]
    fn the_surface_is_that_of_grains_that_are_held() {
        let frame = frame(3.0, 0.0, false);
        let height = |x, y| height_of(&frame, 0, &Vec3::new(x, y, 0.0)); // the lander touches nothing
        assert_eq!(height(2.0, 0.0), Some(1.0));
        assert!((height(0.6, 0.0).unwrap() - 0.8).abs() < 1e-15);
        assert_eq!(height(5.0, 0.0), None);
    }
}
