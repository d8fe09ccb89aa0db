//! Check of the bodies of a new DATBOX for overlaps of bodies of different origin, by their shapes, compared with the overlaps
//! that the runs left.

use std::cell::OnceCell;

use cd_formats::bodies::{Bodies, Body, Contactor, ShapeRecord};
use cd_formats::compute::Compute;
use cd_formats::convex_pieces::convex_surfaces;
use cd_formats::drv_dof::DrvDof;
use cd_formats::ids::BodyId;
use cd_formats::report::FaultReport;
use cd_formats::rotation::nearest_rotation;
use cd_formats::snapshot::DRIVEN_ALL;
use cd_formats::tact_behav::{TactBehav, VisibilitySide};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::changes::Changes;
use super::source::{SourceCase, SourcePart, scene_path, unit_quaternion};
use crate::grain::Population;
use crate::overlaps::{TOUCHING_TOLERANCE, nearest_images};
use crate::placement::cells::SphereGrid;
use crate::population::check_balls_extent;
use crate::shapes::overlap::{ConvexPiece, deepest_overlap};
use crate::shapes::{OrientedRoundSolid, RoundSolid};
use crate::walls::{self, WallBody};

type Vec3 = Vector3<f64>;

/// Share by which an overlap may exceed the overlaps that the runs left: a wall that is put back has 8 digits.
const ALLOWED_EXCESS: f64 = 1e-3;

/// Plate or cylinder at its position; rows of `axes` are its own axes.
struct PosedWall {
    shape: ShapeRecord,
    centre: Vec3,
    axes: Matrix3<f64>,
}

/// Position and orientation of a body of BODIES.DAT.
#[derive(Clone, Copy)]
struct BodyPose {
    /// Vector from the position in the file to the centre of mass, m.
    shift: Vec3,
    /// Centre of mass, m.
    x: Vec3,
    q: UnitQuaternion<f64>,
}

impl BodyPose {
    /// Converts a point from the frame of the file, m; `own_axes` as from [`own_axes`].
    fn to_fixed_frame(self, own_axes: &Matrix3<f64>, point: Vec3) -> Vec3 {
        self.x + self.q * (own_axes.transpose() * (point - self.shift))
    }
}

/// Contactors of a body at their positions.
#[derive(Default)]
struct PosedBody {
    /// Centre and radius of each ball, m.
    balls: Vec<(Vec3, f64)>,
    /// Pieces of polyhedra, and prisms inscribed in solid cylinders.
    pieces: Vec<ConvexPiece>,
    walls: Vec<PosedWall>,
}

impl PosedBody {
    /// Shape of a body of BODIES.DAT in a pose.
    fn from_body(body: &Body, pose: &BodyPose) -> PosedBody {
        let BodyPose { x, q, .. } = pose;
        let mut solid = PosedBody::default();
        let is_single = body.contactors.len() == 1;
        let own_axes = own_axes(body);
        let to_fixed_frame = |point: Vec3| pose.to_fixed_frame(&own_axes, point);
        for Contactor { shape, local_frame, .. } in &body.contactors {
            let frame = local_frame.as_ref();
            let offset = frame.map_or(Vec3::zeros(), |frame| frame.offset.into());
            match shape {
                ShapeRecord::Sphere { radius } => {
                    solid.balls.push((if is_single { *x } else { to_fixed_frame(offset) }, *radius));
                }
                ShapeRecord::OffsetSphere { radius, offset } => {
                    solid.balls.push((to_fixed_frame(Vec3::from(*offset)), *radius));
                }
                ShapeRecord::Polyhedron { vertices, triangles } => {
                    for piece in convex_surfaces(vertices, triangles) {
                        let vertices = piece.vertices.iter().map(|v| to_fixed_frame(Vec3::from(*v)) - x).collect();
                        solid.pieces.push(ConvexPiece::new(*x, vertices, &piece.triangles));
                    }
                }
                ShapeRecord::Plane { .. }
                | ShapeRecord::Cylinder { .. }
                | ShapeRecord::Capsule { .. }
                | ShapeRecord::Mesh { .. } => {
                    let columns = frame.map_or(Matrix3::identity(), |f| Matrix3::from_columns(&f.axes.map(Vec3::from)));
                    let local_axes = nearest_rotation(&columns).into_inner();
                    let q = q.to_rotation_matrix().into_inner();
                    // A single contactor has the centre and the axes of its body.
                    let (centre, axes) = if is_single {
                        (*x, q)
                    } else {
                        (to_fixed_frame(offset), q * own_axes.transpose() * local_axes)
                    };
                    let axes = axes.transpose();
                    if let Some(shape) = RoundSolid::from_record(shape) {
                        let solid_shape = OrientedRoundSolid { shape, axes };
                        solid.balls.extend(solid_shape.balls(centre).map(|ball| (ball.centre, ball.radius)));
                        solid.pieces.extend(solid_shape.convex_piece(centre));
                    }
                    if !matches!(shape, ShapeRecord::Capsule { .. }) {
                        solid.walls.push(PosedWall { shape: shape.clone(), centre, axes });
                    }
                }
                ShapeRecord::Point { .. } => {}
            }
        }
        solid
    }

