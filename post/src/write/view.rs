//! Camera and window of the pictures of states, and the walls as they are drawn.

use std::collections::HashMap;

use nalgebra::Rotation3;

use cd_formats::geometry::periodic_cell::PeriodicCell;

use crate::frame::{Frame, Grain, Wall, WallShape};
use crate::math::Vec3;
use crate::shapes::SolidShape;

/// Direction towards the light: left, above and in front of the picture (x right, y away, z up); length 1.
const LIGHT_DIRECTION: [f64; 3] = [-0.48, -0.64, 0.6];

/// Angles of the usual view, rad: from the front, a little from the right and from above.
const DEFAULT_AZIMUTH: f64 = 0.5;
const DEFAULT_ELEVATION: f64 = 0.35;

/// Colour of walls, and opacity of a translucent face; only its side towards the viewer is drawn.
pub const WALL_COLOUR: [f64; 3] = [150.0, 156.0, 165.0];
pub const WALL_OPACITY: f64 = 0.1;

/// Least sine of the angle between two faces at an edge that is drawn: about 30°, above that of the sides of a cylinder.
const MIN_EDGE_SINE: f64 = 0.5;

/// Largest factors by which a window grows to show a wall, and a lander: a body that is alone in its colour, or a driven
/// one that is no plate or drum.
const MAX_WALL_GROWTH: f64 = 2.0;
const MAX_LANDER_GROWTH: f64 = 6.0;

/// Parallel projection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewCamera {
    /// Rotation of the axes of the world: then x points to the right, y away and z up.
    pub rotation: Rotation3<f64>,
}

impl Default for ViewCamera {
    fn default() -> ViewCamera {
        ViewCamera::from_angles(DEFAULT_AZIMUTH, DEFAULT_ELEVATION)
    }
}

impl ViewCamera {
    /// Camera above the horizontal by `elevation`, rad; at `azimuth` 0 it looks along +y, from the front, at a quarter turn
    /// along -x, from the right.
    pub fn from_angles(azimuth: f64, elevation: f64) -> ViewCamera {
        let rotation = Rotation3::from_axis_angle(&Vec3::x_axis(), elevation)
            * Rotation3::from_axis_angle(&Vec3::z_axis(), -azimuth);
        ViewCamera { rotation }
    }
}

/// Intensity of the light on a surface with this outward normal in the view, 0 to 1.
pub fn light_intensity(normal: &Vec3) -> f64 {
    normal.dot(&Vec3::from(LIGHT_DIRECTION)).max(0.0)
}

/// Brightness of a surface without light, as a share of its colour.
pub const SHADOW_BRIGHTNESS: f64 = 0.45;

/// Colour of a surface with this intensity of the light: its colour times [`SHADOW_BRIGHTNESS`] without light, with some white
/// in full light.
pub fn shaded_colour(colour: [f64; 3], light: f64) -> [f64; 3] {
    let brightness = SHADOW_BRIGHTNESS + 0.65 * light;
    colour.map(|c| if brightness <= 1.0 { brightness * c } else { c + (brightness - 1.0) * 3.0 * (255.0 - c) })
}

/// Unit normal of a polygon whose corners are counter-clockwise seen from outside.
pub fn face_normal(corners: &[Vec3]) -> Vec3 {
    let first = corners[0];
    let fan = corners[1..].windows(2).map(|pair| (pair[0] - first).cross(&(pair[1] - first)));
    fan.sum::<Vec3>().normalize()
}

/// Least value up to which the grains have `share` of the mass.
fn weighted_quantile(mut values: Vec<(f64, f64)>, share: f64) -> f64 {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let target = share * values.iter().map(|(_, mass)| mass).sum::<f64>();
    let mut below = 0.0;
    let quantile = values.iter().find(|(_, mass)| {
        below += mass;
        below >= target
    });
    quantile.or(values.last()).map_or(f64::NAN, |(value, _)| *value)
}

/// Part of the view that a square picture shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewWindow {
    /// Middle of the picture, to the right and upwards in the rotated axes, m.
    pub middle: [f64; 2],
    /// Half of the width and of the height of the bodies in it, m; NaN without bodies.
    pub halves: [f64; 2],
}

