//! The space that walls and periods enclose around the grains.

use cd_formats::geometry::convex_region::ConvexRegion;

use crate::derive::energy::self_gravity_constant;
use crate::derive::fragments::Fragment;
use crate::derive::free_surface::{SurfacePlane, mean_plane};
use crate::derive::heights::{centre_of_mass, height_range};
use crate::derive::polytope::ConvexPolytope;
use crate::derive::region_kind::RegionKind;
use crate::derive::walls::{CylinderBore, WallPlane, bounding_bore, bounding_planes, supported_grains};
use crate::frame::{Frame, Grain, GrainId};
use crate::math::Vec3;

/// Number of sides of the polygon that approximates a hollow cylinder; it has the same area.
const POLYGON_SIDES: usize = 360;

/// Least share of a side of the space that faces of walls cover. Gaps between plates, an outlet and corners that plates do
/// not reach leave more; posts and tiles that stand apart cover less.
const MIN_COVERED_SHARE: f64 = 0.5;

/// Least share of the section between the walls that grains under gravity cover, seen from above: a bed covers nearly all of
/// it, one layer of spheres at least half, and a heap in the middle of a wide box less.
const MIN_OCCUPIED_SHARE: f64 = 0.5;

/// Region between walls and periods, with its grains.
pub struct EnclosedRegion {
    pub kind: RegionKind,
    /// Volume, m^3.
    pub volume: f64,
    /// Indices of the grains with their centre inside, rising.
    pub members: Vec<GrainId>,
}

/// Walls and periods around grains.
///
/// A plane of wall faces bounds the space if nearly all grains are on its inner side and faces cover half of the side of the space
/// that lies in it. Under gravity the grains must fill the space from side to side.
pub struct GrainEnclosure<'a> {
    frame: &'a Frame,
    planes: Vec<WallPlane>,
    bores: Vec<CylinderBore>,
    /// Grains by which walls and periods were chosen.
    core: Vec<GrainId>,
    /// Centre of mass of these grains, m.
    centre: Vec3,
    /// Direction against uniform gravity, in a periodic scene along z; None without gravity, and if the scene repeats along z.
    up: Option<Vec3>,
    /// Mean diameter of the grains of the core, m.
    mean_diameter: f64,
}

/// Space of a bed between its walls.
struct BedSpace {
    /// Space below the surface.
    space: ConvexPolytope,
    surface: SurfacePlane,
    /// Area of the section of the space along the surface, m^2.
    section_area: f64,
}

/// Walls that bound a bed.
pub struct BedWalls {
    pub planes: Vec<WallPlane>,
    pub bores: Vec<CylinderBore>,
}

