//! The grains of a run for the script of the page: JSON with arrays of 32-bit floats in base 64.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use crate::derive::coordination::contact_counts;
use crate::derive::enclosing::enclosing_ball;
use crate::derive::fragments::{find_fragments, fragment_numbers};
use crate::derive::motion::AggregateSums;
use crate::derive::stress::{grain_stresses, pressure};
use crate::frame::{Frame, Grain};
use crate::math::Vec3;
use crate::snapshots::is_evenly_chosen;
use crate::write::view::{DrawnWall, drawn_position};

/// Largest number of states on a page, and bytes of their numbers, so that a browser opens it at once.
const MAX_STATES: usize = 60;
const MAX_PAGE_BYTES: usize = 20_000_000;

/// Data of a snapshot on the page.
pub struct PageState {
    step: u64,
    /// Time, s.
    time: f64,
    /// Centre of the view, m: the centre of mass of all grains, or the origin if there are walls or borders, to show how
    /// the grains pass them.
    centre: Vec3,
    /// Numbers of the grains, ascending.
    ids: Vec<u64>,
    /// Positions of the grains, m.
    positions: Vec<Vec3>,
    /// Quaternions of the grains, scalar part last, if a grain is no sphere about its centre; empty otherwise.
    rotations: Vec<f32>,
    /// Values of the grains, in the order of [`VARYING_QUANTITIES`].
    values: [Vec<f64>; VARYING_QUANTITIES.len()],
    walls: Vec<WallPose>,
}

/// Number, position and rotation of a wall in a state.
struct WallPose {
    id: u64,
    position: Vec3,
    rotation: [f32; 4],
}

/// Quantities that change in time, with units.
const VARYING_QUANTITIES: [(&str, &str); 4] =
    [("contacts", "1"), ("pressure", "Pa"), ("speed", "m/s"), ("fragment", "1")];

impl PageState {
    /// Returns the state of snapshot `k` of `count` if it is one of those that fit on a page; the last one always is.
    pub fn from_frame(k: usize, count: usize, frame: &Frame) -> Option<PageState> {
        let grains = &frame.grains;
        let has_rotations = grains.iter().any(|grain| grain.solid.is_some());
        // A text in base 64 is a third longer.
        let floats = 3 + VARYING_QUANTITIES.len() + if has_rotations { 4 } else { 0 };
        let max_states = MAX_PAGE_BYTES / (grains.len() * floats * 16 / 3).max(1);
        if k + 1 < count && !is_evenly_chosen(k, count, max_states.min(MAX_STATES)) {
            return None;
        }
        let is_isolated = frame.walls.is_empty() && !frame.cell().is_periodic();
        Some(PageState {
            step: frame.meta.step,
            time: frame.meta.time,
            centre: if is_isolated && !grains.is_empty() {
                AggregateSums::from_grains(grains).x
            } else {
                Vec3::zeros()
            },
            ids: grains.iter().map(|grain| grain.id).collect(),
            positions: grains.iter().map(|grain| grain.x).collect(),
            rotations: grains.iter().filter(|_| has_rotations).flat_map(grain_rotation).collect(),
            values: [
                contact_counts(frame).iter().map(|n| f64::from(*n)).collect(),
                grain_stresses(frame).iter().map(pressure).collect(),
                grains.iter().map(|grain| grain.v.norm()).collect(),
                fragment_numbers(&find_fragments(frame), grains.len()).iter().map(|n| f64::from(*n)).collect(),
            ],
            walls: frame
                .walls
                .iter()
                .map(|wall| WallPose {
                    id: wall.id,
                    position: drawn_position(wall, &frame.cell()),
                    rotation: wall.rotation.coords.map(|component| component as f32).into(),
                })
                .collect(),
        })
    }
}