    /// Shape of a new wall.
    fn from_wall(wall: &WallBody) -> PosedBody {
        let wall = PosedWall { shape: wall.shape.clone(), centre: wall.centre, axes: wall.axes };
        PosedBody { walls: vec![wall], ..PosedBody::default() }
    }

    /// Penetration of another solid, moved by -`shift`, into this one, m. It is negative or 0 when apart, and any value
    /// up to `allowed` as soon as the depth is known not to exceed it. Pairs of `walls` do not count.
    fn overlap_with(&self, other: &PosedBody, shift: &Vec3, allowed: f64) -> f64 {
        let moved_pieces = |pieces: &[ConvexPiece]| -> Vec<ConvexPiece> {
            let mut pieces = pieces.to_vec();
            pieces.iter_mut().for_each(|piece| piece.centre -= shift);
            pieces
        };
        let others = moved_pieces(&other.pieces);
        let mut deepest = deepest_overlap(&self.pieces, &others, allowed);
        for (centre, radius) in &self.balls {
            for (other_centre, other_radius) in &other.balls {
                deepest = deepest.max(radius + other_radius - (centre - other_centre + shift).norm());
            }
            deepest = others.iter().map(|piece| piece.overlap_of_ball(centre, *radius)).fold(deepest, f64::max);
            let wall_overlap = |wall: &PosedWall| {
                walls::ball_overlap(&wall.shape, &(wall.axes * (centre + shift - wall.centre)), *radius)
            };
            deepest = other.walls.iter().map(wall_overlap).fold(deepest, f64::max);
        }
        for (centre, radius) in &other.balls {
            let centre = centre - shift;
            deepest = self.pieces.iter().map(|piece| piece.overlap_of_ball(&centre, *radius)).fold(deepest, f64::max);
            let wall_overlap =
                |wall: &PosedWall| walls::ball_overlap(&wall.shape, &(wall.axes * (centre - wall.centre)), *radius);
            deepest = self.walls.iter().map(wall_overlap).fold(deepest, f64::max);
        }
        for wall in &self.walls {
            deepest = deepest.max(walls::pieces_overlap(&wall.shape, &wall.centre, &wall.axes, &others, allowed));
        }
        for wall in &other.walls {
            let centre = wall.centre - shift;
            deepest = deepest.max(walls::pieces_overlap(&wall.shape, &centre, &wall.axes, &self.pieces, allowed));
        }
        deepest
    }
}

/// Axes of a body in the frame of its file, as columns, as in cd-solve: the fixed axes if its inertia is given or it is a
/// lone wall or sphere, else its principal axes.
fn own_axes(body: &Body) -> Matrix3<f64> {
    let frame = body.mass_properties().ok().and_then(|own| body.computed_frame(&own));
    frame.map_or(Matrix3::identity(), |frame| Matrix3::from_fn(|i, j| frame.axes[j][i]))
}

/// Largest overlap of two bodies in contact at the end of a run, m, over all its bodies, selected or not.
fn remaining_overlap(source: &SourceCase, options: &Compute) -> f64 {
    let bodies = &source.snapshot.bodies;
    let posed_bodies: Vec<OnceCell<PosedBody>> = (0..source.bodies.0.len()).map(|_| OnceCell::new()).collect();
    let x = |k: usize| Vec3::from(bodies.body_x[k]);
    let posed_body = |k: usize| {
        posed_bodies[k].get_or_init(|| {
            let pose = BodyPose { shift: source.shifts[k], x: x(k), q: unit_quaternion(bodies.body_q[k]) };
            PosedBody::from_body(&source.bodies.0[k], &pose)
        })
    };
    let mut pairs: Vec<[usize; 2]> =
        source.snapshot.contacts.contact_body.iter().map(|pair| pair.map(|body| BodyId(body).index())).collect();
    pairs.dedup();
    let mut deepest = 0.0;
    for [a, b] in pairs {
        for shift in nearest_images(options, &(x(b) - x(a))) {
            deepest = f64::max(deepest, posed_body(a).overlap_with(posed_body(b), &shift, deepest));
        }
    }
    deepest
}