impl ViewWindow {
    /// Window without bodies.
    pub const EMPTY: ViewWindow = ViewWindow { middle: [0.0; 2], halves: [f64::NAN; 2] };

    /// Half of the side of the square, less its border, m; NaN without bodies.
    pub fn half_side(&self) -> f64 {
        self.halves[0].max(self.halves[1])
    }

    /// Window of a disc.
    fn around_disc(middle: [f64; 2], radius: f64) -> ViewWindow {
        ViewWindow { middle, halves: [radius; 2] }
    }

    /// Window around most of the grains, and around walls and landers that are not too far from them.
    pub fn around_bodies(frame: &Frame, camera: &ViewCamera) -> ViewWindow {
        let mut window = ViewWindow::around_grains(frame, camera);
        // Windows of the parts of landers: of bodies that are alone in their colour, and of driven ones, which are not drawn
        // translucent.
        let mut lander_windows: Vec<ViewWindow> = Vec::new();
        let mut add_lander = |x: Vec3, radius: f64| {
            let at = camera.rotation * x;
            lander_windows.push(ViewWindow::around_disc([at.x, at.z], radius));
        };
        for grain in lone_grains(frame) {
            add_lander(frame.grains[grain].x, frame.grains[grain].bounding_radius());
        }
        let walls: Vec<DrawnWall> = drawn_walls(frame);
        for wall in walls.iter().filter(|wall| !wall.is_translucent) {
            wall.balls.iter().for_each(|(x, radius)| add_lander(*x, *radius));
            wall.vertices.iter().for_each(|x| add_lander(*x, 0.0));
        }
        // Without grains the walls are the picture.
        let start = window.half_side();
        let vertex_window = |x: &Vec3| {
            let at = camera.rotation * x;
            ViewWindow::around_disc([at.x, at.z], 0.0)
        };
        if start.is_nan() {
            let vertices = walls.iter().flat_map(|wall| &wall.vertices).map(vertex_window);
            return vertices.chain(lander_windows).fold(window, |all, body| all.union(&body));
        }
        for wall in walls.iter().filter(|wall| wall.is_translucent) {
            let extended = wall.vertices.iter().map(vertex_window).fold(window, |all, vertex| all.union(&vertex));
            // A large wall is cut off by the border.
            if extended.half_side() <= MAX_WALL_GROWTH * start {
                window = extended;
            }
        }
        for lander in lander_windows {
            let extended = window.union(&lander);
            if extended.half_side() <= MAX_LANDER_GROWTH * start {
                window = extended;
            }
        }
        window
    }

    /// Window around most of the grains: up to one in twenty is left out, or more if together they have less than a third
    /// of the mass.
    fn around_grains(frame: &Frame, camera: &ViewCamera) -> ViewWindow {
        let positions_in_view: Vec<Vec3> = frame.grains.iter().map(|g| camera.rotation * g.x).collect();
        if positions_in_view.is_empty() {
            return ViewWindow::EMPTY;
        }
        let quantile = |values: &mut Vec<f64>, share: f64| {
            values.sort_by(f64::total_cmp);
            values[((values.len() - 1) as f64 * share).round() as usize]
        };
        let with_mass =
            |values: &mut dyn Iterator<Item = f64>| values.zip(frame.grains.iter().map(|g| g.mass)).collect();
        let middle = |axis: usize| weighted_quantile(with_mass(&mut positions_in_view.iter().map(|x| x[axis])), 0.5);
        let (x, z) = (middle(0), middle(2));
        // Distance of each grain from the middle; all grains count if the farthest is no outlier. Two thirds of the
        // mass of a line are within two thirds of its half length, those of a ball within a larger part of its radius. So
        // three times this distance contains every connected aggregate.
        let mut reach: Vec<f64> = positions_in_view
            .iter()
            .zip(&frame.grains)
            .map(|(at, g)| (at.x - x).abs().max((at.z - z).abs()) + g.bounding_radius())
            .collect();
        let aggregate_reach = 3.0 * weighted_quantile(with_mass(&mut reach.iter().copied()), 2.0 / 3.0);
        let max_reach = quantile(&mut reach, 1.0).min(1.5 * quantile(&mut reach, 0.95)).min(aggregate_reach);
        let is_shown = |(at, grain): &(&Vec3, &Grain)| {
            (at.x - x).abs().max((at.z - z).abs()) + grain.bounding_radius() <= max_reach
        };
        let shown = positions_in_view.iter().zip(&frame.grains).filter(is_shown);
        shown.fold(ViewWindow::EMPTY, |all, (at, grain)| {
            all.union(&ViewWindow::around_disc([at.x, at.z], grain.bounding_radius()))
        })
    }

