//! The space that walls and periods enclose around the grains.

use crate::derive::energy::self_gravity_constant;
use crate::derive::fragments::Fragment;
use crate::derive::free_surface::mean_plane;
use crate::derive::heights::{centre_of_mass, height_range};
use crate::derive::polytope::ConvexPolytope;
use crate::derive::probe::ProbeShape;
use crate::derive::region_kind::RegionKind;
use crate::derive::walls::{CylinderBore, WallFace, bounding_bore, bounding_faces, supported_grains};
use crate::frame::{Frame, Grain, GrainId};
use crate::math::Vec3;

/// Number of sides of the polygon that approximates a hollow cylinder; it has the same area.
const POLYGON_SIDES: usize = 360;

/// Region between walls and periods, with its grains.
pub struct EnclosedRegion {
    pub kind: RegionKind,
    /// Volume, m^3.
    pub volume: f64,
    /// Indices of the grains with their centre inside, rising.
    pub members: Vec<GrainId>,
}

/// Walls and periods around grains.
pub struct GrainEnclosure<'a> {
    frame: &'a Frame,
    faces: Vec<WallFace>,
    bores: Vec<CylinderBore>,
    /// Space between the walls and periods.
    space: ConvexPolytope,
    /// Grains by which walls and periods were chosen.
    core: Vec<GrainId>,
    /// Direction against uniform gravity, in a periodic scene along z; None without gravity.
    up: Option<Vec3>,
    mean_diameter: f64,
}

impl<'a> GrainEnclosure<'a> {
    /// Returns None without walls and periods, and if nothing touches walls while self-gravity binds the grains.
    pub fn from_frame(frame: &'a Frame, fragments: &[Fragment]) -> Option<GrainEnclosure<'a>> {
        let cell = frame.cell();
        if frame.grains.is_empty() || frame.walls.is_empty() && !cell.is_periodic() {
            return None;
        }
        let held = supported_grains(frame, fragments);
        if held.is_empty() && self_gravity_constant(frame).is_some() && !cell.is_periodic() {
            return None;
        }
        let mass = |grains: &[GrainId]| grains.iter().map(|&i| frame.grains[i].mass).sum::<f64>();
        // Half of the mass or half of the grains: a lander may be heavier than the bed below it.
        let half =
            |grains: &[GrainId]| 2.0 * mass(grains) >= frame.total_mass() || 2 * grains.len() >= frame.grains.len();
        // If no wall touches a grain, the largest fragment: ejecta do not count.
        let largest = fragments.first().map_or(&[][..], |first| &first.grains);
        let core = [&held[..], if held.is_empty() { largest } else { &[] }].into_iter().find(|grains| half(grains));
        let core = core.map_or_else(|| frame.grain_ids().collect(), <[GrainId]>::to_vec);
        let grains = || core.iter().map(|&i| &frame.grains[i]);
        let faces: Vec<WallFace> = frame.wall_ids().flat_map(|k| bounding_faces(frame, k, &core)).collect();
        let bores: Vec<CylinderBore> = frame.wall_ids().filter_map(|k| bounding_bore(frame, k, &core)).collect();
        let centre = centre_of_mass(grains());
        // The initial cuboid exceeds all walls by far, so that a side without a wall stays open.
        let far = grains().map(|g| (g.x - centre).norm() + g.bounding_radius()).fold(0.0, f64::max);
        let walls = faces.iter().map(|f| (f.place - f.normal.dot(&centre)).abs()).chain(bores.iter().map(|b| b.radius));
        let open = 64.0 * walls.fold(far, f64::max);
        let mut space = ConvexPolytope::cuboid(centre, open);
        for (axis, period) in cell.0.iter().enumerate().filter_map(|(axis, period)| Some((axis, (*period)?))) {
            space.cut_below(&Vec3::ith(axis, 1.0), -0.5 * period);
            space.cut_below(&Vec3::ith(axis, -1.0), -0.5 * period);
        }
        for face in &faces {
            space.cut_below(&face.normal, face.place);
        }
        for bore in &bores {
            let first = bore.axis.cross(&Vec3::ith(bore.axis.iamin(), 1.0)).normalize();
            let second = bore.axis.cross(&first);
            let turn = std::f64::consts::TAU / POLYGON_SIDES as f64;
            let apothem = bore.radius * (0.5 * turn / (0.5 * turn).tan()).sqrt();
            for k in 0..POLYGON_SIDES {
                let (sin, cos) = (turn * k as f64).sin_cos();
                let inward = -(first * cos + second * sin);
                space.cut_below(&inward, inward.dot(&bore.x) - apothem);
            }
        }
        let against = (-Vec3::from(frame.meta.parameters.uniform_gravity)).try_normalize(0.0);
        let up = against.map(|against| if cell.is_periodic() { Vec3::z() } else { against });
        let mean_diameter = 2.0 * grains().map(|g| g.radius).sum::<f64>() / core.len() as f64;
        Some(GrainEnclosure { frame, faces, bores, space, core, up, mean_diameter })
    }

    fn is_inside(&self, x: &Vec3) -> bool {
        self.faces.iter().all(|face| face.is_before(x)) && self.bores.iter().all(|bore| bore.contains_point(x))
    }

    /// Lowest and highest point of the grains along a direction, m.
    fn height_range(&self, axis: &Vec3) -> [f64; 2] {
        let inside = self.core.iter().map(|&i| &self.frame.grains[i]).filter(|grain| self.is_inside(&grain.x));
        let ends = inside.map(|grain| height_range(grain, axis));
        ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [l, h]| [low.min(l), high.max(h)])
    }