/// Overlap of two bodies of the new DATBOX.
struct BodyOverlap {
    /// Numbers from 0, ascending.
    bodies: [usize; 2],
    /// m
    depth: f64,
}

/// Bodies of the new DATBOX at their positions: the bodies of the parts, then the new grains and walls.
pub struct PlacedBodies<'a> {
    parts: &'a [SourcePart<'a>],
    new: &'a Population,
    records: &'a Bodies,
    /// Number of the part of each body; the number of parts for new bodies.
    owner: Vec<usize>,
    /// Centres of mass, m.
    centres: Vec<Vec3>,
    /// Whether all components of a body's velocity are imposed: a wall, or a grain that is held.
    is_held: Vec<bool>,
    /// Whether a body is a new wall, or has imposed motion and is from a run.
    is_wall: Vec<bool>,
    /// Shapes of the bodies that have been compared.
    shapes: Vec<OnceCell<PosedBody>>,
}

impl<'a> PlacedBodies<'a> {
    /// Places the bodies `records` of the parts and the new ones; `driven`: their imposed components.
    pub fn new(parts: &'a [SourcePart<'a>], new: &'a Population, records: &'a Bodies, driven: &DrvDof) -> Self {
        let (mut owner, mut centres, mut is_wall) = (Vec::new(), Vec::new(), Vec::new());
        for (k, part) in parts.iter().enumerate() {
            owner.extend(std::iter::repeat_n(k, part.source_bodies.len()));
            centres.extend(part.state.bodies.body_x.iter().map(|x| Vec3::from(*x)));
            is_wall.extend(part.state.bodies.body_driven.iter().map(|&components| components != 0));
        }
        owner.resize(records.0.len(), parts.len());
        centres.extend(new.grains.iter().map(|grain| grain.position));
        centres.extend(new.walls.iter().map(|wall| wall.centre));
        is_wall.extend(std::iter::repeat_n(false, new.grains.len()));
        is_wall.resize(records.0.len(), true);
        let mut imposed = vec![0; records.0.len()];
        for row in driven.0.iter().filter(|row| row.kind.imposes_velocity()) {
            imposed[row.body] |= 1 << row.component;
        }
        let is_held = imposed.iter().map(|&components: &u8| components == DRIVEN_ALL).collect();
        let shapes = (0..records.0.len()).map(|_| OnceCell::new()).collect();
        PlacedBodies { parts, new, records, owner, centres, is_held, is_wall, shapes }
    }

    /// Checks bodies of different parts, and their periodic images. They may touch, and overlap no deeper than the runs left
    /// their bodies. Overlaps among the new bodies are checked elsewhere, and two bodies that are both held may overlap: they
    /// exert no force on each other.
    pub fn check_overlaps(&self, changes: &Changes, options: &Compute, report: &mut FaultReport) {
        let ball = |k: usize| Some((k, self.reach(k)?));
        let mut balls: Vec<(usize, f64)> = (0..self.records.0.len()).filter_map(ball).collect();
        balls.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        for (k, (part, selection)) in self.parts.iter().zip(&changes.bodies).enumerate() {
            let is_changed = |axis: &usize| {
                selection.rotate.angle != 0.0 || part.source.options.periods()[*axis] != options.periods()[*axis]
            };
            for axis in (0..3).filter(is_changed) {
                let part_balls = balls.iter().filter(|(body, _)| self.owner[*body] == k);
                let part_balls = part_balls.map(|&(body, radius)| (self.centres[body], radius));
                check_balls_extent(options, axis, part_balls, report);
            }
        }
        let mut found = self.overlaps(&balls, options);
        if found.is_empty() {
            return;
        }
        // Within one part the deepest overlap of its run counts; between two parts, the deeper one.
        let remaining: Vec<f64> =
            self.parts.iter().map(|part| remaining_overlap(part.source, &part.source.options)).chain([0.0]).collect();
        let remaining_of_pair =
            |pair: [usize; 2]| pair.map(|body| remaining[self.owner[body]]).into_iter().fold(0.0, f64::max);
        found.retain(|overlap| overlap.depth > (1.0 + ALLOWED_EXCESS) * remaining_of_pair(overlap.bodies));
        found.sort_by(|a, b| b.depth.total_cmp(&a.depth).then(a.bodies.cmp(&b.bodies)));
        found.dedup_by_key(|overlap| overlap.bodies);
        if let Some(&BodyOverlap { bodies: [a, b], depth }) = found.first() {
            let count = if found.len() == 1 { String::new() } else { format!(", the deepest of {}", found.len()) };
            let [origin_a, origin_b] = [a, b].map(|body| self.origin_text(body));
            let found =
                format!("bodies {} ({origin_a}) and {} ({origin_b}) overlap by {depth:.3e} m{count}", a + 1, b + 1);
            let expected = match remaining_of_pair([a, b]) {
                0.0 => "bodies of different origin that touch at most".into(),
                remaining => format!(
                    "bodies of different origin that touch, or overlap by at most the {remaining:.3e} m that the run had left"
                ),
            };
            report.add_fault(&scene_path(self.parts, self.new, b), found, expected);
        }
    }

    /// Number of bodies that are from runs.
    fn source_count(&self) -> usize {
        self.owner.partition_point(|&part| part < self.parts.len())
    }

    /// Part of a body that is from a run, and its row there.
    fn row_in_part(&self, body: usize) -> (&SourcePart<'a>, usize) {
        let first = self.owner.partition_point(|&part| part < self.owner[body]);
        (&self.parts[self.owner[body]], body - first)
    }

    /// Shape of a body at its position.
    fn shape(&self, body: usize) -> &PosedBody {
        self.shapes[body].get_or_init(|| match body.checked_sub(self.source_count()) {
            None => {
                let (part, row) = self.row_in_part(body);
                PosedBody::from_body(&part.records[row], &part_pose(part, row))
            }
            Some(number) => match self.new.grains.get(number) {
                Some(grain) if grain.has_pieces() => {
                    PosedBody { pieces: grain.convex_pieces(), ..PosedBody::default() }
                }
                Some(grain) => {
                    let balls = grain.balls().into_iter().map(|ball| (ball.centre, ball.radius)).collect();
                    PosedBody { balls, ..PosedBody::default() }
                }
                None => PosedBody::from_wall(&self.new.walls[number - self.new.grains.len()]),
            },
        })
    }

    /// Radius about its centre that contains the contactors of a body, m, but for those of [`Self::is_wall_shape`] and
    /// points; `None` if there is no other.
    fn reach(&self, body: usize) -> Option<f64> {
        let record = &self.records.0[body];
        let shift = self.centres[body] - Vec3::from(record.position);
        let from_centre = |point: &[f64; 3]| (Vec3::from(*point) - shift).norm();
        let reach = |Contactor { shape, local_frame, .. }: &Contactor| {
            // A single contactor has the centre of its body.
            let offset = match local_frame {
                _ if record.contactors.len() == 1 => 0.0,
                Some(frame) => from_centre(&frame.offset),
                None => shift.norm(),
            };
            match shape {
                ShapeRecord::Sphere { radius } => Some(offset + radius),
                ShapeRecord::OffsetSphere { radius, offset } => Some(from_centre(offset) + radius),
                ShapeRecord::Polyhedron { vertices, .. } => Some(vertices.iter().map(from_centre).fold(0.0, f64::max)),
                ShapeRecord::Capsule { .. } | ShapeRecord::Cylinder { .. } => {
                    Some(offset + RoundSolid::from_record(shape)?.reach())
                }
                ShapeRecord::Plane { .. } | ShapeRecord::Mesh { .. } | ShapeRecord::Point { .. } => None,
            }
        };
        let contactors = record.contactors.iter().filter(|contactor| !self.is_wall_shape(body, contactor));
        contactors.filter_map(reach).reduce(f64::max)
    }

    /// Whether a contactor of a body is a plate, a surface, a hollow cylinder, or the solid cylinder of a wall, which
    /// is not searched for as a ball about its body's centre.
    fn is_wall_shape(&self, body: usize, contactor: &Contactor) -> bool {
        match contactor.shape {
            ShapeRecord::Plane { .. } | ShapeRecord::Mesh { .. } => true,
            ShapeRecord::Cylinder { hollow, .. } => hollow || self.is_wall[body],
            _ => false,
        }
    }

    /// Overlaps of bodies of different parts beyond rounding, overlaps with periodic images included. `balls`: bodies with their
    /// [`Self::reach`], the largest first.
    fn overlaps(&self, balls: &[(usize, f64)], options: &Compute) -> Vec<BodyOverlap> {
        let mut found = Vec::new();
        let mut compare = |a: usize, b: usize, shift: &Vec3, radius: f64| {
            if self.owner[a] != self.owner[b] && !(self.is_held[a] && self.is_held[b]) {
                let depth = self.shape(a).overlap_with(self.shape(b), shift, TOUCHING_TOLERANCE * radius);
                if depth > TOUCHING_TOLERANCE * radius {
                    found.push(BodyOverlap { bodies: [a.min(b), a.max(b)], depth });
                }
            }
        };
        let has_walls = |body: &usize| {
            self.records.0[*body].contactors.iter().any(|contactor| self.is_wall_shape(*body, contactor))
        };
        for wall in (0..self.records.0.len()).filter(has_walls) {
            for &(k, radius) in balls.iter().filter(|(k, _)| self.owner[*k] != self.owner[wall]) {
                for shift in nearest_images(options, &(self.centres[k] - self.centres[wall])) {
                    let centre = self.centres[k] - shift;
                    let is_near = |wall: &PosedWall| {
                        walls::ball_overlap(&wall.shape, &(wall.axes * (centre - wall.centre)), radius) > 0.0
                    };
                    if self.shape(wall).walls.iter().any(is_near) {
                        compare(wall, k, &shift, radius);
                    }
                }
            }
        }
        let mut cells = SphereGrid::new(balls.first().map_or(1.0, |ball| ball.1));
        for &(k, radius) in balls {
            // Position in the cell about the origin: neighbours lie in that cell or in an adjacent one.
            let cell_origin = nearest_images(options, &self.centres[k])[0];
            let relative_centre = self.centres[k] - cell_origin;
            for shift in nearest_images(options, &Vec3::zeros()) {
                cells.for_each_overlap(&(relative_centre + shift), radius, |number, _| {
                    let other = balls[number].0;
                    let other_origin = nearest_images(options, &self.centres[other])[0];
                    compare(k, other, &(other_origin - cell_origin + shift), radius);
                });
            }
            cells.add(relative_centre, radius);
        }
        found
    }

    /// Origin of a body in words.
    fn origin_text(&self, body: usize) -> String {
        let Some(number) = body.checked_sub(self.source_count()) else {
            let (part, row) = self.row_in_part(body);
            return format!("{} of {}", part.source_bodies[row].index() + 1, part.source.case.display());
        };
        match number.checked_sub(self.new.grains.len()) {
            None => format!("grain {} of the changes", number + 1),
            Some(wall) => format!("wall {} of the changes", self.new.walls[wall].wall + 1),
        }
    }
}