impl<'a> GrainEnclosure<'a> {
    /// Returns the walls and periods around the grains of a frame; None without walls and periods, and if nothing
    /// touches walls while self-gravity binds the grains.
    pub fn from_frame(frame: &'a Frame, fragments: &[Fragment]) -> Option<GrainEnclosure<'a>> {
        let cell = frame.cell();
        if frame.grains.is_empty() || frame.walls.is_empty() && !cell.is_periodic() {
            return None;
        }
        let supported = supported_grains(frame, fragments);
        if supported.is_empty() && self_gravity_constant(frame).is_some() && !cell.is_periodic() {
            return None;
        }
        let mass = |grains: &[GrainId]| grains.iter().map(|&i| frame.grains[i].mass).sum::<f64>();
        // Half of the mass or half of the grains: a lander may be heavier than the bed below it.
        let has_half =
            |grains: &[GrainId]| 2.0 * mass(grains) >= frame.total_mass() || 2 * grains.len() >= frame.grains.len();
        // If no wall touches a grain, the largest fragment: ejecta do not count.
        let largest = fragments.first().map_or(&[][..], |first| &first.grains);
        let core = [&supported[..], if supported.is_empty() { largest } else { &[] }]
            .into_iter()
            .find(|grains| has_half(grains));
        let core = core.map_or_else(|| frame.grain_ids().collect(), <[GrainId]>::to_vec);
        Some(GrainEnclosure::from_core(frame, core))
    }

    /// Returns the walls and periods around some grains, at least one.
    pub fn from_core(frame: &'a Frame, core: Vec<GrainId>) -> GrainEnclosure<'a> {
        let grains = || core.iter().map(|&i| &frame.grains[i]);
        let against_gravity = (-Vec3::from(frame.meta.parameters.uniform_gravity)).try_normalize(0.0);
        GrainEnclosure {
            frame,
            planes: bounding_planes(frame, &core),
            bores: frame.wall_ids().filter_map(|k| bounding_bore(frame, k, &core)).collect(),
            centre: centre_of_mass(grains()),
            up: against_gravity
                .filter(|_| frame.cell().periods[2].is_none())
                .map(|against_gravity| if frame.cell().is_periodic() { Vec3::z() } else { against_gravity }),
            mean_diameter: 2.0 * grains().map(|g| g.radius).sum::<f64>() / core.len() as f64,
            core,
        }
    }

    /// Whether a point (m) is inside of all planes and hollow cylinders.
    fn is_inside(&self, x: &Vec3) -> bool {
        self.planes.iter().all(|plane| plane.is_on_inner_side(x))
            && self.bores.iter().all(|bore| bore.contains_point(x))
    }

    /// Grains of the core with their centre inside.
    fn inner_grains(&self) -> impl Iterator<Item = &'a Grain> {
        self.core.iter().map(|&i| &self.frame.grains[i]).filter(|grain| self.is_inside(&grain.x))
    }

    /// Lowest and highest point of the grains along a direction, m.
    fn height_range(&self, axis: &Vec3) -> [f64; 2] {
        let ends = self.inner_grains().map(|grain| height_range(grain, axis));
        ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [l, h]| [low.min(l), high.max(h)])
    }

    /// Space between the periods, hollow cylinders and planes.
    fn space(&self) -> ConvexPolytope {
        // The initial cube exceeds all walls by far, so that a side without a wall stays open.
        let grains = self.core.iter().map(|&i| &self.frame.grains[i]);
        let grain_extent = grains.map(|g| (g.x - self.centre).norm() + g.bounding_radius()).fold(0.0, f64::max);
        let planes = self.planes.iter().map(|plane| (plane.offset - plane.normal.dot(&self.centre)).abs());
        let outer_length = 64.0 * planes.chain(self.bores.iter().map(|bore| bore.radius)).fold(grain_extent, f64::max);
        let mut space = ConvexPolytope::cube(self.centre, outer_length);
        let periods = self.frame.cell().periods;
        for (axis, period) in periods.iter().enumerate().filter_map(|(axis, period)| Some((axis, (*period)?))) {
            space.cut_below(&Vec3::ith(axis, 1.0), -0.5 * period);
            space.cut_below(&Vec3::ith(axis, -1.0), -0.5 * period);
        }
        for plane in &self.planes {
            space.cut_below(&plane.normal, plane.offset);
        }
        for bore in &self.bores {
            let first = bore.axis.cross(&Vec3::ith(bore.axis.iamin(), 1.0)).normalize();
            let second = bore.axis.cross(&first);
            let sector_angle = std::f64::consts::TAU / POLYGON_SIDES as f64;
            let apothem = bore.radius * (0.5 * sector_angle / (0.5 * sector_angle).tan()).sqrt();
            for k in 0..POLYGON_SIDES {
                let (sin, cos) = (sector_angle * k as f64).sin_cos();
                let inward = -(first * cos + second * sin);
                space.cut_below(&inward, inward.dot(&bore.x) - apothem);
            }
        }
        space
    }