    /// Space that walls and periods enclose around the grains; `None` if it is open.
    pub fn into_region(self) -> Option<EnclosedRegion> {
        match self.up {
            Some(up) => self.into_region_under_gravity(&up),
            None => self.into_weightless_region(),
        }
    }

    fn into_weightless_region(mut self) -> Option<EnclosedRegion> {
        let repeats = self.frame.cell().is_periodic();
        let mut kind = RegionKind::Walls;
        let mut limits = [f64::NEG_INFINITY, f64::INFINITY];
        if repeats && !self.space.is_closed() {
            (kind, limits) = (RegionKind::Cell, self.height_range(&Vec3::z()));
            let periods = self.frame.cell().0;
            let open: Vec<usize> = (0..3).filter(|&axis| axis == 2 || periods[axis].is_none()).collect();
            for axis in open {
                let axis = Vec3::ith(axis, 1.0);
                let [low, high] = self.height_range(&axis);
                self.space.cut_below(&axis, low);
                self.space.cut_below(&-axis, -high);
            }
        }
        let [low, high] = limits;
        let within = |x: &Vec3| self.is_inside(x) && (low..=high).contains(&x.z);
        let members = self.members_inside(within);
        self.space.is_closed().then(|| EnclosedRegion { kind, volume: self.space.volume(), members })
    }

    fn into_region_under_gravity(mut self, up: &Vec3) -> Option<EnclosedRegion> {
        let grains = self.core.iter().map(|&i| &self.frame.grains[i]).filter(|grain| self.is_inside(&grain.x));
        let grains: Vec<&Grain> = grains.collect();
        let (point, normal) = mean_plane(&grains, &self.frame.cell(), up)?;
        let whole = self.space.is_closed().then(|| self.space.volume());
        let section = self.space.cut_below(&-normal, -normal.dot(&point));
        if !self.space.is_closed() {
            let [lowest, _] = self.height_range(up);
            self.space.cut_below(up, lowest);
        }
        if !self.space.is_closed() {
            return None;
        }
        let volume = self.space.volume();
        if let Some(whole) = whole
            && whole - volume <= section * self.mean_diameter
        {
            let members = self.members_inside(|x| self.is_inside(x));
            return Some(EnclosedRegion { kind: RegionKind::Walls, volume: whole, members });
        }
        let below = |x: &Vec3| (x - point).dot(&normal) <= 0.0;
        let core = |i: &GrainId| self.core.binary_search(i).is_ok();
        let member = |i: &GrainId| {
            let x = &self.frame.grains[*i].x;
            self.is_inside(x) && (core(i) || below(x))
        };
        let members = self.frame.grain_ids().filter(member).collect();
        Some(EnclosedRegion { kind: RegionKind::Bed, volume, members })
    }

    fn members_inside(&self, inside: impl Fn(&Vec3) -> bool) -> Vec<GrainId> {
        self.frame.grain_ids().filter(|&i| inside(&self.frame.grains[i].x)).collect()
    }

    /// Returns the layer between two heights (m) above the lowest point of the space, or of the grains if the space is open
    /// below, and its volume; None if a side is open.
    pub fn into_layer(mut self, from: f64, to: f64) -> Option<(ProbeShape, f64)> {
        let up = self.up.unwrap_or(Vec3::z());
        let [lowest, _] = self.height_range(&up);
        let floor = self.space.lowest_point(&up).unwrap_or(lowest);
        self.space.cut_below(&up, floor + from);
        self.space.cut_below(&-up, -(floor + to));
        let layer = ProbeShape::Layer { up, from: floor + from, to: floor + to };
        self.space.is_closed().then(|| (layer, self.space.volume()))
    }
}