/// Pose of a row of a part.
fn part_pose(part: &SourcePart, row: usize) -> BodyPose {
    let bodies = &part.state.bodies;
    let shift = part.source.shifts[part.source_bodies[row].index()];
    BodyPose { shift, x: Vec3::from(bodies.body_x[row]), q: unit_quaternion(bodies.body_q[row]) }
}

/// Checks hollow cylinders, which push inwards only: reports the first body that touches each and is outside of it.
pub fn check_drums(
    parts: &[SourcePart],
    new: &Population,
    records: &Bodies,
    tact: &TactBehav,
    driven: &DrvDof,
    report: &mut FaultReport,
) {
    let is_drum = |contactor: &Contactor| matches!(contactor.shape, ShapeRecord::Cylinder { hollow: true, .. });
    if !records.0.iter().any(|body| body.contactors.iter().any(is_drum)) {
        return;
    }
    let mut poses: Vec<BodyPose> = Vec::new();
    for part in parts {
        poses.extend((0..part.records.len()).map(|row| part_pose(part, row)));
    }
    let source_count = poses.len();
    let new_pose = |x: Vec3, axes: &Matrix3<f64>| {
        let rotation = Rotation3::from_matrix_unchecked(axes.transpose());
        BodyPose { shift: Vec3::zeros(), x, q: UnitQuaternion::from_rotation_matrix(&rotation) }
    };
    poses.extend(new.grains.iter().map(|grain| new_pose(grain.position, &grain.axes())));
    poses.extend(new.walls.iter().map(|wall| new_pose(wall.centre, &wall.axes)));
    let mut is_driven = vec![false; records.0.len()];
    for row in driven.0.iter().filter(|row| row.kind.imposes_velocity()) {
        is_driven[row.body] = true;
    }
    let can_touch = |a: &Contactor, b: &Contactor| {
        let is_of = |side: &VisibilitySide, contactor: &Contactor| {
            side.colour == contactor.colour && side.contactor == contactor.shape.row_name()
        };
        tact.visibility.iter().any(|row| {
            is_of(&row.candidate, a) && is_of(&row.antagonist, b)
                || is_of(&row.candidate, b) && is_of(&row.antagonist, a)
        })
    };
    for (j, body) in records.0.iter().enumerate().filter(|(_, body)| body.contactors.iter().any(is_drum)) {
        let solid = PosedBody::from_body(body, &poses[j]);
        let drums = body.contactors.iter().filter(|contactor| is_drum(contactor));
        let walls = solid.walls.iter().filter(|wall| matches!(wall.shape, ShapeRecord::Cylinder { hollow: true, .. }));
        for (drum, wall) in drums.zip(walls) {
            let outside = (0..records.0.len()).filter(|&k| k != j && !is_driven[k]).find(|&k| {
                let mut touching = records.0[k].contactors.iter().filter(|contactor| can_touch(contactor, drum));
                touching.any(|contactor| {
                    let centre = contactor_centre(&records.0[k], contactor, &poses[k]);
                    wall.shape.is_outside_hollow((wall.axes * (centre - wall.centre)).into())
                })
            });
            if let Some(k) = outside {
                let path = scene_path(parts, new, k);
                let drum_text = match new.walls.get(j.wrapping_sub(source_count + new.grains.len())) {
                    Some(wall) => format!("wall {}", wall.wall + 1),
                    None => format!("body {}", j + 1),
                };
                let found = format!("body {} is outside of {drum_text}, a hollow cylinder", k + 1);
                report.add_fault(
                    &path,
                    found,
                    "bodies that can touch it inside: it is closed and has contacts on its inside only",
                );
            }
        }
    }
}