/// State with exactly these `grains`: grains that `state` does not have are at infinity.
fn state_of_grains(state: &PageState, grains: &[Grain]) -> PageState {
    let rows: Vec<Option<usize>> = grains.iter().map(|grain| state.ids.binary_search(&grain.id).ok()).collect();
    let value = |values: &Vec<f64>, row: &Option<usize>| {
        // A grain that is not seen has a value within the range of the others.
        row.or((!values.is_empty()).then_some(0)).map_or(0.0, |row| values[row])
    };
    let has_rotations = grains.iter().any(|grain| grain.solid.is_some());
    let rotation = |row: &Option<usize>| match row.map(|row| state.rotations.get(4 * row..4 * row + 4)) {
        Some(Some(turn)) => [turn[0], turn[1], turn[2], turn[3]],
        _ => [0.0, 0.0, 0.0, 1.0],
    };
    PageState {
        step: state.step,
        time: state.time,
        centre: state.centre,
        ids: grains.iter().map(|grain| grain.id).collect(),
        positions: rows.iter().map(|row| row.map_or(Vec3::repeat(f64::INFINITY), |row| state.positions[row])).collect(),
        rotations: rows.iter().filter(|_| has_rotations).flat_map(rotation).collect(),
        values: state.values.each_ref().map(|values| rows.iter().map(|row| value(values, row)).collect()),
        walls: Vec::new(),
    }
}

/// Distance of a grain that is not in a state, in distances of the farthest grain that is: outside of every view.
const HIDDEN_DISTANCE: f64 = 1e4;

fn grain_rotation(grain: &Grain) -> [f32; 4] {
    grain.rotation.coords.map(|component| component as f32).into()
}

