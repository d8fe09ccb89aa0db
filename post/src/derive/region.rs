//! Region over which solid fraction, stress and coordination are averaged, and its contents.
//!
//! | scene | region |
//! |---|---|
//! | grains that walls close in, without uniform gravity or up to a lid | between the walls |
//! | grains under uniform gravity that fill the space between side walls or periods | between the walls up to the bed's surface |
//! | a scene that repeats without a bed | the cell, from the lowest to the highest point of the grains |
//! | else | the convex hull of the largest remnant of touching grains |
//!
//! or a [`Probe`] that the user gives.

use cd_formats::geometry::convex_region::ConvexRegion;

use crate::derive::enclosure::{EnclosedRegion, GrainEnclosure};
use crate::derive::energy::{PairSummation, external_fields, gravitational_energy, self_gravity_constant};
use crate::derive::fragments::Fragment;
use crate::derive::gravity::attraction_between;
use crate::derive::hull;
use crate::derive::motion::RotatingAxes;
use crate::derive::probe::{Probe, region_kind, share_of_grain};
use crate::derive::region_kind::RegionKind;
use crate::frame::{ContactBody, Frame, Grain, GrainId, SnapshotInterval, TouchedPair};
use crate::math::{Mat3, Vec3};

/// Least share of the mass or of the grains of the largest remnant: a smaller fragment is a clump of a
/// cloud, and all grains count instead.
const MIN_REMNANT_SHARE: f64 = 0.1;

/// Grains, walls and volume of a region of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    pub kind: RegionKind,
    /// Volume, m^3.
    pub volume: f64,
    /// Grains with their centre inside, rising.
    pub members: Vec<GrainId>,
    /// Region given by the user, if any.
    probe: Option<PlacedProbe>,
}

/// Region given by the user, in one frame.
#[derive(Debug, Clone, PartialEq)]
struct PlacedProbe {
    shape: ConvexRegion,
    /// Sums of whole periods that shift grains of the cell into the shape, m.
    shifts: Vec<Vec3>,
}

impl Region {
    /// Returns the region that fits the scene; `fragments`: all fragments of the frame.
    ///
    /// Walls bound it where their faces are, see [`GrainEnclosure`]. The grains considered are the fragments that a wall touches
    /// with force if these have half of the mass or of the grains, else all grains. Under uniform gravity the region ends at
    /// the mean plane of their surface, unless a lid is less than a mean diameter above; without a plate below, it begins at
    /// their lowest point. If walls and periods leave a side open, if the grains are a heap that does not fill the space
    /// from side to side, or if nothing touches walls in a scene with self-gravity, the region is the hull of the largest
    /// remnant (of those that a wall touches, if any). It is the hull of all grains if that fragment has a single grain among
    /// others or less than a tenth of the mass and of the grains.
    pub fn from_frame(frame: &Frame, fragments: &[Fragment]) -> Region {
        if frame.grains.is_empty() {
            return Region { kind: RegionKind::None, volume: f64::NAN, members: Vec::new(), probe: None };
        }
        match GrainEnclosure::from_frame(frame, fragments).and_then(GrainEnclosure::into_region) {
            Some(EnclosedRegion { kind, volume, members }) => Region { kind, volume, members, probe: None },
            None => aggregate_region(frame, fragments),
        }
    }

    /// Returns the region given by the user. A layer without walls or periods around it, and a shape over more than
    /// `MAX_REGION_IMAGES` cells, are [`RegionKind::None`].
    pub fn from_probe(frame: &Frame, fragments: &[Fragment], probe: &Probe) -> Region {
        let placed = match probe.placed_shape(frame, fragments) {
            Some(ConvexRegion::Layer { from, to, .. }) => {
                GrainEnclosure::from_frame(frame, fragments).and_then(|e| e.into_layer(from, to))
            }
            shape => shape.map(|shape| (shape, shape.volume())),
        };
        let Some((shape, volume)) = placed else {
            return Region { kind: RegionKind::None, volume: f64::NAN, members: Vec::new(), probe: None };
        };
        let Some(shifts) = image_shifts(frame, &shape) else {
            return Region { kind: RegionKind::None, volume: f64::NAN, members: Vec::new(), probe: None };
        };
        let is_inside = |x: &Vec3| shifts.iter().any(|shift| shape.contains(&(x + shift)));
        let members = frame.grain_ids().filter(|&i| is_inside(&frame.grains[i].x)).collect();
        Region { kind: region_kind(&shape), volume, members, probe: Some(PlacedProbe { shape, shifts }) }
    }

    /// Whether a grain has its centre inside.
    fn is_member(&self, grain: GrainId) -> bool {
        self.members.binary_search(&grain).is_ok()
    }

    fn member_grains<'a>(&'a self, frame: &'a Frame) -> impl Iterator<Item = &'a Grain> {
        self.members.iter().map(|&i| &frame.grains[i])
    }

    /// Grains with the share of their volume that counts: the share within a probe, else all of each member's volume.
    fn volume_shares(&self, frame: &Frame) -> Vec<(GrainId, f64)> {
        let Some(probe) = &self.probe else { return self.members.iter().map(|&i| (i, 1.0)).collect() };
        let share = |grain: &Grain| -> f64 {
            probe.shifts.iter().map(|shift| share_of_grain(&probe.shape, &grain.moved_by(*shift))).sum()
        };
        let all = frame.grain_ids().map(|i| (i, share(&frame.grains[i])));
        all.filter(|(_, share)| *share > 0.0).collect()
    }

    /// Share of the volume that grains fill.
    pub fn solid_fraction(&self, frame: &Frame) -> f64 {
        self.volume_shares(frame).into_iter().map(|(i, share)| share * frame.grains[i].volume()).sum::<f64>()
            / self.volume
    }

