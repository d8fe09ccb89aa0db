//! A bed of grains between walls: its level, solid fraction and stress, for the whole bed and by layers.

use cd_formats::geometry::periodic_cell::PeriodicCell;

use crate::derive::coordination::neighbour_counts;
use crate::derive::enclosure::{BedWalls, GrainEnclosure};
use crate::derive::fragments::Fragment;
use crate::derive::heights::{centre_of_mass, height_range, volume_below};
use crate::derive::polytope::cut_polygon;
use crate::derive::stress::{grain_stresses, pressure};
use crate::derive::walls::{CylinderBore, WallPlane, supported_grains};
use crate::frame::{ContactBody, Frame, Grain, GrainId, SnapshotInterval, WallId};
use crate::math::{Mat3, Vec3};

/// Tolerance of cosines near 0 or 1 within which a wall counts as upright or level: a few roundings of an orientation from
/// a file.
const UPRIGHT_TOLERANCE: f64 = 1e-6;

/// The grains that rest on walls under uniform gravity, between upright walls or in a cell that repeats.
#[derive(Debug, Clone, PartialEq)]
pub struct Bed {
    /// Normal of the floor, length 1.
    pub up: Vec3,
    /// Position of the floor along `up`, m.
    pub floor: f64,
    /// Area of the horizontal section between the walls, m^2.
    pub area: f64,
    /// Thickness of the uniform bed with the same centre of mass, m: twice the height of the centre of mass above the
    /// floor.
    pub height: f64,
    /// Indices of the grains, ascending: the groups that a wall touches with force, and the grains among them.
    pub grains: Vec<GrainId>,
    /// sum V_i sigma_i over the bed's grains, J ([`grain_stresses`]).
    moment: Mat3,
    /// A third of the trace of the moment, mean over the steps since the snapshot before, J.
    interval_moment: f64,
    /// Volume of the grains, m^3.
    grain_volume: f64,
}

impl Bed {
    /// Returns the bed of a frame; `fragments`: all fragments of the frame. None without uniform gravity, if no
    /// wall is touched with force, if a side is open, and if the sides are not upright.
    ///
    /// Walls bound it as they do a region ([`GrainEnclosure`]): a heap that leaves half of the section free, or keeps away
    /// from a side, is no bed. The floor is the plane of plates, faces or ends of hollow cylinders that bear most of the
    /// weight. If none bears weight (a floor of fixed spheres), the floor is level, at the lowest point of a grain. Grains
    /// beyond a wall have left the bed. A grain without support at that instant belongs to the bed if it is between these
    /// walls and its centre is no higher than the highest point of the other grains. In a flowing bed these are a part of
    /// the grains.
    pub fn from_frame(frame: &Frame, fragments: &[Fragment]) -> Option<Bed> {
        let against_gravity = (-Vec3::from(frame.meta.parameters.uniform_gravity)).try_normalize(0.0)?;
        let mut grains = supported_grains(frame, fragments);
        if grains.is_empty() {
            return None;
        }
        let members = || grains.iter().map(|&i| &frame.grains[i]);
        let BedWalls { planes, bores } = GrainEnclosure::from_core(frame, grains.clone()).into_bed_walls()?;
        let mut supported_weight = vec![0.0; frame.walls.len()];
        for contact in frame.active_contacts() {
            for body in contact.bodies() {
                if let ContactBody::Wall(k) = body {
                    supported_weight[k.index()] +=
                        contact.on_grains().map(|(_, force, _)| force.dot(&against_gravity)).sum::<f64>();
                }
            }
        }
        let load_on = |plane: &&WallPlane| {
            let mut walls: Vec<WallId> = plane.faces.iter().map(|face| face.wall).collect();
            walls.sort_unstable();
            walls.dedup();
            walls.iter().map(|wall| supported_weight[wall.index()]).sum::<f64>() * plane.normal.dot(&against_gravity)
        };
        // A lid may bear more than the floor, for an instant, but from above; the ends of a lying drum are upright up to
        // rounding.
        let bears_from_below =
            |plane: &&WallPlane| plane.normal.dot(&against_gravity) > UPRIGHT_TOLERANCE && load_on(plane) > 0.0;
        let floor = planes.iter().filter(bears_from_below).max_by(|a, b| load_on(a).total_cmp(&load_on(b)));
        let up =
            floor.map_or(if frame.cell().is_periodic() { Vec3::z() } else { against_gravity }, |floor| floor.normal);
        let lowest_height = || members().map(|g| height_range(g, &up)[0]).fold(f64::INFINITY, f64::min);
        let floor = floor.map_or_else(lowest_height, |floor| floor.offset);
        let area = section_area(&planes, &bores, &frame.cell(), &up, &centre_of_mass(members()), members())?;
        let is_between_walls =
            |x: &Vec3| planes.iter().all(|p| p.is_on_inner_side(x)) && bores.iter().all(|bore| bore.contains_point(x));
        grains.retain(|&i| is_between_walls(&frame.grains[i].x));
        let top = floor + highest_point(frame, &grains, &up, floor);
        let is_among_grains = |g: &Grain| (floor..=top).contains(&g.x.dot(&up)) && is_between_walls(&g.x);
        let unsupported: Vec<GrainId> = frame
            .grain_ids()
            .filter(|i| grains.binary_search(i).is_err() && is_among_grains(&frame.grains[*i]))
            .collect();
        grains.extend(unsupported);
        grains.sort_unstable();
        let members = || grains.iter().map(|&i| &frame.grains[i]);
        let centre = centre_of_mass(members());
        let stresses = grain_stresses(frame);
        Some(Bed {
            up,
            floor,
            area,
            height: 2.0 * (centre.dot(&up) - floor),
            moment: grains.iter().map(|&i| stresses[i.index()] * frame.grains[i].volume()).sum(),
            interval_moment: interval_moment(frame, &grains),
            grain_volume: members().map(|g| g.volume()).sum(),
            grains,
        })
    }

