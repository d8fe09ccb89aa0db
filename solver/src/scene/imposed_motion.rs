//! Imposed velocities and loads of bodies, and the servos of walls: pressures on their current area, strain rates, rotation
//! about a point, and velocities of their surfaces.

use cd_formats::drv_dof::Evolution;
use cd_formats::hollow_radius::RadiusControl;
use cd_formats::ids::BodyId;

use crate::math::{Quat, Twist, Vec3, rotate_by_vector};

/// Imposed velocity of a body: components along the fixed axes, then about the body's axes; `None` for components without
/// imposed motion.
#[derive(Debug, Clone)]
pub struct ImposedVelocity {
    pub body: BodyId,
    /// m/s, and rad/s about the body's axes.
    pub velocity: [Option<Evolution>; 6],
    /// Strain rate of a plate or cylinder; its component of `velocity` is 0.
    pub strain: Option<Box<StrainDrive>>,
    /// Point about which the body turns with its imposed angular velocity; its translation follows from that.
    pub pivot: Option<WallPivot>,
    /// Centre of mass of a wall that turns freely about an axis through its position, in the axes of the body, m; its weight
    /// acts there.
    pub hinged_centre: Option<Vec3>,
    /// Velocity of the surface beyond that of the body, components as of `velocity`.
    pub surface: Option<Box<[Option<Evolution>; 6]>>,
    /// Bound on the radial speed of a hollow cylinder whose radius changes, m/s; 0 of others.
    pub radial_speed: f64,
}

/// Hollow cylinder whose radius changes.
#[derive(Debug, Clone, Copy)]
pub struct ChangingRadius {
    pub body: BodyId,
    pub control: RadiusControl,
    /// Axis in the frame of the body.
    pub axis: Vec3,
    /// Ends of its inside along the axis and against it: plates, or its own ends.
    pub ends: [AreaSide; 2],
    /// Least radius into which the bodies fit that can touch it, m.
    pub least: f64,
}

impl ChangingRadius {
    /// Height of the inside between the plates, with bodies at `x` (m), m; at most that of the cylinder.
    pub fn height(&self, x: &[Vec3]) -> f64 {
        let centre = &x[self.body.index()];
        self.ends.iter().map(|end| end.reach(centre, x)).sum()
    }

    /// Area of the inside without the ends at a `radius` (m), with bodies at `x` (m), m².
    pub fn area(&self, radius: f64, x: &[Vec3]) -> f64 {
        std::f64::consts::TAU * radius * self.height(x)
    }
}

/// Strain rate of a plate, or of the end of a solid cylinder: the rate of its distance D from a plate opposite to it, d ln D/dt.
#[derive(Debug, Clone)]
pub struct StrainDrive {
    /// Fixed axis along which it moves, 0 to 2.
    pub component: usize,
    /// 1/s
    pub rate: Evolution,
    /// The plate opposite to it, whose velocity along the axis is imposed.
    pub opposite: BodyId,
    /// Distance between the centres at which the faces touch, along the axis from the opposite plate, m; with sign.
    pub closed_distance: f64,
}

/// Point about which a wall turns.
#[derive(Debug, Clone, Copy)]
pub struct WallPivot {
    /// m
    pub point: Vec3,
    /// Position of the centre from the point in the axes of the body, m.
    pub offset: Vec3,
}

/// Motion of the surface of a body beyond that of the body, world frame: m/s at the centre, rad/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceMotion {
    pub body: BodyId,
    pub v: Vec3,
    pub w: Vec3,
    /// Growth of a hollow cylinder.
    pub growth: Option<RadialGrowth>,
}

/// Growth of a hollow cylinder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadialGrowth {
    /// Axis in fixed axes.
    pub axis: Vec3,
    /// Radial speed of the inside, m/s, > 0 outwards.
    pub speed: f64,
}

impl RadialGrowth {
    /// Whether a contact with this normal is on the round side: its normal is across the axis, that of an end along it.
    pub fn is_side(axis: &Vec3, n: &Vec3) -> bool {
        n.dot(axis).abs() <= 0.5
    }

    /// Velocity of the inside at a contact with the normal `n`, which points inwards on the round side, m/s.
    fn velocity(&self, n: &Vec3) -> Vec3 {
        if Self::is_side(&self.axis, n) { n * -self.speed } else { Vec3::zeros() }
    }
}

impl ImposedVelocity {
    /// Imposed components without servos.
    pub fn new(body: BodyId, velocity: [Option<Evolution>; 6]) -> ImposedVelocity {
        ImposedVelocity {
            body,
            velocity,
            strain: None,
            pivot: None,
            hinged_centre: None,
            surface: None,
            radial_speed: 0.0,
        }
    }

    /// Whether some component, or the surface, is ever other than at rest.
    pub fn ever_moves(&self) -> bool {
        self.velocity.iter().any(|component| *component != Some(Evolution::constant(0.0)))
            || self.depends_on_position()
            || self.surface.is_some()
            || self.radial_speed > 0.0
    }

    /// Whether the velocity depends on positions, so that it changes also while all functions of time are constant.
    pub fn depends_on_position(&self) -> bool {
        self.strain.is_some() || self.pivot.is_some()
    }