    /// Returns the space between walls and periods, with its open ends cut off by `cut`, and the value of `cut`; None
    /// if the space is still open.
    ///
    /// A plane bounds only where its faces are: while faces cover less than half of a side of the space, the plane with the
    /// least share is removed. So rims of tiles, plates that hang elsewhere and posts bound nothing. Planes for which
    /// `is_checked` is false are kept.
    fn covered_space<T>(
        &mut self,
        is_checked: impl Fn(&WallPlane) -> bool,
        cut: impl Fn(&GrainEnclosure, &mut ConvexPolytope) -> T,
    ) -> Option<(ConvexPolytope, T)> {
        loop {
            let mut space = self.space();
            let cut = cut(self, &mut space);
            if !space.is_closed() {
                return None;
            }
            // A grain cannot leave through a gap of its radius.
            let margin = 0.5 * self.mean_diameter;
            let share = |plane: &WallPlane| match space.face_on(&plane.normal, plane.offset) {
                Some(side) if is_checked(plane) => plane.covered_share(side, margin),
                _ => 1.0,
            };
            let shares: Vec<f64> = self.planes.iter().map(share).collect();
            let smallest = shares.iter().copied().fold(1.0, f64::min);
            if smallest >= MIN_COVERED_SHARE {
                return Some((space, cut));
            }
            let mut shares = shares.into_iter();
            self.planes.retain(|_| shares.next().is_some_and(|share| share > smallest));
        }
    }

    /// Space that walls and periods enclose around the grains; `None` if it is open.
    pub fn into_region(self) -> Option<EnclosedRegion> {
        match self.up {
            Some(up) => self.into_region_under_gravity(&up),
            None => self.into_weightless_region(),
        }
    }

    /// [`Self::into_region`] without uniform gravity, or of a scene that repeats along z: along axes without a period a
    /// periodic cell ends at the lowest and the highest grain.
    fn into_weightless_region(mut self) -> Option<EnclosedRegion> {
        let cell = self.frame.cell();
        let (space, limits) = self.covered_space(
            |_| true,
            |enclosure, space| {
                if cell.is_closed() {
                    return Some([f64::NEG_INFINITY, f64::INFINITY]);
                }
                if !cell.is_periodic() || space.is_closed() {
                    return None;
                }
                for axis in (0..3).filter(|&axis| cell.periods[axis].is_none()) {
                    let axis = Vec3::ith(axis, 1.0);
                    let [low, high] = enclosure.height_range(&axis);
                    space.cut_below(&axis, low);
                    space.cut_below(&-axis, -high);
                }
                let whole_range = [f64::NEG_INFINITY, f64::INFINITY];
                Some(cell.periods[2].map_or_else(|| enclosure.height_range(&Vec3::z()), |_| whole_range))
            },
        )?;
        let kind = if limits.is_some() { RegionKind::Cell } else { RegionKind::Walls };
        let [low, high] = limits.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let members = self.members_inside(|x| self.is_inside(x) && (low..=high).contains(&x.z));
        Some(EnclosedRegion { kind, volume: space.volume(), members })
    }

    /// Returns the space below the mean surface of grains under gravity; None if the space is open, or if the grains are a
    /// heap that does not fill it from side to side.
    /// `self` keeps the planes that bound it or lie beyond it.
    fn bed_space(&mut self, up: &Vec3) -> Option<BedSpace> {
        let (space, surface) = self.covered_space(
            |_| true,
            |enclosure, space| {
                let grains: Vec<&Grain> = enclosure.inner_grains().collect();
                let surface = mean_plane(&grains, &enclosure.planes, &enclosure.bores, &enclosure.frame.cell(), up)?;
                let section_area = space.cut_below(&-surface.normal, -surface.normal.dot(&surface.point));
                if !space.is_closed() {
                    let [lowest, _] = enclosure.height_range(up);
                    space.cut_below(up, lowest);
                }
                Some((surface, section_area))
            },
        )?;
        let (surface, section_area) = surface?;
        if !self.frame.cell().is_periodic() && !self.is_filled(&space, &surface, section_area * surface.normal.dot(up))
        {
            return None;
        }
        Some(BedSpace { space, surface, section_area })
    }