    /// Smallest window around both; a window without bodies adds nothing.
    pub fn union(&self, other: &ViewWindow) -> ViewWindow {
        if self.half_side().is_nan() || other.half_side().is_nan() {
            return if self.half_side().is_nan() { *other } else { *self };
        }
        let mut all = *self;
        for axis in [0, 1] {
            let [(low, high), (other_low, other_high)] = [self, other]
                .map(|window| (window.middle[axis] - window.halves[axis], window.middle[axis] + window.halves[axis]));
            // Unchanged, without rounding, if it contains the other.
            if other_low < low || other_high > high {
                let (low, high) = (low.min(other_low), high.max(other_high));
                (all.middle[axis], all.halves[axis]) = (0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low);
            }
        }
        all
    }
}

/// Part of a line, as shares of its length, that is between the origin and `border` along x and y; `None` if there is none.
pub fn visible_span<const N: usize>([a, b]: [[f64; N]; 2], border: [f64; 2]) -> Option<(f64, f64)> {
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for axis in [0, 1] {
        let (start, change) = (a[axis], b[axis] - a[axis]);
        if change == 0.0 {
            if !(0.0..=border[axis]).contains(&start) {
                return None;
            }
            continue;
        }
        let [enter, leave] = [0.0, border[axis]].map(|border| (border - start) / change);
        (from, to) = (from.max(enter.min(leave)), to.min(enter.max(leave)));
    }
    (from < to).then_some((from, to))
}

/// Grains that are alone in their contact colour among at least ten, such as a lander.
fn lone_grains(frame: &Frame) -> Vec<usize> {
    let mut members: HashMap<u16, Vec<usize>> = HashMap::new();
    for (k, grain) in frame.grains.iter().enumerate() {
        members.entry(grain.colour).or_default().push(k);
    }
    let is_crowd = frame.grains.len() >= 10;
    let mut lone: Vec<usize> = members.into_values().filter(|all| is_crowd && all.len() == 1).flatten().collect();
    lone.sort_unstable();
    lone
}

/// Wall as it is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnWall {
    /// Centre and radius of each ball, m.
    pub balls: Vec<(Vec3, f64)>,
    /// Corners, m.
    pub vertices: Vec<Vec3>,
    /// Faces by their corners, counter-clockwise seen from outside.
    pub faces: Vec<Vec<u32>>,
    /// Edges between faces at an angle, by their ends.
    pub edges: Vec<[u32; 2]>,
    /// Whether grains are visible through it: plates, hollow cylinders and triangulated walls, which would hide them.
    pub is_translucent: bool,
}

impl DrawnWall {
    /// Shape in the frame of the wall's body.
    pub fn in_body_frame(wall: &Wall) -> DrawnWall {
        let from_solid = |solid: &SolidShape, is_translucent: bool| DrawnWall {
            balls: solid.balls.clone(),
            vertices: solid.vertices.clone(),
            faces: solid.faces.clone(),
            edges: sharp_edges(&solid.vertices, &solid.faces),
            is_translucent,
        };
        match &wall.shape {
            WallShape::Ball(radius) => DrawnWall {
                balls: vec![(Vec3::zeros(), *radius)],
                vertices: Vec::new(),
                faces: Vec::new(),
                edges: Vec::new(),
                is_translucent: false,
            },
            WallShape::Plate(half) => from_solid(&SolidShape::from_half_lengths(*half), true),
            WallShape::Polyhedron(solid) => from_solid(solid, solid.hollow.is_some() || solid.is_mesh),
        }
    }
}

/// Walls of a frame, in their order.
pub fn drawn_walls(frame: &Frame) -> Vec<DrawnWall> {
    let cell = frame.cell();
    let drawn_wall = |wall: &Wall| {
        let x = drawn_position(wall, &cell);
        let mut drawn = DrawnWall::in_body_frame(wall);
        drawn.balls.iter_mut().for_each(|(centre, _)| *centre = x + wall.rotation * *centre);
        drawn.vertices.iter_mut().for_each(|vertex| *vertex = x + wall.rotation * *vertex);
        drawn
    };
    frame.walls.iter().map(drawn_wall).collect()
}