/// Centre of a contactor of a body, as in [`PosedBody::from_body`].
fn contactor_centre(body: &Body, contactor: &Contactor, pose: &BodyPose) -> Vec3 {
    let is_at_centre =
        matches!(body.contactors.as_slice(), [only] if !matches!(only.shape, ShapeRecord::OffsetSphere { .. }));
    match contactor.mass_properties() {
        Ok(own) if !is_at_centre => pose.to_fixed_frame(&own_axes(body), Vec3::from(own.centre)),
        _ => pose.x,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balls_in_drums_and_next_to_pillars() {
        let turn = UnitQuaternion::from_scaled_axis(Vec3::new(0.3, -1.1, 0.7));
        let centre = Vec3::new(5.0, -2.0, 1.0);
        let overlap = |hollow: bool, local: [f64; 3]| {
            let shape = ShapeRecord::Cylinder { half_height: 4.0, radius: 3.0, hollow };
            let wall = PosedWall { shape, centre, axes: turn.to_rotation_matrix().into_inner().transpose() };
            let wall = PosedBody { walls: vec![wall], ..PosedBody::default() };
            let shift = Vec3::new(10.0, 0.0, 0.0);
            let ball =
                PosedBody { balls: vec![(centre + turn * Vec3::from(local) + shift, 0.5)], ..PosedBody::default() };
            let found = wall.overlap_with(&ball, &shift, 0.0);
            assert!((found - ball.overlap_with(&wall, &-shift, 0.0)).abs() < 1e-13, "{local:?}");
            found
        };
        for (hollow, local, expected) in [
            (true, [0.0, 2.0, 1.0], 0.0),
            (true, [2.4, 1.8, 0.0], 0.5),
            (true, [0.0, 1.0, -3.75], 0.25),
            (true, [0.0, 9.0, 0.0], 0.0),
            (false, [0.0, 3.25, 1.0], 0.25),
            (false, [0.0, 2.25, 1.0], 1.25),
            (false, [0.0, 3.3, 4.4], 0.0), // 3-4-5 from the rim
            (false, [0.0, 1.0, 5.0], 0.0),
        ] {
            let found = overlap(hollow, local);
            assert!((found - expected).abs() < 1e-14, "{hollow} {local:?}: {found}");
        }
    }
}