    /// Whether a grain is within a mean diameter of each wall that bounds the space, and the grains cover half of the
    /// section, whose area (m^2) is as seen from above.
    fn is_filled(&self, space: &ConvexPolytope, surface: &SurfacePlane, section_area: f64) -> bool {
        let near_plane = |plane: &WallPlane| {
            let gap = |grain: &Grain| height_range(grain, &plane.normal)[0] - plane.offset;
            self.inner_grains().any(|grain| gap(grain) <= self.mean_diameter)
        };
        let near_bore = |bore: &CylinderBore| {
            let gap = |grain: &Grain| bore.radius - bore.offset_from_axis(&grain.x).norm() - grain.bounding_radius();
            self.inner_grains().any(|grain| gap(grain) <= self.mean_diameter)
        };
        surface.area >= MIN_OCCUPIED_SHARE * section_area
            && self.planes.iter().filter(|p| space.face_on(&p.normal, p.offset).is_some()).all(near_plane)
            && self.bores.iter().all(near_bore)
    }

    fn into_region_under_gravity(mut self, up: &Vec3) -> Option<EnclosedRegion> {
        let BedSpace { space, surface, section_area } = self.bed_space(up)?;
        let volume = space.volume();
        // A lid is checked as a side of the whole space; the sides above the grains need not reach up to it.
        let whole_space = self.covered_space(|plane| plane.normal.dot(up) < 0.0, |_, _| ());
        if let Some((whole_space, ())) = whole_space
            && whole_space.volume() - volume <= section_area * self.mean_diameter
        {
            let members = self.members_inside(|x| self.is_inside(x));
            return Some(EnclosedRegion { kind: RegionKind::Walls, volume: whole_space.volume(), members });
        }
        let is_below_surface = |x: &Vec3| (x - surface.point).dot(&surface.normal) <= 0.0;
        let is_in_core = |i: &GrainId| self.core.binary_search(i).is_ok();
        let is_member = |i: &GrainId| {
            let x = &self.frame.grains[*i].x;
            self.is_inside(x) && (is_in_core(i) || is_below_surface(x))
        };
        let members = self.frame.grain_ids().filter(is_member).collect();
        Some(EnclosedRegion { kind: RegionKind::Bed, volume, members })
    }

    /// Returns the walls that bound a bed of these grains, without those beyond it; None if they do not enclose one.
    pub fn into_bed_walls(mut self) -> Option<BedWalls> {
        let BedSpace { space, .. } = self.bed_space(&self.up?)?;
        self.planes.retain(|plane| space.face_on(&plane.normal, plane.offset).is_some());
        Some(BedWalls { planes: self.planes, bores: self.bores })
    }

    fn members_inside(&self, is_inside: impl Fn(&Vec3) -> bool) -> Vec<GrainId> {
        self.frame.grain_ids().filter(|&i| is_inside(&self.frame.grains[i].x)).collect()
    }

    /// Returns the layer between two heights (m) above the lowest point of the space, or of the grains if the space is open
    /// below, and its volume; None if a side is open.
    pub fn into_layer(mut self, from: f64, to: f64) -> Option<(ConvexRegion, f64)> {
        let up = self.up.unwrap_or(Vec3::z());
        let (space, floor) = self.covered_space(
            |_| true,
            |enclosure, space| {
                let [lowest, _] = enclosure.height_range(&up);
                let floor = space.lowest_height(&up).unwrap_or(lowest);
                space.cut_below(&up, floor + from);
                space.cut_below(&-up, -(floor + to));
                floor
            },
        )?;
        Some((ConvexRegion::Layer { up, from: floor + from, to: floor + to }, space.volume()))
    }
}