    /// Mean stress, Pa: (1/V) sum f ⊗ l over the contacts of its grains, walls too; > 0 in compression.
    ///
    /// f is the force on the candidate, l the branch from the antagonist's centre to the candidate's, at a wall to or from
    /// the point of contact. Over grains between plates at rest, the stress is the force on a plate divided by its
    /// area. In a probe each contact counts by the share of its branch inside. Source: Love (1892), Weber (1966);
    /// shares: Babic (1997), a box weight along the branch.
    pub fn stress(&self, frame: &Frame) -> Mat3 {
        let end = |body: ContactBody, image: Vec3, point: Vec3| match body {
            ContactBody::Grain(i) => frame.grains[i].x_contact + image,
            ContactBody::Wall(_) => point,
        };
        let moment = |contact: &crate::frame::Contact| -> Mat3 {
            match &self.probe {
                Some(probe) => {
                    let to = end(contact.candidate, Vec3::zeros(), contact.point);
                    let from = end(contact.antagonist, contact.image, contact.point);
                    let share_inside = |shift: &Vec3| probe.shape.share_of_segment(&(from + shift), &(to + shift));
                    let share: f64 = probe.shifts.iter().map(share_inside).sum();
                    share * contact.force * (to - from).transpose()
                }
                None => {
                    let on_members = contact.on_grains().filter(|(i, ..)| self.is_member(*i));
                    on_members
                        .map(|(i, force, image)| {
                            force * (frame.grains[i].x_contact + image - contact.point).transpose()
                        })
                        .sum()
                }
            }
        };
        frame.active_contacts().map(moment).sum::<Mat3>() / self.volume
    }

    /// A third of the trace of [`Region::stress`], Pa, mean over the steps since the snapshot before. NaN without an
    /// interval and in a probe, as snapshots do not contain the positions at which forces acted in an interval.
    pub fn interval_pressure(&self, frame: &Frame) -> f64 {
        let SnapshotInterval { length, touched_pairs } = &frame.interval;
        if self.probe.is_some() || *length <= 0.0 {
            return f64::NAN;
        }
        // Half of the virial counts for a pair with one grain inside.
        let virial = |pair: &TouchedPair| {
            let grains = || pair.bodies.iter().filter_map(|body| body.grain_id());
            let inside = grains().filter(|&i| self.is_member(i)).count();
            pair.virial * inside as f64 / grains().count() as f64
        };
        touched_pairs.iter().map(virial).sum::<f64>() / length / (3.0 * self.volume)
    }

    /// Velocity of the centre of mass of the region's contents, in a deforming cell about the affine field, m/s.
    fn mean_velocity(&self, frame: &Frame, shares: &[(GrainId, f64)]) -> Vec3 {
        let moment =
            |(i, share): &(GrainId, f64)| share * frame.grains[*i].mass * frame.local_velocity(&frame.grains[*i]);
        let mass = |(i, share): &(GrainId, f64)| share * frame.grains[*i].mass;
        shares.iter().map(moment).sum::<Vec3>() / shares.iter().map(mass).sum::<f64>()
    }

    /// Kinetic stress, Pa: (1/V) sum m v' ⊗ v', v' = v - v_com of the region's contents; in a deforming cell v' is the
    /// velocity about the affine field.
    ///
    /// It is not included in [`Region::stress`]; a third of its trace is the pressure of the motion.
    pub fn kinetic_stress(&self, frame: &Frame) -> Mat3 {
        let shares = self.volume_shares(frame);
        let mean = self.mean_velocity(frame, &shares);
        let moment = |&(i, share): &(GrainId, f64)| {
            let grain = &frame.grains[i];
            let v = frame.local_velocity(grain) - mean;
            share * grain.mass * v * v.transpose()
        };
        shares.iter().map(moment).sum::<Mat3>() / self.volume
    }

    /// Pressure that balances the loads at rest, Pa: -(1/3V) (sum (x_i - x_com).F_i + sum (p - x_com).f).
    ///
    /// F_i is the sum of the forces on a grain except those of contacts: self-gravity, also of grains outside, uniform
    /// gravity, fields; f is the force of a wall at the point p. Self-gravity is homogeneous of degree -2 in the distances,
    /// so its sum over pairs inside is their potential energy W itself and its share |W| / 3V, for any arrangement. Uniform
    /// gravity acts at the centre of mass, and so adds nothing. In rotating axes Coriolis' force counts, too. NaN in a
    /// periodic scene, where the bodies' own images support them too, and in a probe, at whose border contacts are cut.
    ///
    /// At rest this equals the pressure of [`Region::stress`] exactly: the forces on each grain add up to zero. In steady
    /// rotation, the pressure of the contacts is this value less the pressure of the motion. Forces imposed on single
    /// grains are not in a snapshot and are not counted.
    ///
    /// Source: the virial theorem of Clausius (1870).
    pub fn virial_pressure(&self, frame: &Frame, summation: PairSummation) -> f64 {
        if frame.cell().is_periodic() || self.probe.is_some() {
            return f64::NAN;
        }
        let mass: f64 = self.member_grains(frame).map(|g| g.mass).sum();
        let com = self.member_grains(frame).map(|g| g.mass * g.x_contact).sum::<Vec3>() / mass;
        let self_gravity = self_gravity_constant(frame).map_or(0.0, |constant| {
            let inner =
                gravitational_energy(self.member_grains(frame).map(|g| (g.x_contact, g.mass)), constant, summation);
            let others: Vec<(Vec3, f64)> = frame
                .grain_ids()
                .filter(|&i| !self.is_member(i))
                .map(|i| (frame.grains[i].x_contact, frame.grains[i].mass))
                .collect();
            let members: Vec<(Vec3, f64)> = self.member_grains(frame).map(|g| (g.x_contact - com, g.mass)).collect();
            inner + constant * attraction_between(&members, &com, &others)
        });
        let on_members = |contact: &crate::frame::Contact| -> f64 {
            let own = contact.on_grains().filter(|(i, ..)| self.is_member(*i));
            own.map(|(_, force, image)| (contact.point - image - com).dot(&force)).sum()
        };
        let walls: f64 = frame.active_contacts().filter(|contact| contact.grain_pair().is_none()).map(on_members).sum();
        let fields = external_fields(frame);
        let rate = RotatingAxes::from_frame(frame).rotation_rate();
        let acceleration = |g: &Grain| -> Vec3 {
            let at_rest: Vec3 = fields.iter().map(|field| field.acceleration_and_potential(&g.x_contact).0).sum();
            at_rest - 2.0 * rate.cross(&g.v)
        };
        let fields: f64 = self.member_grains(frame).map(|g| g.mass * (g.x_contact - com).dot(&acceleration(g))).sum();
        -(self_gravity + fields + walls) / (3.0 * self.volume)
    }
}