/// Returns the balls and triangles in the frames of their grains; the states, in time, with positions and rotations; and
/// the quantities for colours.
///
/// `radius` frames the picture: the largest fragment of `last`, with its middle at the origin; `reach` covers all grains in
/// all states.
pub fn page_json(states: &[PageState], last: &Frame) -> String {
    let grains = &last.grains;
    let wall_poses: Vec<&[WallPose]> = states.iter().map(|state| &state.walls[..]).collect();
    let hidden: Vec<PageState>;
    let states = if states.iter().all(|state| state.ids.iter().copied().eq(grains.iter().map(|grain| grain.id))) {
        states
    } else {
        hidden = states.iter().map(|state| state_of_grains(state, grains)).collect();
        &hidden
    };
    let (mut balls, mut ball_owners) = (Vec::new(), Vec::new());
    let (mut corners, mut corner_owners) = (Vec::new(), Vec::new());
    for (k, grain) in grains.iter().enumerate() {
        let solid = grain.solid.as_deref();
        let own_ball = solid.is_none().then_some((Vec3::zeros(), grain.radius));
        for (centre, radius) in
            own_ball.into_iter().chain(solid.into_iter().flat_map(|solid| solid.balls.iter().copied()))
        {
            balls.extend([centre.x, centre.y, centre.z, radius]);
            ball_owners.push(k);
        }
        // Faces as fans of triangles.
        let faces = solid.into_iter().flat_map(|solid| solid.faces.iter().map(move |face| (solid, face)));
        for (solid, face) in faces {
            for corner in face[1..].windows(2).flat_map(|pair| [face[0], pair[0], pair[1]]) {
                corners.extend(solid.vertices[corner as usize].iter());
                corner_owners.push(k);
            }
        }
    }

    let fragments = find_fragments(last);
    let members = fragments.first().map_or(Vec::new(), |largest| largest.grains.clone());
    let mut framed: Vec<_> = members.iter().map(|&i| grains[i].clone()).collect();
    // If the largest fragment has less than half of the grains, the view covers all grains.
    if 2 * framed.len() < grains.len() {
        framed.clone_from(grains);
    }
    let ball = enclosing_ball(&framed);
    let (middle, radius) = if framed.is_empty() { (Vec3::zeros(), 1.0) } else { (ball.centre, ball.radius) };
    // Relative to the middle of the last state, shifted in the other states by the motion of the centre.
    let last_centre = states.last().map_or(Vec3::zeros(), |state| state.centre);
    let origins: Vec<Vec3> = states.iter().map(|state| middle - last_centre + state.centre).collect();
    let relative_positions =
        |(state, origin): (&PageState, &Vec3)| -> Vec<Vec3> { state.positions.iter().map(|x| x - origin).collect() };
    let relative_positions: Vec<Vec<Vec3>> = states.iter().zip(&origins).map(relative_positions).collect();
    let farthest_reach = |positions: &Vec<Vec3>| {
        let reaches = positions.iter().zip(grains).map(|(x, grain)| x.norm() + 2.0 * grain.bounding_radius());
        reaches.filter(|reach| reach.is_finite()).fold(radius, f64::max)
    };
    let reach = relative_positions.iter().map(farthest_reach).fold(radius, f64::max);
    let walls = wall_json(last, &wall_poses, &origins, reach);

    let varying = (0..VARYING_QUANTITIES.len()).map(|k| {
        let values: Vec<&[f64]> = states.iter().map(|state| &state.values[k][..]).collect();
        quantity_json(VARYING_QUANTITIES[k], &values)
    });
    let grain_values = |value: &dyn Fn(&Grain) -> f64| -> Vec<f64> { grains.iter().map(value).collect() };
    let constant = [
        (("radius", "m"), grain_values(&|grain| grain.radius)),
        (("colour", "1"), grain_values(&|grain| f64::from(grain.colour))),
        (("number", "1"), grain_values(&|grain| grain.id as f64)),
    ];
    let constant = constant.iter().map(|(name, values)| quantity_json(*name, &[values]));
    let distance = |x: &Vec3| if x.x.is_finite() { x.norm() } else { 0.0 };
    let distances: Vec<Vec<f64>> =
        relative_positions.iter().map(|positions| positions.iter().map(distance).collect()).collect();
    let distances: Vec<&[f64]> = distances.iter().map(|values| &values[..]).collect();
    let from_centre = quantity_json(("distance from the centre", "m"), &distances);
    let quantities: Vec<Value> = varying.chain([from_centre]).chain(constant).collect();
    let states_json: Vec<Value> = states
        .iter()
        .zip(&relative_positions)
        .zip(walls.states)
        .map(|((state, positions), walls)| {
            let hidden = HIDDEN_DISTANCE * reach;
            let coordinates =
                positions.iter().flat_map(|x| [x.x, x.y, x.z]).map(|x| if x.is_finite() { x } else { hidden });
            json!({ "step": state.step, "time": state.time, "places": base64_of_f64(coordinates), "turns": base64_of_f32(&state.rotations), "walls": walls })
        })
        .collect();
    json!({
        "balls": base64_of_f64(balls),
        "ball_owners": ball_owners,
        "corners": base64_of_f64(corners),
        "corner_owners": corner_owners,
        "radius": radius,
        "reach": reach.max(walls.reach),
        "walls": walls.shapes,
        "states": states_json,
        "quantities": quantities,
    })
    .to_string()
}

/// Walls on the page.
struct WallJson {
    /// Balls, triangles and lines in the frames of the walls.
    shapes: Value,
    /// Positions and rotations in each state.
    states: Vec<Value>,
    /// Distance from the middle of the view that contains the walls, m, within [`MAX_WALL_REACH`].
    reach: f64,
}

/// Largest distance of a wall in the view, in reaches of the grains: the depth of a picture has 24 bits.
const MAX_WALL_REACH: f64 = 30.0;