    /// Angular velocities of the body and of its surface about one of its axes.
    pub fn rates_about(&self, axis: usize) -> impl Iterator<Item = &Evolution> {
        let surface = self.surface.iter().filter_map(move |components| components[3 + axis].as_ref());
        self.velocity[3 + axis].iter().chain(surface)
    }

    /// All its functions of time.
    pub fn functions(&self) -> impl Iterator<Item = &Evolution> {
        let surface = self.surface.iter().flat_map(|components| components.iter().flatten());
        self.velocity.iter().flatten().chain(self.strain.iter().map(|strain| &strain.rate)).chain(surface)
    }

    /// Motion (world frame) at a time (s) of the body with the orientation `q`, without its servos. Components that are not
    /// imposed are those of `pushed`.
    pub(super) fn motion_of_components(&self, time: f64, q: &Quat, pushed: &Twist) -> Twist {
        let imposed_component =
            |k: usize, pushed: f64| self.velocity[k].as_ref().map_or(pushed, |value| value.value_at(time));
        let v = Vec3::from_fn(|k, _| imposed_component(k, pushed.v[k]));
        if self.velocity[3..].iter().all(Option::is_none) {
            return Twist { v, w: pushed.w };
        }
        let own = q.inverse_transform_vector(&pushed.w);
        Twist { v, w: q * Vec3::from_fn(|k, _| imposed_component(3 + k, own[k])) }
    }
}

impl StrainDrive {
    /// Velocity of the plate at `x`, relative to the plate opposite to it at `opposite_x` (m), that changes their distance by the
    /// factor exp(rate h) in the time `h`, s; for h = 0 rate times distance. m/s
    ///
    /// At the rate -0.5 1/s and h = 1 s a distance of 2 m becomes 1.213 m, with a velocity of 0.787 m/s.
    pub(super) fn relative_velocity(&self, time: f64, x: &Vec3, opposite_x: &Vec3, h: f64) -> f64 {
        let distance = x[self.component] - opposite_x[self.component] - self.closed_distance;
        let rate = self.rate.value_at(time);
        distance * if h > 0.0 { libm::expm1(rate * h) / h } else { rate }
    }
}

impl WallPivot {
    /// Velocity of the centre `x` (m) of a body with the orientation `q` and the angular velocity `w` (rad/s, world frame) that
    /// takes it in the time `h` (s) to its position on the circle about the point; for h = 0 the tangent. m/s
    pub(super) fn centre_velocity(&self, x: &Vec3, q: &Quat, w: &Vec3, h: f64) -> Vec3 {
        if h == 0.0 {
            return w.cross(&(x - self.point));
        }
        (self.point + rotate_by_vector(q, &(w * h)) * self.offset - x) / h
    }
}

impl SurfaceMotion {
    /// Velocity of the surface at the distance `arm` (m) from the centre, without its part along the normal `n` but that of a
    /// growth, m/s.
    pub fn velocity(&self, arm: &Vec3, n: &Vec3) -> Vec3 {
        let v = self.v + self.w.cross(arm);
        let tangential = v - n * n.dot(&v);
        self.growth.map_or(tangential, |growth| tangential + growth.velocity(n))
    }

    /// Velocity of a growth along the normal `n`, m/s.
    pub fn normal_velocity(&self, n: &Vec3) -> f64 {
        self.growth.map_or(0.0, |growth| growth.velocity(n).dot(n))
    }
}

/// An imposed force component (0 to 2, N) or moment (3 to 5, about the body's axes, N m).
#[derive(Debug, Clone)]
pub struct ImposedLoad {
    pub body: BodyId,
    pub component: usize,
    /// Force or moment, or pressure, Pa, if it has an area.
    pub value: Evolution,
    /// Area on which a pressure acts.
    pub area: Option<PressedArea>,
}

/// Area of a wall on which a pressure acts.
#[derive(Debug, Clone)]
pub enum PressedArea {
    /// The same area at all times, m².
    Constant(f64),
    /// Rectangle on a plate; the sides along its first and second axis.
    Rectangle(Box<[[AreaSide; 2]; 2]>),
    /// Section of a hollow cylinder whose radius changes.
    Section(BodyId),
    /// Inside of such a cylinder without its ends.
    Inside(ChangingRadius),
}

/// Side of the rectangle on which a pressure acts.
#[derive(Debug, Clone, Copy)]
pub struct AreaSide {
    /// Unit vector from the centre of the plate to the side, world frame.
    pub direction: Vec3,
    /// Half length of the plate, m.
    pub half_length: f64,
    /// Plate that bounds the side, and half of its thickness, m.
    pub neighbour: Option<(BodyId, f64)>,
}

impl ImposedLoad {
    /// Force or moment at the `value` of its function, with bodies at `x` (m) and the `radius` of hollow cylinders, m; N or N m.
    pub fn load_at(&self, value: f64, x: &[Vec3], radius: impl Fn(BodyId) -> f64) -> f64 {
        self.area.as_ref().map_or(value, |area| value * area.size(self.body, x, radius))
    }
}