/// Sums of whole periods that shift grains of the cell, or contacts of these, into a shape. None for more than
/// `MAX_REGION_IMAGES`.
fn image_shifts(frame: &Frame, shape: &ConvexRegion) -> Option<Vec<Vec3>> {
    // Branches reach from a grain of the cell to the centre of a neighbour.
    let reach = 2.0 * frame.grains.iter().map(Grain::bounding_radius).fold(0.0, f64::max);
    shape.image_shifts(frame.cell().periods, reach)
}

/// Hull of the largest remnant, or of all grains if that fragment is not a remnant.
fn aggregate_region(frame: &Frame, fragments: &[Fragment]) -> Region {
    let mut touched = vec![false; frame.grains.len()];
    let walls = frame.active_contacts().filter(|contact| contact.grain_pair().is_none());
    walls.flat_map(|contact| contact.on_grains()).for_each(|(i, ..)| touched[i.index()] = true);
    let touching_wall = fragments.iter().find(|fragment| fragment.grains.iter().any(|&i| touched[i.index()]));
    let largest = touching_wall.or(fragments.first());
    let is_remnant = |fragment: &&Fragment| {
        let is_single = fragment.grains.len() == 1 && frame.grains.len() > 1;
        let share = fragment.grains.len() as f64 / frame.grains.len() as f64;
        !is_single && (fragment.sums.mass >= MIN_REMNANT_SHARE * frame.total_mass() || share >= MIN_REMNANT_SHARE)
    };
    let (kind, members) = match largest.filter(is_remnant) {
        Some(fragment) => (RegionKind::LargestGroup, fragment.grains.clone()),
        None => (RegionKind::AllGrains, frame.grain_ids().collect()),
    };
    let grains = || members.iter().map(|&i| &frame.grains[i]);
    let balls = grains().flat_map(Grain::balls).chain(grains().flat_map(Grain::vertices).map(|v| (v, 0.0)));
    Region { kind, volume: hull::hull_volume(&balls.collect::<Vec<_>>()), members, probe: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    use crate::derive::fragments::find_fragments;
    use crate::derive::{MeasurementOptions, Row};
    use crate::frame::{Wall, WallShape};
    use crate::samples::Scene;
    use crate::shapes::{Hollow, SolidShape};
    use nalgebra::UnitQuaternion;

    #[track_caller]
    fn assert_close(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance * expected.abs(), "{found:e} is not {expected:e}");
    }

    fn region(frame: &Frame) -> Region {
        Region::from_frame(frame, &find_fragments(frame))
    }

    fn row(scene: &Scene) -> Row {
        Row::from_frame(&scene.frame())
    }

    fn probed(scene: &Scene, probe: &str) -> Row {
        let choices = MeasurementOptions { region: Some(probe.parse().unwrap()), ..MeasurementOptions::default() };
        Row::with_options(&scene.frame(), &choices)
    }

    /// Simple cubic lattice of touching spheres of radius `r` from the origin, whose contacts carry the forces of the
    /// pressures `p` on squares of side 2 r.
    fn lattice(scene: &mut Scene, counts: [usize; 3], r: f64, p: [f64; 3]) {
        let first = scene.snapshot.bodies.body_id.len();
        let number = |x: [usize; 3]| first + x[0] + counts[0] * (x[1] + counts[1] * x[2]);
        let all = || {
            (0..counts.iter().product())
                .map(|k: usize| [k % counts[0], k / counts[0] % counts[1], k / counts[0] / counts[1]])
        };
        for x in all() {
            scene.grain(x.map(|i| r * (2 * i + 1) as f64), r);
        }
        for x in all() {
            for axis in (0..3).filter(|&axis| x[axis] + 1 < counts[axis]) {
                let mut next = x;
                next[axis] += 1;
                scene.push(number(next), number(x), p[axis] * 4.0 * r * r);
            }
        }
    }

    /// Plates that compress such a lattice, on those of `sides`: low and high x, y, z.
    fn plates(scene: &mut Scene, counts: [usize; 3], r: f64, p: [f64; 3], sides: &[usize]) {
        let size = counts.map(|count| 2.0 * r * count as f64);
        for &side in sides {
            let (axis, high) = (side / 2, side % 2 == 1);
            let sign = if high { 1.0 } else { -1.0 };
            let mut centre = size.map(|x| 0.5 * x);
            centre[axis] = if high { size[axis] + r } else { -r };
            let mut half = [9.0 * size.iter().copied().fold(0.0, f64::max); 3];
            half[axis] = r;
            let plate = scene.plate(centre, half);
            for k in 0..counts.iter().product() {
                let x = [k % counts[0], k / counts[0] % counts[1], k / counts[0] / counts[1]];
                if x[axis] == if high { counts[axis] - 1 } else { 0 } {
                    let mut point = x.map(|i| r * (2 * i + 1) as f64);
                    point[axis] += sign * r;
                    let force = Vec3::ith(axis, -sign * p[axis] * 4.0 * r * r);
                    scene.contact_at(k, plate, point, force);
                }
            }
        }
    }

    const COUNTS: [usize; 3] = [5, 4, 6];

    #[test]
    fn between_six_plates_stress_is_force_over_area() {
        for scale in [1e-3, 1.0, 1e3] {
            let (r, p) = (0.5 * scale, [64.0, 50.0, 80.0]);
            let mut scene = Scene::default();
            lattice(&mut scene, COUNTS, r, p);
            plates(&mut scene, COUNTS, r, p, &[0, 1, 2, 3, 4, 5]);
            // One that has left the box touches a plate from outside, and another flies off.
            let gone = scene.grain([-3.0 * r, r, r], r);
            scene.contact_at(gone, COUNTS.iter().product(), [-2.0 * r, r, r], -Vec3::x());
            scene.grain([0.0, 0.0, 900.0 * r], r);
            let found = row(&scene);
            assert_eq!(found.region, RegionKind::Walls.column_value());
            for (value, expected) in [
                (found.region_volume, 120.0 * 8.0 * r.powi(3)),
                (found.nu, PI / 6.0),
                (found.sigma_xx, p[0]),
                (found.sigma_yy, p[1]),
                (found.sigma_zz, p[2]),
                (found.pressure, (p[0] + p[1] + p[2]) / 3.0),
                // Forces of the walls times where they act.
                (found.pressure_virial, (p[0] + p[1] + p[2]) / 3.0),
                (found.Z, 6.0),
            ] {
                assert_close(value, expected, 1e-12);
            }
        }
    }

    #[test]
    fn the_virial_of_walls_is_their_forces_times_places() {
        // Any forces of plates on a lattice that carries others: (1/3V) sum f.x on the walls, less nothing.
        let (r, p) = (0.5, [3.0, 2.0, 1.0]);
        let mut scene = Scene::default();
        lattice(&mut scene, COUNTS, r, p);
        plates(&mut scene, COUNTS, r, [7.0, 5.0, 11.0], &[0, 1, 2, 3, 4, 5]);
        let frame = scene.frame();
        let of_walls: f64 = frame
            .active_contacts()
            .filter(|contact| contact.grain_pair().is_none())
            .map(|contact| -contact.point.dot(&contact.force))
            .sum();
        let region = region(&frame);
        assert_close(region.virial_pressure(&frame, PairSummation::Direct), of_walls / 3.0 / region.volume, 1e-12);
    }

    #[test]
    fn a_bed_under_a_lid_has_the_load_and_half_of_its_weight() {
        // The load on top, and below each layer the weight above it.
        let (r, load, g) = (0.5, 1000.0, 2.0);
        for sides in [&[0, 1, 2, 3, 4, 5][..], &[4, 5]] {
            let mut scene = Scene::default();
            scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -g];
            lattice(&mut scene, COUNTS, r, [load; 3]);
            plates(&mut scene, COUNTS, r, [load; 3], sides);
            if sides.len() == 2 {
                let parameters = &mut scene.snapshot.meta.parameters;
                (parameters.xperiode, parameters.yperiode) = (Some(5.0), Some(4.0));
            }
            let weight = PI / 6.0 * g;
            let layer = COUNTS[0] * COUNTS[1];
            for k in 0..scene.snapshot.contacts.contact_body.len() {
                let candidate = scene.snapshot.contacts.contact_body[k][0] as usize;
                let n = scene.snapshot.contacts.contact_frame[k][0];
                if n[2].abs() == 1.0 {
                    // Layers above the contact: those of the candidate and higher, of the lid none.
                    let above = if n[2] > 0.0 { COUNTS[2] - candidate / layer } else { 0 };
                    scene.snapshot.contacts.contact_force[k][0] += weight * above as f64;
                    scene.snapshot.contacts.contact_impulse[k] = scene.snapshot.contacts.contact_force[k];
                }
            }
            let found = row(&scene);
            assert_eq!((found.region, found.n_pulling), (RegionKind::Walls.column_value(), 0));
            assert_close(found.sigma_zz, load + 0.5 * 6.0 * weight, 1e-12);
            assert_close(found.nu, PI / 6.0, 1e-12);
        }
    }

    #[test]
    fn an_open_bed_ends_at_its_surface_whatever_flies_above() {
        let (r, p) = (0.5, [1.0; 3]);
        let mut scene = Scene::default();
        scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -1.0];
        lattice(&mut scene, COUNTS, r, p);
        plates(&mut scene, COUNTS, r, p, &[0, 1, 2, 3, 4]);
        let bed = row(&scene);
        assert_eq!(bed.region, RegionKind::Bed.column_value());
        // Columns over the middles and half-way between spheres: at most a radius below the highest points.
        assert!((20.0 * 5.5..=20.0 * 6.0).contains(&bed.region_volume), "{}", bed.region_volume);
        assert_close(bed.nu * bed.region_volume, 120.0 * PI / 6.0, 1e-12);
        scene.grain([2.5, 2.0, 60.0], 2.0);
        let with_lander = row(&scene);
        assert_close(with_lander.nu, bed.nu, 1e-12);
        assert_close(with_lander.pressure, bed.pressure, 1e-12);
        assert_eq!(with_lander.Z, bed.Z);
        // A lid a box higher does not count, and one on the grains does.
        scene.plate([2.5, 2.0, 12.5], [50.0, 50.0, 0.5]);
        assert_close(row(&scene).nu, bed.nu, 1e-12);
        scene.plate([2.5, 2.0, 6.5], [50.0, 50.0, 0.5]);
        let closed = row(&scene);
        assert_eq!(closed.region, RegionKind::Walls.column_value());
        assert_close(closed.region_volume, 120.0, 1e-12);
    }

    #[test]
    fn a_cell_and_a_cylinder_have_their_volumes() {
        let (r, p) = (0.5, [2.0; 3]);
        let mut scene = Scene::default();
        lattice(&mut scene, COUNTS, r, p);
        (scene.snapshot.meta.parameters.xperiode, scene.snapshot.meta.parameters.yperiode) = (Some(5.0), Some(4.0));
        let found = row(&scene);
        assert_eq!(found.region, RegionKind::Cell.column_value());
        assert_close(found.region_volume, 120.0, 1e-12);
        assert!(found.nu_sphere.is_nan() && found.pressure_virial.is_nan());
        // With a period along z, too, the cell is the whole space, whatever gravity is; it need not end at the grains.
        for (height, gravity) in [(6.0, 0.0), (8.0, -1.0)] {
            scene.snapshot.meta.parameters.zperiode = Some(height);
            scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, gravity];
            let found = row(&scene);
            assert_eq!((found.region, found.n_grains), (RegionKind::Cell.column_value(), 120));
            assert_close(found.region_volume, 20.0 * height, 1e-12);
            assert_close(found.nu, 120.0 * PI / 6.0 / (20.0 * height), 1e-12);
            assert!(found.com_z.is_nan() && found.bed_height.is_nan() && found.surface_slope.is_nan());
        }
        // A silo about an upright axis and a drum on its side, between plates at its ends.
        for (axis, ends, volume) in [(2, [4, 5], PI * 64.0 * 6.0), (0, [0, 1], PI * 64.0 * 5.0)] {
            let mut scene = Scene::default();
            lattice(&mut scene, COUNTS, r, p);
            plates(&mut scene, COUNTS, r, p, &ends);
            let mut frame = scene.frame();
            let shape = hollow(8.0, 50.0);
            let rotation = UnitQuaternion::rotation_between(&Vec3::z(), &Vec3::ith(axis, 1.0)).unwrap();
            frame.walls.push(Wall { id: 99, x: Vec3::new(2.5, 2.0, 4.0), v: None, rotation, shape });
            let found = region(&frame);
            assert_eq!(found.kind, RegionKind::Walls);
            assert_close(found.volume, volume, 1e-12);
            // If gravity acts across the axis, the wide drum contains a heap, and one whose wall passes through the lower
            // edges of the lattice, with its axis in the upper face, a bed.
            if axis == 0 {
                frame.meta.parameters.uniform_gravity = [0.0, -1.0, 0.0];
                assert_eq!(region(&frame).kind, RegionKind::LargestGroup);
                let last = frame.walls.len() - 1;
                (frame.walls[last].x, frame.walls[last].shape) = (Vec3::new(2.5, 4.0, 3.0), hollow(5.0, 50.0));
                let bed = region(&frame);
                // The lower half of the disc, or its part up to half a radius less.
                let area_below = |s: f64| 25.0 * (s / 5.0).asin() + s * (25.0 - s * s).sqrt() + 12.5 * PI;
                assert_eq!(bed.kind, RegionKind::Bed);
                assert!(
                    (5.0 * area_below(-0.5)..=5.0 * area_below(0.0) * 1.0001).contains(&bed.volume),
                    "{}",
                    bed.volume
                );
            }
        }
    }

    fn hollow(radius: f64, half_height: f64) -> WallShape {
        WallShape::Polyhedron(SolidShape { hollow: Some(Hollow { radius, half_height }), ..Default::default() }.into())
    }

    #[test]
    fn the_ends_of_a_hollow_cylinder_close_it() {
        let (r, p) = (0.5, [2.0; 3]);
        let gravity = |frame: &mut Frame| frame.meta.parameters.uniform_gravity = [0.0, 0.0, -1.0];
        for axis in 0..3 {
            let mut scene = Scene::default();
            lattice(&mut scene, COUNTS, r, p);
            let mut frame = scene.frame();
            let rotation = UnitQuaternion::rotation_between(&Vec3::z(), &Vec3::ith(axis, 1.0)).unwrap();
            let x = Vec3::new(2.5, 2.0, 3.0);
            frame.walls.push(Wall { id: 99, x, v: None, rotation, shape: hollow(8.0, 5.0) });
            let found = region(&frame);
            assert_eq!((found.kind, found.members.len()), (RegionKind::Walls, 120));
            assert_close(found.volume, PI * 64.0 * 10.0, 1e-12);
            // Two of 121 grains may have left through an end.
            frame.grains[0].x[axis] -= 30.0;
            assert_close(region(&frame).volume, PI * 64.0 * 10.0, 1e-12);
            // One that stands empty elsewhere bounds nothing, with its ends neither.
            frame.walls[0].x += Vec3::ith(axis, 40.0);
            assert_eq!(region(&frame).kind, RegionKind::LargestGroup);
        }
        // A piston in it is where the space ends, and a bed within ends at its surface, for a lying one too.
        for (axis, count) in COUNTS.into_iter().enumerate() {
            let mut scene = Scene::default();
            lattice(&mut scene, COUNTS, r, p);
            plates(&mut scene, COUNTS, r, p, &[4]);
            if axis == 2 {
                plates(&mut scene, COUNTS, r, p, &[5]);
            }
            let mut frame = scene.frame();
            let rotation = UnitQuaternion::rotation_between(&Vec3::z(), &Vec3::ith(axis, 1.0)).unwrap();
            let x = Vec3::new(2.5, 2.0, 3.0);
            // Through the corners of the lattice; ends at most half a diameter from it.
            let square: f64 = (0..3).filter(|&k| k != axis).map(|k| (0.5 * COUNTS[k] as f64).powi(2)).sum();
            let length = 1.0 + count as f64;
            let half_height = if axis == 2 { 5.0 } else { 0.5 * length };
            frame.walls.push(Wall { id: 99, x, v: None, rotation, shape: hollow(square.sqrt(), half_height) });
            gravity(&mut frame);
            let found = region(&frame);
            if axis == 2 {
                assert_eq!(found.kind, RegionKind::Walls);
                assert_close(found.volume, PI * square * 6.0, 1e-12);
            } else {
                // The roof of the drum is less than a diameter above the grains. 360 sides instead of a circle.
                let area_below = |s: f64| square * (s / square.sqrt()).asin() + s * (square - s * s).sqrt();
                let expected = length * (0.5 * PI * square - area_below(-3.0));
                assert_eq!(found.kind, RegionKind::Walls);
                assert_close(found.volume, expected, 1e-4);
            }
            let layer: Probe = "layer:0,1".parse().unwrap();
            assert_eq!(Region::from_probe(&frame, &find_fragments(&frame), &layer).kind, RegionKind::Layer);
        }
    }

    #[test]
    fn an_aggregate_is_its_hull_whatever_is_thrown_off() {
        let (r, p) = (0.5, [3.0; 3]);
        let mut scene = Scene::self_gravitating(1e-9);
        lattice(&mut scene, [6, 6, 6], r, p);
        let alone = row(&scene);
        let (a, edge) = (5.0f64, 3.0 * PI * 5.0 * r * r);
        let hull = a.powi(3) + 6.0 * a * a * r + edge + PI / 6.0;
        assert_eq!(alone.region, RegionKind::LargestGroup.column_value());
        assert_close(alone.region_volume, hull, 1e-7);
        assert_close(alone.nu, 216.0 * PI / 6.0 / hull, 1e-7);
        // Contacts between neighbours over their distance of 1: 180 an axis.
        assert_close(alone.pressure, 180.0 * 3.0 / hull, 1e-7);
        scene.grain([4000.0, 0.0, 0.0], r);
        let moon = scene.grain([0.0, 90.0, 0.0], r);
        let second = scene.grain([0.0, 91.0, 0.0], r);
        scene.push(second, moon, 1.0);
        let with = row(&scene);
        assert_eq!((with.nu, with.Z, with.pressure), (alone.nu, alone.Z, alone.pressure));
        // Values in the ball around all grains are nearly zero, and the neighbours of all grains are fewer.
        assert!(with.nu_sphere < 1e-6 && with.pressure_sphere < 1e-6 * with.pressure && with.Z_all < with.Z);
        // The pull of the outer grains changes the balance within the first only by tides.
        assert_close(with.pressure_virial, alone.pressure_virial, 1e-5);
    }

    #[test]
    fn a_planet_among_the_grains_is_not_the_remnant() {
        let (r, p) = (0.5, [3.0; 3]);
        let mut scene = Scene::self_gravitating(1e-9);
        lattice(&mut scene, [6, 6, 6], r, p);
        let alone = row(&scene);
        let planet = scene.grain([4000.0, 0.0, 0.0], 900.0);
        let with = row(&scene);
        assert_eq!(with.region, RegionKind::LargestGroup.column_value());
        let found = [with.nu, with.Z, with.pressure, with.largest_mass, with.largest_a];
        assert_eq!(found, [alone.nu, alone.Z, alone.pressure, alone.largest_mass, alone.largest_a]);
        // Pebbles on the planet: a heavy fragment of few grains.
        for angle in 0..12 {
            let (sin, cos) = (0.5 * f64::from(angle)).sin_cos();
            let pebble = scene.grain([4000.0 + 900.5 * cos, 900.5 * sin, 0.0], r);
            scene.push(pebble, planet, 1.0);
        }
        assert_eq!(row(&scene).nu, alone.nu);
        assert_close(probed(&scene, "ball:2@largest").nu, PI / 6.0, 0.1);
        // The heavier one of two remnants with many grains counts, even if it has fewer grains.
        let first = scene.snapshot.bodies.body_id.len();
        for k in 0..40 {
            scene.grain([-900.0 + 6.0 * f64::from(k), 0.0, 0.0], 3.0);
            if k > 0 {
                scene.push(first + k as usize, first + k as usize - 1, 1.0);
            }
        }
        assert_close(row(&scene).largest_mass, 40.0 * 27.0 * 8.0 * alone.largest_mass / 216.0, 1e-12);
    }

    #[test]
    fn a_heavy_lander_above_a_bed_does_not_open_its_box() {
        let (r, p) = (0.5, [1.0; 3]);
        let mut scene = Scene::default();
        lattice(&mut scene, COUNTS, r, p);
        plates(&mut scene, COUNTS, r, p, &[0, 1, 2, 3, 4, 5]);
        let closed = row(&scene);
        scene.grain([2.5, 2.0, 60.0], 20.0);
        let with = row(&scene);
        assert_eq!((with.region, with.nu), (RegionKind::Walls.column_value(), closed.nu));
    }

    #[test]
    fn clumps_of_one_to_four_grains_and_clouds() {
        let ball = 4.0 / 3.0 * PI;
        let height = 3f64.sqrt();
        let corners = [[0.0; 3], [2.0, 0.0, 0.0], [1.0, height, 0.0], [1.0, height / 3.0, 8f64.sqrt() / height]];
        let angle = PI - (1.0f64 / 3.0).acos(); // between the normals of two faces of a tetrahedron
        let hulls = [
            ball,
            ball + PI * 2.0,
            ball + 2.0 * height + 0.5 * PI * 6.0,
            ball + 8.0 / 72f64.sqrt() + 4.0 * height + 0.5 * 12.0 * angle,
        ];
        for count in 1..=4 {
            let mut scene = Scene::default();
            for (k, x) in corners.iter().enumerate().take(count) {
                scene.grain(*x, 1.0);
                (0..k).for_each(|j| scene.push(k, j, 1.0));
            }
            let found = row(&scene);
            assert_eq!(found.region, RegionKind::LargestGroup.column_value());
            assert_close(found.nu, count as f64 * ball / hulls[count - 1], 1e-6);
        }
        // Grains that fly, each by itself.
        let mut scene = Scene::default();
        for x in corners {
            scene.grain(x.map(|x| 10.0 * x), 1.0);
        }
        assert_eq!((row(&scene).region, row(&scene).Z), (RegionKind::AllGrains.column_value(), 0.0));
        let none = row(&Scene::default());
        assert!(none.region == 0 && none.nu.is_nan() && none.Z.is_nan() && none.pressure.is_nan());
    }

    #[test]
    fn probes_within_a_lattice_have_its_values() {
        // Face-centred cubic, contacts of length 1 with 1 N: nu = pi / sqrt(18); six contacts a grain, of which sqrt 2 a unit of
        // volume: 6 sqrt 2 f l / 3.
        let (mut scene, n) = (Scene::default(), 7i32);
        let mut places = Vec::new();
        for (i, j, k) in (-n..=n).flat_map(|i| (-n..=n).flat_map(move |j| (-n..=n).map(move |k| (i, j, k)))) {
            if (i + j + k) % 2 == 0 {
                places.push([i, j, k]);
                scene.grain([i, j, k].map(|x| f64::from(x) / 2f64.sqrt()), 0.5);
            }
        }
        let number: std::collections::HashMap<[i32; 3], usize> =
            places.iter().enumerate().map(|(k, place)| (*place, k)).collect();
        for (k, [x, y, z]) in places.iter().enumerate() {
            for d in [[1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1], [0, 1, 1], [0, 1, -1]] {
                if let Some(&other) = number.get(&[x + d[0], y + d[1], z + d[2]]) {
                    scene.push(other, k, 1.0);
                }
            }
        }
        let (nu, pressure) = (PI / 18f64.sqrt(), 2.0 * 2f64.sqrt());
        // Whole cells of the lattice are exact but for what points of cut spheres leave; of others the border is a chance.
        let cell = 2.0 * 2f64.sqrt();
        let found = probed(&scene, &format!("box:{cell},{cell},{cell}@0.1,0.2,0.3"));
        assert_eq!(found.region, RegionKind::Box.column_value());
        assert_close(found.nu, nu, 1e-3);
        assert_close(found.pressure, pressure, 1e-12);
        assert_eq!(found.Z, 12.0);
        for probe in ["ball:4@com", "cylinder:3.5,6@largest", "cylinder:3.5,6,1,1,0"] {
            let found = probed(&scene, probe);
            assert_close(found.nu, nu, 0.02);
            assert_close(found.pressure, pressure, 0.03);
            assert!(found.Z == 12.0 && found.pressure_virial.is_nan());
        }
        // Without walls a layer has no sides.
        let layer = probed(&scene, "layer:0,1");
        assert!(layer.region == 0 && layer.nu.is_nan());
    }

    #[test]
    fn a_probe_in_a_scene_that_repeats_is_the_same_in_every_cell() {
        let (r, p) = (0.5, [2.0; 3]);
        let mut scene = Scene::default();
        lattice(&mut scene, COUNTS, r, p);
        let parameters = &mut scene.snapshot.meta.parameters;
        (parameters.xperiode, parameters.yperiode) = (Some(5.0), Some(4.0));
        let at = |shape: &str, x: f64, y: f64| probed(&scene, &format!("{shape}@{x},{y},3"));
        for shape in ["ball:1.5", "box:3,2,2", "cylinder:1,2,1,0,0"] {
            let own = at(shape, 0.25, 0.5);
            assert!(own.nu > 0.3 && own.Z > 0.0);
            for (x, y) in [(1.0, 0.0), (-1.0, 1.0), (3.0, 0.0), (0.0, -7.0), (1000.0, 20.0)] {
                let found = at(shape, 0.25 + 5.0 * x, 0.5 + 4.0 * y);
                assert_eq!((found.region, found.Z), (own.region, own.Z));
                assert_close(found.nu, own.nu, 1e-2);
                assert_close(found.pressure, own.pressure, 1e-9);
            }
        }
        // One over 12 cells and a half.
        assert_close(at("box:62.5,4,4", 7.0, 0.0).nu, PI / 6.0, 5e-3); // cut grains are sums over points
        assert_eq!(at("box:1e6,1e6,4", 0.0, 0.0).region, RegionKind::None.column_value());
    }

    #[test]
    fn layers_between_walls_and_periods() {
        let (r, p) = (0.5, [2.0; 3]);
        for periodic in [false, true] {
            let mut scene = Scene::default();
            lattice(&mut scene, COUNTS, r, p);
            plates(&mut scene, COUNTS, r, p, if periodic { &[4] } else { &[0, 1, 2, 3, 4] });
            if periodic {
                let parameters = &mut scene.snapshot.meta.parameters;
                (parameters.xperiode, parameters.yperiode) = (Some(5.0), Some(4.0));
            }
            for (from, to) in [(0.0, 1.0), (0.5, 3.0), (1.25, 1.5)] {
                let found = probed(&scene, &format!("layer:{from},{to}"));
                assert_eq!(found.region, RegionKind::Layer.column_value());
                assert_close(found.region_volume, 20.0 * (to - from), 1e-12);
                assert_close(found.sigma_zz, 2.0, 1e-12);
            }
            assert_close(probed(&scene, "layer:0,1").nu, PI / 6.0, 1e-12);
            assert_close(probed(&scene, "layer:0.5,3").nu, PI / 6.0, 1e-12);
        }
    }

    #[test]
    fn a_floor_of_a_polyhedron_bounds_and_a_small_one_above_does_not() {
        let (r, p) = (0.5, [2.0; 3]);
        let mut scene = Scene::default();
        scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -1.0];
        lattice(&mut scene, COUNTS, r, p);
        plates(&mut scene, COUNTS, r, p, &[0, 1, 2, 3]);
        let floor = scene.cube([2.5, 2.0, -20.0], 20.0);
        let lander = scene.cube([2.5, 2.0, 8.0], 0.5);
        for body in [floor, lander] {
            scene.snapshot.bodies.body_driven[body] = cd_formats::snapshot::DRIVEN_ALL;
        }
        scene.contact_at(0, floor, [0.5, 0.5, 0.0], Vec3::z());
        let found = row(&scene);
        assert_eq!(found.region, RegionKind::Bed.column_value());
        assert!((20.0 * 5.5..=20.0 * 6.0).contains(&found.region_volume), "{}", found.region_volume);
    }

    /// Plates of half thickness `r` around the lattice like [`plates`], each side in `tiles` by `tiles` equal plates that
    /// cover the side of the lattice and no more, moved outwards by `away`.
    fn tiled(scene: &mut Scene, r: f64, tiles: usize, sides: &[usize], away: f64) {
        let size = COUNTS.map(|count| 2.0 * r * count as f64);
        for &side in sides {
            let (axis, sign) = (side / 2, if side % 2 == 1 { 1.0 } else { -1.0 });
            let half = Vec3::from(size) * (0.5 / tiles as f64);
            for (i, j) in (0..tiles).flat_map(|i| (0..tiles).map(move |j| (i, j))) {
                let (second, third) = ((axis + 1) % 3, (axis + 2) % 3);
                let (mut centre, mut lengths) = ([0.0; 3], half);
                centre[axis] = 0.5 * size[axis] + sign * (0.5 * size[axis] + r + away);
                centre[second] = half[second] * (2 * i + 1) as f64;
                centre[third] = half[third] * (2 * j + 1) as f64;
                lengths[axis] = r;
                scene.plate(centre, lengths.into());
            }
        }
    }

    /// Columns that stand on the flank of a bed along a wall that leans over it are none of its surface.
    #[test]
    fn a_tilted_box_has_the_volume_of_an_upright_one() {
        let (r, counts) = (0.5, [8, 8, 14]);
        let row_at = |tilt: f64| {
            let mut scene = Scene::default();
            lattice(&mut scene, counts, r, [1.0; 3]);
            plates(&mut scene, counts, r, [1.0; 3], &[0, 1, 2, 3, 4]);
            scene.snapshot.meta.parameters.uniform_gravity = [tilt.sin(), 0.0, -tilt.cos()];
            // Off the lattice, so that no vertical passes between columns of grains.
            let number = counts.iter().product();
            for (k, x) in scene.snapshot.bodies.body_x.iter_mut().take(number).enumerate() {
                for (axis, ratio) in [0.618_033_988_749_895, 0.754_877_666_246_693].into_iter().enumerate() {
                    let shift = 1.2 * r * ((k as f64 * ratio).fract() - 0.5);
                    x[axis] = (x[axis] + shift).clamp(r, 2.0 * r * counts[axis] as f64 - r);
                }
            }
            row(&scene)
        };
        let upright = row_at(0.0);
        for tilt in [0.05, 0.1, 0.2, 0.3] {
            let tilted = row_at(tilt);
            assert_eq!(tilted.region, RegionKind::Bed.column_value());
            // Other points of the grains are seen: less than a tenth of a radius of a height of 28.
            assert_close(tilted.region_volume / upright.region_volume, 1.0, 0.02);
        }
    }

    #[test]
    fn a_side_in_many_plates_bounds_as_one_plate() {
        let (r, p) = (0.5, [3.0, 4.0, 5.0]);
        for gravity in [false, true] {
            // Tiles, tiles given twice, and tiles within a wall of one plate behind them.
            for (tiles, copies, behind) in [(1, 1, false), (2, 1, false), (3, 2, false), (3, 1, true)] {
                let mut scene = Scene::default();
                lattice(&mut scene, COUNTS, r, p);
                let sides: &[usize] = if gravity { &[0, 1, 2, 3, 4] } else { &[0, 1, 2, 3, 4, 5] };
                (0..copies).for_each(|_| tiled(&mut scene, r, tiles, sides, 0.0));
                if behind {
                    tiled(&mut scene, r, 1, sides, 3.0);
                }
                // Bodies that carry the lowest layer.
                let floor = scene.plate([2.5, 2.0, -0.5], [2.5, 2.0, 0.5]);
                scene.contact_at(0, floor, [0.5, 0.5, 0.0], Vec3::z());
                if gravity {
                    scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -1.0];
                }
                let found = row(&scene);
                let kind = if gravity { RegionKind::Bed } else { RegionKind::Walls };
                assert_eq!(found.region, kind.column_value(), "{tiles} {copies} {behind}");
                if gravity {
                    assert!((20.0 * 5.5..=20.0 * 6.0).contains(&found.region_volume), "{}", found.region_volume);
                    assert_close(found.bed_nu, PI / 6.0, 1e-12);
                } else {
                    assert_close(found.region_volume, 120.0, 1e-12);
                    assert_close(found.nu, PI / 6.0, 1e-12);
                }
            }
        }
    }

    #[test]
    fn plates_that_leave_half_of_a_side_open_or_stand_elsewhere_bound_nothing() {
        let (r, p) = (0.5, [3.0; 3]);
        let hull = {
            let mut scene = Scene::default();
            lattice(&mut scene, COUNTS, r, p);
            row(&scene)
        };
        for gravity in [false, true] {
            // Tiles of a floor alone; posts; plates above the grains; a box in whose middle the grains are.
            for case in 0..4 {
                let mut scene = Scene::default();
                lattice(&mut scene, COUNTS, r, p);
                let lowest = scene.plate([2.5, 2.0, -0.5], [9.0, 9.0, 0.5]);
                scene.contact_at(0, lowest, [0.5, 0.5, 0.0], Vec3::z());
                let around = [[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]];
                match case {
                    0 => tiled(&mut scene, r, 3, &[4], 0.0),
                    1 | 2 => around.iter().for_each(|[x, y]| {
                        let z = if case == 1 { 1.0 } else { 30.0 };
                        let half = [1.0 - 0.9 * x * x, 1.0 - 0.9 * y * y, 1.0];
                        scene.plate([2.5 + 9.0 * x, 2.0 + 9.0 * y, z], half);
                    }),
                    _ if gravity => around.iter().for_each(|[x, y]| {
                        let half = [20.0 - 19.9 * x * x, 20.0 - 19.9 * y * y, 20.0];
                        scene.plate([2.5 + 20.0 * x, 2.0 + 20.0 * y, 20.0], half);
                    }),
                    // Without gravity a gas fills any box: plates on all sides, each smaller than half of a side.
                    _ => (0..3).flat_map(|axis| [(axis, -1.0), (axis, 1.0)]).for_each(|(axis, sign)| {
                        let (mut centre, mut half) = ([2.5, 2.0, 3.0], [3.0; 3]);
                        centre[axis] += 12.0 * sign;
                        half[axis] = 0.1;
                        scene.plate(centre, half);
                    }),
                }
                if gravity {
                    scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -1.0];
                }
                let found = row(&scene);
                assert_eq!(found.region, RegionKind::LargestGroup.column_value(), "{gravity} {case}");
                assert!(found.nu == hull.nu && found.bed_nu.is_nan(), "{gravity} {case}");
            }
        }
    }

    #[test]
    fn polyhedra_that_fill_a_box_have_a_solid_fraction_of_one() {
        for half in [[0.5, 0.5, 0.5], [0.25, 0.25, 2.0], [1.0, 1.0, 0.125]] {
            let mut scene = Scene::default();
            scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -1.0];
            let counts = [(4.0, half[0]), (4.0, half[1]), (2.0, half[2])]
                .map(|(size, half): (f64, f64)| (size / (2.0 * half)).max(1.0) as usize);
            let height = 2.0 * half[2] * counts[2] as f64;
            let floor = scene.plate([2.0, 2.0, -0.5], [2.0, 2.0, 0.5]);
            for (x, y) in [(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)] {
                let thin = |part: f64| if part == 0.0 { 3.0 } else { 0.5 };
                scene.plate([2.0 + 2.5 * x, 2.0 + 2.5 * y, 3.0], [thin(x), thin(y), 3.0]);
            }
            for k in 0..counts.iter().product() {
                let at = [k % counts[0], k / counts[0] % counts[1], k / counts[0] / counts[1]];
                let x = [0, 1, 2].map(|axis| half[axis] * (2 * at[axis] + 1) as f64);
                let body = scene.cuboid(x, half);
                scene.contact_at(body, floor, [x[0], x[1], 0.0], Vec3::z());
            }
            let found = row(&scene);
            assert_eq!(found.region, RegionKind::Bed.column_value());
            assert_close(found.region_volume, 16.0 * height, 1e-12);
            assert_close(found.nu, 1.0, 1e-12);
        }
    }
}