    /// Share of the volume between the walls up to [`Bed::height`] that grains would fill.
    pub fn solid_fraction(&self) -> f64 {
        self.grain_volume / (self.area * self.height)
    }

    /// Mean stress over the same volume, Pa, walls included: at rest its vertical component is half of weight / area.
    pub fn stress(&self) -> Mat3 {
        self.moment / (self.area * self.height)
    }

    /// A third of the trace of [`Bed::stress`], Pa, mean over the steps since the snapshot before; NaN without one.
    pub fn interval_pressure(&self) -> f64 {
        self.interval_moment / (self.area * self.height)
    }

    /// Ratio of the mean of the two horizontal stresses to the vertical one; NaN without stress.
    pub fn stress_ratio(&self) -> f64 {
        horizontal_stress(&self.moment, &self.up) / vertical_stress(&self.moment, &self.up)
    }

    /// The highest point of the bed's grains above the floor, m.
    pub fn top_height(&self, frame: &Frame) -> f64 {
        highest_point(frame, &self.grains, &self.up, self.floor)
    }

    /// `count` layers of equal thickness from the floor to `top` (m) above it, its highest point or beyond.
    ///
    /// Each grain adds its stress and velocity with the share of its volume that lies in the layer.
    pub fn layers(&self, frame: &Frame, count: usize, top: f64) -> Vec<Layer> {
        let (stresses, neighbours) = (grain_stresses(frame), neighbour_counts(frame));
        let members = || self.grains.iter().map(|&i| (i, &frame.grains[i]));
        let (width, up) = (top / count as f64, &self.up);
        let gravity = -Vec3::from(frame.meta.parameters.uniform_gravity).dot(up);
        let layer =
            |k: usize| Layer { lower: k as f64 * width, upper: (k + 1) as f64 * width, up: *up, ..Layer::default() };
        let mut layers: Vec<Layer> = (0..count).map(layer).collect();
        for (i, grain) in members() {
            let [low, high] = height_range(grain, up).map(|h| h - self.floor);
            let own_layer = (((grain.x.dot(up) - self.floor) / width).max(0.0) as usize).min(count - 1);
            layers[own_layer].grains += 1.0;
            layers[own_layer].neighbours += f64::from(neighbours[i.index()]);
            let (whole_volume, volume) = (volume_below(grain, up, f64::INFINITY), grain.volume());
            let density = grain.mass / volume;
            // Share of the grain below a height above the floor; a part below the floor is in the first layer.
            let share_below = |height: f64| volume_below(grain, up, height + self.floor) / whole_volume;
            let per_layer_volume = 1.0 / (self.area * width);
            let first = ((low / width).max(0.0) as usize).min(count - 1);
            let mut share_under_layer = 0.0;
            for layer in &mut layers[..first] {
                layer.weight += grain.mass * gravity / self.area;
            }
            for (k, layer) in layers.iter_mut().enumerate().skip(first) {
                let share_under_upper_face = if k + 1 == count { 1.0 } else { share_below(layer.upper) };
                let solid_part = (share_under_upper_face - share_under_layer) * volume * per_layer_volume;
                layer.nu += solid_part;
                layer.stress += solid_part * stresses[i.index()];
                layer.density += solid_part * density;
                layer.momentum += solid_part * density * grain.v;
                layer.flux += solid_part * density * grain.v * grain.v.transpose();
                layer.weight +=
                    (1.0 - share_below(0.5 * (layer.lower + layer.upper))) * grain.mass * gravity / self.area;
                share_under_layer = share_under_upper_face;
                if layer.upper >= high {
                    break;
                }
            }
        }
        layers
    }
}