/// Area of a wall whose pressure a probe follows, and the fixed axis along its normal, 0 to 2.
#[derive(Debug, Clone)]
pub struct WallArea {
    pub body: BodyId,
    pub axis: usize,
    pub area: PressedArea,
}

impl PressedArea {
    /// Area of the wall `body`, with bodies at `x` (m) and the `radius` of hollow cylinders, m; m².
    pub fn size(&self, body: BodyId, x: &[Vec3], radius: impl Fn(BodyId) -> f64) -> f64 {
        match self {
            PressedArea::Constant(area) => *area,
            PressedArea::Section(drum) => std::f64::consts::PI * radius(*drum) * radius(*drum),
            PressedArea::Inside(changing) => changing.area(radius(body), x),
            PressedArea::Rectangle(sides) => {
                let extent = |side: &AreaSide| side.extent(&x[body.index()], x);
                let lengths = sides.map(|[one, other]| extent(&one) + extent(&other));
                lengths[0] * lengths[1]
            }
        }
    }
}

impl AreaSide {
    /// Distance of the side from the `centre` of the plate: to the face of the neighbour or the edge of the plate, m; negative
    /// if the neighbour has passed the centre.
    fn reach(&self, centre: &Vec3, x: &[Vec3]) -> f64 {
        let distance =
            |(body, half_thickness): (BodyId, f64)| (x[body.index()] - centre).dot(&self.direction) - half_thickness;
        self.neighbour.map_or(f64::INFINITY, distance).min(self.half_length)
    }

    /// [`Self::reach`], never negative.
    fn extent(&self, centre: &Vec3, x: &[Vec3]) -> f64 {
        self.reach(centre, x).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inside_of_a_cylinder_ends_at_its_plates() {
        use cd_formats::deforming_cell::AxisControl;
        let z = Vec3::z();
        let plate = |number: usize| Some((BodyId::new(number), 0.1));
        let changing = |neighbours: [Option<(BodyId, f64)>; 2]| ChangingRadius {
            body: BodyId::new(0),
            control: RadiusControl { body: 1, control: AxisControl::Rate(0.0) },
            axis: z,
            ends: [(z, neighbours[0]), (-z, neighbours[1])].map(|(direction, neighbour)| AreaSide {
                direction,
                half_length: 2.0,
                neighbour,
            }),
            least: 0.0,
        };
        let heights = |neighbours, upper: f64| changing(neighbours).height(&[Vec3::zeros(), z * upper, z * -1.5]);
        let is_near = |found: f64, expected: f64| (found - expected).abs() < 1e-15;
        assert_eq!(heights([None, None], 1.0), 4.0);
        assert!(is_near(heights([plate(1), plate(2)], 1.0), 0.9 + 1.4));
        // A plate beyond the end of the cylinder, and one that has passed the centre.
        assert!(is_near(heights([plate(1), None], 5.0), 4.0));
        assert!(is_near(heights([plate(1), plate(2)], -0.5), 1.4 - 0.6));
        let area = changing([None, None]).area(0.5, &[Vec3::zeros()]);
        assert!(is_near(area, 4.0 * std::f64::consts::PI), "{area}");
    }

    #[test]
    fn a_strain_changes_the_distance_exponentially() {
        let strain =
            StrainDrive { component: 2, rate: Evolution::constant(-0.5), opposite: BodyId(0), closed_distance: 0.25 };
        let (mut x, floor) = (Vec3::new(0.0, 0.0, 2.25), Vec3::zeros());
        for _ in 0..10 {
            x.z += 0.1 * strain.relative_velocity(0.0, &x, &floor, 0.1);
        }
        // Ten roundings.
        assert!((x.z - 0.25 - 2.0 * libm::exp(-0.5)).abs() < 1e-14, "{x}");
        assert_eq!(strain.relative_velocity(0.0, &Vec3::new(0.0, 0.0, 2.25), &floor, 0.0), -1.0);
    }

    #[test]
    fn a_pivot_keeps_the_centre_on_its_circle() {
        let (point, w, h) = (Vec3::new(1.0, -2.0, 3.0), Vec3::new(0.0, 0.3, 0.4), 0.25);
        let pivot = WallPivot { point, offset: Vec3::new(2.0, 0.0, 0.0) };
        let (mut x, mut q) = (point + pivot.offset, Quat::identity());
        for _ in 0..8 {
            x += pivot.centre_velocity(&x, &q, &w, h) * h;
            q = rotate_by_vector(&q, &(w * h));
        }
        let expected = point + rotate_by_vector(&Quat::identity(), &(w * 2.0)) * pivot.offset;
        assert!((x - expected).norm() < 1e-14, "{x}"); // eight roundings
    }

    #[test]
    fn sides_end_at_their_neighbours_or_at_the_edge() {
        let side = AreaSide { direction: Vec3::x(), half_length: 2.0, neighbour: Some((BodyId(1), 0.5)) };
        let extent = |neighbour: f64| side.extent(&Vec3::zeros(), &[Vec3::zeros(), Vec3::new(neighbour, 7.0, 0.0)]);
        assert_eq!([0.25, 1.5, 4.0].map(extent), [0.0, 1.0, 2.0]);
    }
}