/// Edges whose faces make an angle, in the order of the faces; an edge of a single face counts.
fn sharp_edges(vertices: &[Vec3], faces: &[Vec<u32>]) -> Vec<[u32; 2]> {
    let normal = |face: &Vec<u32>| face_normal(&face.iter().map(|&k| vertices[k as usize]).collect::<Vec<_>>());
    let normals: Vec<Vec3> = faces.iter().map(normal).collect();
    let sides = |face: &Vec<u32>| -> Vec<[u32; 2]> {
        face.iter().zip(face.iter().cycle().skip(1)).map(|(&a, &b)| [a, b]).collect()
    };
    let face_of_side: HashMap<[u32; 2], usize> =
        faces.iter().enumerate().flat_map(|(k, face)| sides(face).into_iter().map(move |side| (side, k))).collect();
    let is_sharp = |k: usize, [a, b]: [u32; 2]| match face_of_side.get(&[b, a]) {
        // Each edge once, from its lower end.
        Some(&other) => {
            let (n, m) = (normals[k], normals[other]);
            a < b && (n.dot(&m) < 0.0 || n.cross(&m).norm() > MIN_EDGE_SINE)
        }
        None => true,
    };
    let edges = faces.iter().enumerate().flat_map(|(k, face)| sides(face).into_iter().map(move |side| (k, side)));
    edges.filter(|(k, side)| is_sharp(*k, *side)).map(|(_, side)| side).collect()
}