/// (1/3) sum r.l / T of the contacts of some grains in the time T since the snapshot before, J; NaN without one.
fn interval_moment(frame: &Frame, grains: &[GrainId]) -> f64 {
    let SnapshotInterval { length, touched_pairs } = &frame.interval;
    let is_member = |body: &ContactBody| body.grain_id().is_some_and(|grain| grains.binary_search(&grain).is_ok());
    let virial: f64 = touched_pairs.iter().filter(|e| e.bodies.iter().any(is_member)).map(|e| e.virial).sum();
    if *length > 0.0 { virial / length / 3.0 } else { f64::NAN }
}

/// State in one layer of a bed, as sums over its grains: the mean of several states is the mean of each sum.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Layer {
    /// Height of the lower face above the floor, m.
    pub lower: f64,
    /// Height of the upper face above the floor, m.
    pub upper: f64,
    /// Normal of the floor, length 1.
    up: Vec3,
    /// Share of the layer that grains fill.
    pub nu: f64,
    /// Grains with their centre in the layer.
    pub grains: f64,
    /// Number of neighbours that the layer's grains touch with force, summed over the grains.
    neighbours: f64,
    /// Weight above the middle of the layer divided by the area, Pa: the vertical stress if walls carry nothing.
    pub weight: f64,
    /// Stress of the grains, Pa.
    stress: Mat3,
    /// Mass divided by the layer's volume, kg/m^3.
    pub density: f64,
    /// Momentum divided by the layer's volume, kg/(m^2 s).
    momentum: Vec3,
    /// sum m v (x) v divided by the layer's volume, Pa.
    flux: Mat3,
}

impl Layer {
    /// The mean of the same layer at several times.
    pub fn mean_over_times<'a>(times: impl ExactSizeIterator<Item = &'a Layer>) -> Layer {
        let share = 1.0 / times.len() as f64;
        times.fold(Layer::default(), |sum, layer| Layer {
            lower: layer.lower,
            upper: layer.upper,
            up: layer.up,
            nu: sum.nu + share * layer.nu,
            grains: sum.grains + share * layer.grains,
            neighbours: sum.neighbours + share * layer.neighbours,
            weight: sum.weight + share * layer.weight,
            stress: sum.stress + share * layer.stress,
            density: sum.density + share * layer.density,
            momentum: sum.momentum + share * layer.momentum,
            flux: sum.flux + share * layer.flux,
        })
    }

    /// Neighbours that a grain touches with force; NaN without grains.
    pub fn mean_coordination(&self) -> f64 {
        self.neighbours / self.grains
    }

    /// Mean weighted by mass, m/s; NaN without grains.
    pub fn velocity(&self) -> Vec3 {
        self.momentum / self.density
    }

    /// Stress of the contacts of the grains, Pa.
    pub fn contact_stress(&self) -> LayerStress {
        LayerStress::new(&self.stress, &self.up)
    }

    /// Stress of the motion about [`Layer::velocity`], Pa; NaN without grains.
    ///
    /// sum m v' (x) v' divided by the volume, v' = v - v_mean, of translations: no part of [`Layer::contact_stress`].
    pub fn kinetic_stress(&self) -> LayerStress {
        LayerStress::new(&(self.flux - self.momentum * self.velocity().transpose()), &self.up)
    }
}

/// Components of a stress with respect to the planes of a layer, Pa.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LayerStress {
    /// A third of the trace.
    pub pressure: f64,
    /// The component along the normal of the floor.
    pub vertical: f64,
    /// Mean of the two components along the floor.
    pub horizontal: f64,
    /// Stress across a plane of the layer, Pa: the force on the grains below by those above.
    pub shear: Vec3,
}