/// Returns the walls of the last state; `origins`: middle of the view in each state, m; `reach`: that of the grains, m.
fn wall_json(last: &Frame, poses: &[&[WallPose]], origins: &[Vec3], reach: f64) -> WallJson {
    let (mut balls, mut ball_owners) = (Vec::new(), Vec::new());
    // Triangles of opaque and of translucent walls, and lines: coordinates and owners.
    let [mut solid, mut glass, mut lines] = [(); 3].map(|()| (Vec::new(), Vec::new()));
    let mut extents = Vec::new();
    for (k, wall) in last.walls.iter().enumerate() {
        let drawn = DrawnWall::in_body_frame(wall);
        let vertex = |k: u32| &drawn.vertices[k as usize];
        for (centre, radius) in &drawn.balls {
            balls.extend([centre.x, centre.y, centre.z, *radius]);
            ball_owners.push(k);
        }
        let (corners, owners) = if drawn.is_translucent { &mut glass } else { &mut solid };
        for face in &drawn.faces {
            for corner in face[1..].windows(2).flat_map(|pair| [face[0], pair[0], pair[1]]) {
                corners.extend(vertex(corner).iter().copied());
                owners.push(k);
            }
        }
        for end in drawn.edges.iter().filter(|_| drawn.is_translucent).flatten() {
            lines.0.extend(vertex(*end).iter().copied());
            lines.1.push(k);
        }
        let balls = drawn.balls.iter().map(|(centre, radius)| centre.norm() + radius);
        extents.push(drawn.vertices.iter().map(|v| v.norm()).chain(balls).fold(0.0, f64::max));
    }
    let mut farthest = 0.0_f64;
    let states = poses.iter().zip(origins).map(|(poses, origin)| {
        let found = last.walls.iter().map(|wall| poses.iter().find(|pose| pose.id == wall.id));
        let found: Vec<Option<&WallPose>> = found.collect();
        for (pose, extent) in found.iter().zip(&extents) {
            farthest = farthest.max(pose.map_or(0.0, |pose| (pose.position - origin).norm() + extent));
        }
        // Walls that are not in the state are out of sight.
        let hidden = Vec3::repeat(HIDDEN_DISTANCE * reach);
        let positions = found.iter().flat_map(|pose| {
            let x = pose.map_or(hidden, |pose| pose.position - origin);
            [x.x, x.y, x.z]
        });
        let turns = found.iter().flat_map(|pose| pose.map_or([0.0, 0.0, 0.0, 1.0], |pose| pose.rotation));
        json!({ "places": base64_of_f64(positions), "turns": base64_of_f32(&turns.collect::<Vec<f32>>()) })
    });
    let states: Vec<Value> = states.collect();
    let shape =
        |(corners, owners): (Vec<f64>, Vec<usize>)| json!({ "corners": base64_of_f64(corners), "owners": owners });
    let shapes = json!({
        "balls": { "corners": base64_of_f64(balls), "owners": ball_owners },
        "solid": shape(solid),
        "glass": shape(glass),
        "lines": shape(lines),
    });
    WallJson { shapes, states, reach: farthest.min(MAX_WALL_REACH * reach) }
}

fn base64_of_f64(values: impl IntoIterator<Item = f64>) -> String {
    base64_of_f32(&values.into_iter().map(|value| value as f32).collect::<Vec<f32>>())
}

fn base64_of_f32(values: &[f32]) -> String {
    STANDARD.encode(values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())
}

/// JSON of a quantity: values of the grains in each state, or one list for all states.
fn quantity_json((name, unit): (&str, &str), states: &[&[f64]]) -> Value {
    let (low, high) = central_range(states.concat());
    let state_json = |values: &&[f64]| {
        let (low, high) = central_range(values.to_vec());
        json!({ "low": low, "high": high, "values": base64_of_f64(values.iter().copied()) })
    };
    let states_json: Vec<Value> = states.iter().map(state_json).collect();
    json!({ "name": name, "unit": unit, "low": low, "high": high, "states": states_json })
}

/// Range of the central 98 of 100 values, so that a single grain does not set the colours.
fn central_range(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    let quantile =
        |share: f64| values.get(((values.len() - 1) as f64 * share).round() as usize).copied().unwrap_or(0.0);
    if values.is_empty() { (0.0, 1.0) } else { (quantile(0.01), quantile(0.99)) }
}