/// Position at which a wall is drawn: in a periodic scene, that of its image with the centre in the cell, along axes in
/// which a plate is shorter than a period.
pub fn drawn_position(wall: &Wall, cell: &PeriodicCell) -> Vec3 {
    let shift = cell.nearest_shift(&wall.x);
    let fits = |axis: usize| match (&wall.shape, cell.periods.get(axis)) {
        (WallShape::Plate(half), Some(Some(period))) => {
            2.0 * (0..3).map(|k| (wall.rotation * Vec3::ith(k, half[k]))[axis].abs()).sum::<f64>() < *period
        }
        _ => true,
    };
    wall.x - Vec3::from_fn(|axis, _| if fits(axis) { shift[axis] } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use cd_formats::snapshot::DRIVEN_ALL;

    use super::*;
    use crate::samples::Scene;

    #[test]
    fn cameras_see_the_side_that_their_angles_name() {
        // At azimuth 0 x is to the right and y away; a quarter turn later y is to the right and the viewer at +x.
        let near = |a: Vec3, b: [f64; 3]| (a - Vec3::from(b)).norm() < 1e-15; // two roundings of 1
        let front = ViewCamera::from_angles(0.0, 0.0).rotation;
        assert!(near(front * Vec3::x(), [1.0, 0.0, 0.0]) && near(front * Vec3::y(), [0.0, 1.0, 0.0]));
        let right = ViewCamera::from_angles(std::f64::consts::FRAC_PI_2, 0.0).rotation;
        assert!(near(right * Vec3::y(), [1.0, 0.0, 0.0]) && near(right * Vec3::x(), [0.0, -1.0, 0.0]));
        let above = ViewCamera::from_angles(0.0, std::f64::consts::FRAC_PI_2).rotation;
        assert!(near(above * Vec3::z(), [0.0, -1.0, 0.0]) && near(above * Vec3::y(), [0.0, 0.0, 1.0]));
    }

    #[test]
    fn a_plate_has_twelve_edges_and_a_drum_two_rims() {
        let plate = SolidShape::from_half_lengths(Vec3::new(1.0, 2.0, 0.1));
        assert_eq!(sharp_edges(&plate.vertices, &plate.faces).len(), 12);
        let mut scene = Scene::default();
        scene.plate([0.0, 0.0, -0.1], [3.0, 3.0, 0.1]);
        let walls = drawn_walls(&scene.frame());
        assert_eq!((walls.len(), walls[0].faces.len(), walls[0].is_translucent), (1, 6, true));
        // A prism of 64 sides: its sides meet at 5.6 degrees, its ends at 90.
        let ring = |z: f64| {
            (0..64)
                .map(move |k| (std::f64::consts::TAU * f64::from(k) / 64.0).sin_cos())
                .map(move |(s, c)| Vec3::new(c, s, z))
        };
        let vertices: Vec<Vec3> = ring(0.0).chain(ring(1.0)).collect();
        let mut faces: Vec<Vec<u32>> = (0..64).map(|k| vec![k, (k + 1) % 64, 64 + (k + 1) % 64, 64 + k]).collect();
        faces.push((0..64).rev().collect());
        faces.push((64..128).collect());
        let edges = sharp_edges(&vertices, &faces);
        assert!(edges.len() == 128 && edges.iter().all(|[a, b]| (a < &64) == (b < &64)));
    }

    #[test]
    fn walls_near_the_grains_and_landers_are_in_the_window() {
        let mut scene = Scene::default();
        for k in 0..121 {
            scene.grain([f64::from(k % 11) - 5.0, f64::from(k / 11) - 5.0, 0.0], 0.5);
        }
        scene.snapshot.bodies.body_colour.fill(0);
        let camera = ViewCamera::from_angles(0.0, 0.0);
        let window = |scene: &Scene| ViewWindow::around_bodies(&scene.frame(), &camera);
        assert!((window(&scene).half_side() - 5.5).abs() < 1e-12);
        // A floor 12 wide is shown, one 60 wide is cut off.
        let floor = scene.plate([0.0, 0.0, -0.6], [6.0, 6.0, 0.1]);
        assert!((window(&scene).half_side() - 6.0).abs() < 1e-12);
        scene.snapshot.bodies.body_half_lengths[floor] = [30.0, 30.0, 0.1];
        assert!((window(&scene).half_side() - 5.5).abs() < 1e-12);
        // A lander 12 above, alone in its colour or driven, is in the picture; one more grain of the bed is not.
        let lander = scene.grain([0.0, 0.0, 12.0], 0.8);
        scene.snapshot.bodies.body_colour[lander] = 0;
        assert!((window(&scene).half_side() - 5.5).abs() < 1e-12);
        scene.snapshot.bodies.body_colour[lander] = 1;
        let shown = window(&scene);
        assert!(shown.middle[1] + shown.halves[1] >= 12.8 && shown.middle[1] - shown.halves[1] <= -0.5, "{shown:?}");
        (scene.snapshot.bodies.body_colour[lander], scene.snapshot.bodies.body_driven[lander]) = (0, DRIVEN_ALL);
        assert_eq!(window(&scene), shown);
        // One that is far away leaves the grains visible.
        scene.snapshot.bodies.body_x[lander] = [0.0, 0.0, 1e6];
        assert!((window(&scene).half_side() - 5.5).abs() < 1e-12);
    }

    #[test]
    fn lines_are_cut_at_the_border() {
        assert_eq!(visible_span([[-40.0, 20.0], [80.0, 20.0]], [40.0; 2]), Some((1.0 / 3.0, 2.0 / 3.0)));
        assert_eq!(visible_span([[1.0, 1.0, 5.0], [2.0, 3.0, -5.0]], [40.0; 2]), Some((0.0, 1.0)));
        assert_eq!(visible_span([[-1.0, 1.0], [-2.0, 3.0]], [40.0; 2]), None);
        assert_eq!(visible_span([[-10.0, 5.0], [5.0, -10.0]], [40.0; 2]), None);
        assert_eq!(visible_span([[5.0, -1.0], [5.0, -9.0]], [40.0; 2]), None);
    }

    #[test]
    fn windows_grow_to_contain_others() {
        let a = ViewWindow { middle: [0.0, 0.0], halves: [1.0, 1.0] };
        let b = ViewWindow { middle: [4.0, 0.0], halves: [2.0, 0.5] };
        assert_eq!(a.union(&b), ViewWindow { middle: [2.5, 0.0], halves: [3.5, 1.0] });
        assert_eq!((a.union(&ViewWindow::EMPTY), ViewWindow::EMPTY.union(&b)), (a, b));
        assert_eq!(a.union(&ViewWindow { middle: [0.1, 0.0], halves: [0.3, 0.3] }), a);
        assert_eq!(b.half_side(), 2.0);
        assert!(ViewWindow::EMPTY.half_side().is_nan());
    }
}