impl LayerStress {
    fn new(stress: &Mat3, up: &Vec3) -> LayerStress {
        let vertical = vertical_stress(stress, up);
        LayerStress {
            pressure: pressure(stress),
            vertical,
            horizontal: horizontal_stress(stress, up),
            shear: up * vertical - stress * up,
        }
    }
}

fn vertical_stress(stress: &Mat3, up: &Vec3) -> f64 {
    up.dot(&(stress * up))
}

fn horizontal_stress(stress: &Mat3, up: &Vec3) -> f64 {
    0.5 * (stress.trace() - vertical_stress(stress, up))
}

/// The highest point of some grains above a floor, m.
fn highest_point(frame: &Frame, grains: &[GrainId], up: &Vec3, floor: f64) -> f64 {
    grains.iter().map(|&i| height_range(&frame.grains[i], up)[1] - floor).fold(0.0, f64::max)
}

/// Number of sides of the polygon that approximates the section of a hollow cylinder; it has the same area, and the same
/// shape if a plate cuts it.
const POLYGON_SIDES: usize = 720;

/// Area of the section across `up` that the cell and the upright walls enclose, m^2; None if it is open, or a wall is
/// oblique.
fn section_area<'a>(
    planes: &[WallPlane],
    bores: &[CylinderBore],
    cell: &PeriodicCell,
    up: &Vec3,
    centre: &Vec3,
    grains: impl Iterator<Item = &'a Grain>,
) -> Option<f64> {
    let is_level = |plane: &&WallPlane| plane.normal.dot(up).abs() > 1.0 - UPRIGHT_TOLERANCE;
    let sides: Vec<(Vec3, f64)> =
        planes.iter().filter(|p| !is_level(p)).map(|p| (p.normal, p.offset - p.normal.dot(centre))).collect();
    let along_z = up.z.abs() > 1.0 - UPRIGHT_TOLERANCE;
    let is_inclined = |bore: &CylinderBore| bore.axis.cross(up).norm() > UPRIGHT_TOLERANCE;
    let has_oblique_wall =
        sides.iter().any(|(normal, _)| normal.dot(up).abs() > UPRIGHT_TOLERANCE) || bores.iter().any(is_inclined);
    if cell.is_periodic() && !along_z || has_oblique_wall {
        return None;
    }
    let first = if along_z { Vec3::x() } else { up.cross(&Vec3::z()).normalize() };
    let axes = [first, if along_z { Vec3::y() } else { up.cross(&first) }];
    // The section of a full container is at most a few times the extent of the grains.
    let grain_extent = grains.map(|g| (g.x - centre).norm() + g.bounding_radius()).fold(0.0, f64::max);
    let walls = sides.iter().map(|(_, offset)| offset.abs()).chain(bores.iter().map(|bore| bore.radius));
    let outer_length = 16.0 * walls.fold(grain_extent, f64::max);
    let mut polygon = match bores.iter().min_by(|a, b| a.radius.total_cmp(&b.radius)) {
        Some(bore) => {
            let sector_angle = std::f64::consts::TAU / POLYGON_SIDES as f64;
            let radius = bore.radius * (sector_angle / sector_angle.sin()).sqrt();
            let middle = axes.map(|axis| axis.dot(&(bore.x - centre)));
            let corner = |k: usize| {
                [sector_angle * k as f64, sector_angle * k as f64 - 0.25 * std::f64::consts::TAU].map(f64::cos)
            };
            (0..POLYGON_SIDES).map(corner).map(|c| [0, 1].map(|k| middle[k] + radius * c[k])).collect()
        }
        None => {
            let half = [0, 1].map(|axis| cell.periods[axis].map_or(outer_length, |period| 0.5 * period));
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| [x * half[0], y * half[1]]).to_vec()
        }
    };
    for (normal, offset) in sides {
        let inner_distance = |p: &[f64; 2]| (axes[0] * p[0] + axes[1] * p[1]).dot(&normal) - offset;
        polygon = cut_polygon(&polygon, inner_distance, |p, q, share| [0, 1].map(|k| p[k] + share * (q[k] - p[k])));
    }
    let is_closed = |p: &[f64; 2]| (0..2).all(|k| cell.periods[k].is_some() || p[k].abs() < outer_length);
    let doubled_triangle = |k: usize| {
        let ([x, y], [u, v]) = (polygon[k], polygon[(k + 1) % polygon.len()]);
        x * v - u * y
    };
    polygon.iter().all(is_closed).then(|| 0.5 * (0..polygon.len()).map(doubled_triangle).sum::<f64>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::derive::fragments::find_fragments;
    use crate::frame::{Wall, WallShape};
    use crate::samples::Scene;
    use crate::shapes::{Hollow, SolidShape};
    use nalgebra::UnitQuaternion;

    fn bed(scene: &Scene) -> Option<Bed> {
        let frame = scene.frame();
        Bed::from_frame(&frame, &find_fragments(&frame))
    }

    fn assert_close(found: f64, expected: f64) {
        // Some roundings of sums of some hundred numbers of order 1.
        assert!((found - expected).abs() <= 1e-12 * expected.abs(), "{found:e} is not {expected:e}");
    }

    /// Three by two columns of `high` bodies of size 1 that fill the corner between plates, each pushed by the weight above
    /// it. `sides`: plates at +x, -x, +y and -y. `turn`: rotation of the whole scene about the origin.
    fn columns(high: usize, cubes: bool, sides: [bool; 4], turn: UnitQuaternion<f64>) -> Scene {
        let mut scene = Scene::default();
        let at = |x: [f64; 3]| (turn * Vec3::from(x)).into();
        let down = turn * Vec3::new(0.0, 0.0, -2.0);
        scene.snapshot.meta.parameters.uniform_gravity = down.into();
        let floor = scene.plate(at([1.5, 1.0, -0.1]), [5.0, 5.0, 0.1]);
        let walls = [([3.1, 1.0, 9.0], 0), ([-0.1, 1.0, 9.0], 0), ([1.5, 2.1, 9.0], 1), ([1.5, -0.1, 9.0], 1)];
        for ((x, axis), _) in walls.iter().zip(sides).filter(|(_, there)| *there) {
            let mut half = [9.0; 3];
            half[*axis] = 0.1;
            scene.plate(at(*x), half);
        }
        for (i, j) in (0..3).flat_map(|i| (0..2).map(move |j| (f64::from(i) + 0.5, f64::from(j) + 0.5))) {
            let mut below = floor;
            for k in 0..high {
                let x = at([i, j, k as f64 + 0.5]);
                let body = if cubes { scene.cube(x, 0.5) } else { scene.grain(x, 0.5) };
                let weight = -down * (high - k) as f64 * scene.snapshot.bodies.body_mass[body];
                scene.contact_at(body, below, at([i, j, k as f64]), weight);
                below = body;
            }
        }
        let [x, y, z] = [turn.i, turn.j, turn.k];
        scene.snapshot.bodies.body_q.iter_mut().for_each(|q| *q = [turn.w, x, y, z]);
        scene
    }

    fn turns() -> [UnitQuaternion<f64>; 3] {
        let tilted = UnitQuaternion::from_euler_angles(0.3, -0.7, 1.1);
        [UnitQuaternion::identity(), tilted, UnitQuaternion::from_euler_angles(std::f64::consts::PI, 0.0, 0.4)]
    }

    #[test]
    fn a_bed_between_walls_has_their_area_and_half_its_weight_as_stress() {
        for turn in turns() {
            for (cubes, nu) in [(false, std::f64::consts::PI / 6.0), (true, 1.0)] {
                let found = bed(&columns(5, cubes, [true; 4], turn)).unwrap();
                assert!((found.up - turn * Vec3::z()).norm() < 1e-14 && found.floor.abs() < 1e-14);
                for (value, expected) in [(found.area, 6.0), (found.height, 5.0), (found.solid_fraction(), nu)] {
                    assert_close(value, expected);
                }
                // The weight of five, nu times 1 each, over an area of 1.
                assert_close(vertical_stress(&found.stress(), &found.up), 0.5 * 5.0 * nu * 2.0);
                assert!(found.stress_ratio().abs() < 1e-14);
            }
        }
    }

    #[test]
    fn a_bed_has_a_mean_pressure_of_the_steps_since_the_snapshot_before() {
        // Six columns on an area of 6 m^2; 2 J s of each of two pairs in 4 s, one of them at a wall, divided by the
        // volume of 5 m height.
        let mut scene = columns(5, true, [true; 4], UnitQuaternion::identity());
        let grain = scene.snapshot.contacts.contact_body[0][0];
        let wall = scene.snapshot.bodies.body_driven.iter().position(|driven| *driven != 0).unwrap() as u32;
        let other = scene.snapshot.contacts.contact_body.iter().flatten().find(|b| **b != grain && **b != wall);
        let pairs = [([grain, wall], 2.0), ([grain, *other.unwrap()], 2.0)];
        assert!(bed(&scene).unwrap().interval_pressure().is_nan());
        scene.snapshot.meta.time = 4.0;
        scene.since(0.0, &pairs);
        assert_close(bed(&scene).unwrap().interval_pressure(), 1.0 / 3.0 / 30.0);
    }

    #[test]
    fn layers_have_a_mean_over_several_times() {
        // Per m^3 one grain of `m` kg at `v`, of as many neighbours.
        let at = |m: f64, v: f64| Layer {
            upper: 2.0,
            up: Vec3::z(),
            nu: m,
            grains: 1.0,
            neighbours: v,
            density: m,
            momentum: Vec3::z() * m * v,
            flux: Mat3::from_diagonal(&(Vec3::z() * m * v * v)),
            ..Layer::default()
        };
        let empty = Layer { upper: 2.0, up: Vec3::z(), ..Layer::default() };
        let mean = Layer::mean_over_times([at(0.75, 2.0), at(0.25, 6.0), empty, empty].iter());
        assert_eq!((mean.upper, mean.nu, mean.grains, mean.density), (2.0, 0.25, 0.5, 0.25));
        // Neighbours are a mean over grains, velocities one weighted by mass: that of 3 kg at 2 m/s and 1 kg at 6 m/s
        // is 3 m/s.
        assert_eq!((mean.mean_coordination(), mean.velocity()), (4.0, Vec3::z() * 3.0));
        // Motion with the mean velocity has no stress: 0.25 kg/m^3 of variance (3 1^2 + 1 3^2) / 4 = 3.
        assert_eq!((mean.kinetic_stress().vertical, mean.kinetic_stress().pressure), (0.75, 0.25));
        assert_eq!(at(0.75, 2.0).kinetic_stress().vertical, 0.0);
        assert!(
            empty.mean_coordination().is_nan()
                && empty.velocity().x.is_nan()
                && empty.kinetic_stress().pressure.is_nan()
        );
    }

    #[test]
    fn what_nothing_holds_is_of_the_bed_where_it_is_among_the_others() {
        let mut scene = columns(3, false, [true; 4], UnitQuaternion::identity());
        let held = bed(&scene).unwrap();
        // In the bed, above it, under the floor and beyond a side.
        for x in [[1.0, 1.0, 1.5], [1.0, 1.0, 3.1], [1.0, 1.0, -2.0], [3.5, 1.0, 1.5]] {
            scene.grain(x, 0.125);
        }
        let found = bed(&scene).unwrap();
        assert_eq!((found.area, found.floor, found.moment), (held.area, held.floor, held.moment));
        assert_eq!(found.grains.len(), held.grains.len() + 1);
        assert_close(found.grain_volume, held.grain_volume + std::f64::consts::PI / 384.0);
    }

    #[test]
    fn a_lid_is_no_floor_however_it_strikes() {
        let mut scene = columns(3, true, [true; 4], UnitQuaternion::identity());
        let (lid, top) = (scene.plate([1.5, 1.0, 3.1], [5.0, 5.0, 0.1]), 5 + 2);
        scene.contact_at(top, lid, [0.5, 0.5, 3.0], Vec3::new(0.0, 0.0, -1e6));
        let found = bed(&scene).unwrap();
        assert_eq!((found.up, found.floor), (Vec3::z(), 0.0));
    }

    #[test]
    fn layers_hold_what_lies_in_them() {
        for turn in turns() {
            let frame = columns(5, true, [true; 4], turn).frame();
            let found = Bed::from_frame(&frame, &find_fragments(&frame)).unwrap();
            // Layers cut the cubes; stress is that of each cube: half of what it bears and what bears it.
            for count in [1, 5, 7, 20] {
                for layer in found.layers(&frame, count, found.top_height(&frame)) {
                    let middle = 0.5 * (layer.lower + layer.upper);
                    assert_close(layer.nu, 1.0);
                    assert_close(layer.weight, 2.0 * (5.0 - middle));
                    let cube = middle.floor();
                    if count == 5 {
                        let stress = layer.contact_stress();
                        assert_close(stress.vertical, 2.0 * (4.5 - cube));
                        assert_close(stress.pressure, stress.vertical / 3.0);
                        assert_eq!(
                            (layer.grains, layer.mean_coordination()),
                            (6.0, if cube == 4.0 { 1.0 } else { 2.0 })
                        );
                    }
                }
            }
        }
        // A layer of half a diameter has half of each sphere.
        let frame = columns(4, false, [true; 4], UnitQuaternion::identity()).frame();
        let found = Bed::from_frame(&frame, &find_fragments(&frame)).unwrap();
        for layer in found.layers(&frame, 8, found.top_height(&frame)) {
            assert_close(layer.nu, std::f64::consts::PI / 6.0);
        }
        let thin: f64 = found.layers(&frame, 13, found.top_height(&frame)).iter().map(|layer| layer.nu).sum();
        assert_close(thin / 13.0, std::f64::consts::PI / 6.0);
    }

    #[test]
    fn a_column_on_a_slope_is_sheared_by_its_weight_along_it() {
        let mut scene = Scene::default();
        let down = Vec3::new(1.0, 0.0, -2.0);
        scene.snapshot.meta.parameters.uniform_gravity = down.into();
        (scene.snapshot.meta.parameters.xperiode, scene.snapshot.meta.parameters.yperiode) = (Some(1.0), Some(1.0));
        let mut below = scene.plate([0.0, 0.0, -0.1], [5.0, 5.0, 0.1]);
        for k in 0..5 {
            let cube = scene.cube([0.0, 0.0, f64::from(k) + 0.5], 0.5);
            scene.snapshot.bodies.body_v[cube] = [f64::from(k), 0.0, 0.0];
            scene.contact_at(cube, below, [0.0, 0.0, f64::from(k)], -down * f64::from(5 - k));
            below = cube;
        }
        let frame = scene.frame();
        let layers = Bed::from_frame(&frame, &find_fragments(&frame))
            .map(|bed| bed.layers(&frame, 5, bed.top_height(&frame)))
            .unwrap();
        for (k, layer) in layers.iter().enumerate() {
            // Half of what it bears and half of what bears it.
            let borne = 4.5 - k as f64;
            let stress = layer.contact_stress();
            assert!((stress.shear - Vec3::x() * borne).norm() < 1e-14 && (stress.vertical - 2.0 * borne).abs() < 1e-14);
            assert!((layer.velocity() - Vec3::x() * k as f64).norm() < 1e-14, "{layer:?}");
            assert!(layer.kinetic_stress().pressure.abs() < 1e-14, "a layer of one cube: {layer:?}");
        }
    }

    #[test]
    fn what_walls_do_not_close_a_period_may() {
        let identity = UnitQuaternion::identity();
        assert!(bed(&columns(3, false, [true, true, true, false], identity)).is_none());
        assert!(bed(&columns(3, false, [false; 4], identity)).is_none());
        let mut scene = columns(3, false, [false, false, true, true], identity);
        scene.snapshot.meta.parameters.xperiode = Some(3.0);
        assert_close(bed(&scene).unwrap().area, 6.0);
        let mut scene = columns(3, false, [false; 4], identity);
        (scene.snapshot.meta.parameters.xperiode, scene.snapshot.meta.parameters.yperiode) = (Some(3.0), Some(2.5));
        // Inclined, as on a slope: layers are those of the floor.
        scene.snapshot.meta.parameters.uniform_gravity = [1.0, 0.0, -2.0];
        let found = bed(&scene).unwrap();
        assert_close(found.area, 7.5);
        assert_eq!(found.up, Vec3::z());
        assert_close(found.height, 3.0);
    }

    #[test]
    fn what_flies_or_rests_on_nothing_is_no_bed() {
        let mut scene = columns(3, false, [true; 4], UnitQuaternion::identity());
        scene.grain([1.0, 1.0, 8.0], 0.5);
        let found = bed(&scene).unwrap();
        assert_eq!(found.grains.len(), 18);
        assert_close(found.height, 3.0);
        scene.snapshot.meta.parameters.uniform_gravity = [0.0; 3];
        assert!(bed(&scene).is_none());
        let mut falling = Scene::default();
        falling.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -1.0];
        falling.grain([0.0; 3], 1.0);
        assert!(bed(&falling).is_none());
        // A floor of fixed spheres: level, at the lowest point of a grain.
        let mut rough = Scene::default();
        rough.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -1.0];
        (rough.snapshot.meta.parameters.xperiode, rough.snapshot.meta.parameters.yperiode) = (Some(2.0), Some(2.0));
        let (held, grain) = (rough.grain([0.0; 3], 0.5), rough.grain([0.0, 0.0, 1.0], 0.5));
        rough.snapshot.bodies.body_driven[held] = cd_formats::snapshot::DRIVEN_ALL;
        rough.push(grain, held, 1.0);
        let found = bed(&rough).unwrap();
        assert_eq!((found.floor, found.height, found.area), (0.5, 1.0, 4.0));
    }

    #[test]
    fn a_hollow_cylinder_encloses_a_region() {
        let hollow = |radius: f64, axis: Vec3| {
            let mut frame = columns(3, false, [false; 4], UnitQuaternion::identity()).frame();
            let hollow = Some(Hollow { radius, half_height: 50.0 });
            let shape = WallShape::Polyhedron(SolidShape { hollow, ..Default::default() }.into());
            let rotation = UnitQuaternion::rotation_between(&Vec3::z(), &axis).unwrap();
            let x = Vec3::new(1.5, 1.0, 0.0);
            frame.walls.push(Wall { id: 99, x, v: None, rotation, shape });
            Bed::from_frame(&frame, &find_fragments(&frame)).map(|bed| bed.area)
        };
        // The corners of the six columns are 1.803 from the axis.
        assert_close(hollow(1.9, Vec3::z()).unwrap(), 3.61 * std::f64::consts::PI);
        // Grains are outside of one, another lies on its side, and they are a heap in a wide one.
        assert!([(1.0, Vec3::z()), (9.0, Vec3::x()), (4.0, Vec3::z())].map(|(r, axis)| hollow(r, axis)) == [None; 3]);
        // A plate cuts off a segment 1.2 from the axis, in which no centre is.
        let mut frame = columns(3, false, [true, false, false, false], UnitQuaternion::identity()).frame();
        let square = 4.24f64;
        let hollow = Some(Hollow { radius: square.sqrt(), half_height: 50.0 });
        let shape = WallShape::Polyhedron(SolidShape { hollow, ..Default::default() }.into());
        let x = Vec3::new(1.8, 1.0, 0.0);
        frame.walls.push(Wall { id: 99, x, v: None, rotation: UnitQuaternion::identity(), shape });
        let area = Bed::from_frame(&frame, &find_fragments(&frame)).unwrap().area;
        let segment = square * (1.2 / square.sqrt()).acos() - 1.2 * (square - 1.44).sqrt();
        // A polygon of 720 sides instead of the circle.
        assert!((area - std::f64::consts::PI * square + segment).abs() < 1e-4, "{area}");
    }

    #[test]
    fn the_lower_end_of_a_hollow_cylinder_is_a_floor() {
        let scene = columns(3, false, [false; 4], UnitQuaternion::identity());
        let mut frame = scene.frame();
        let hollow = Some(Hollow { radius: 1.9, half_height: 5.0 });
        let shape = WallShape::Polyhedron(SolidShape { hollow, ..Default::default() }.into());
        let x = Vec3::new(1.5, 1.0, 5.0);
        // The shape replaces the plate.
        frame.walls[0] = Wall { x, rotation: UnitQuaternion::identity(), shape, ..frame.walls[0].clone() };
        let found = Bed::from_frame(&frame, &find_fragments(&frame)).unwrap();
        assert_eq!((found.up, found.floor), (Vec3::z(), 0.0));
        assert_close(found.area, 3.61 * std::f64::consts::PI);
        assert_close(found.height, 3.0);
    }

    #[test]
    fn an_oblique_wall_makes_no_bed() {
        let mut scene = columns(3, false, [true, false, true, true], UnitQuaternion::identity());
        let (sin, cos) = 0.05f64.sin_cos();
        // Through the foot of the open side, leaning outwards.
        let wall = scene.plate([-0.1, 0.0, 0.0], [0.1, 30.0, 30.0]);
        scene.snapshot.bodies.body_q[wall] = [cos, 0.0, -sin, 0.0];
        assert!(bed(&scene).is_none());
        // Elsewhere it bounds nothing.
        scene.snapshot.bodies.body_x[wall] = [-80.0, 0.0, 0.0];
        scene.plate([-0.1, 1.0, 9.0], [0.1, 9.0, 9.0]);
        assert_close(bed(&scene).unwrap().area, 6.0);
    }
}
