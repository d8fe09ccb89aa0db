//! Clumps, rigid bodies of balls that may overlap: in their principal axes about their centres of mass, oriented copies of
//! them, and clumps from files.

use std::path::Path;
use std::sync::Arc;

use cd_formats::error::{Fault, Faults};
use cd_formats::names::count_text;
use cd_formats::report::MAX_MAGNITUDE;
use cd_formats::surface::MassProperties;
use nalgebra::{Matrix3, Vector3};

use crate::particles::read_particles;
use crate::rounding::{round_8_digits, round_axes, round_point};
use crate::scene::ModelScale;
use crate::shapes::principal::CentredFrame;
use crate::shapes::union::{ClumpBall, union_properties};

/// Largest number of balls of a clump. Chosen: the balls of two clumps that are near are compared pair by pair in each step,
/// a million times at this number.
pub const MAX_CLUMP_BALLS: usize = 1000;

/// Largest distance of a point of a clump from the origin of its axes, m: its moments, up to the fifth power of it, do not
/// overflow.
const MAX_CLUMP_EXTENT: f64 = MAX_MAGNITUDE;

/// Balls that make no clump: what was found and what is expected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BallsError {
    pub found: String,
    pub expected: String,
}

impl std::fmt::Display for BallsError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}; expected {}", self.found, self.expected)
    }
}

impl std::error::Error for BallsError {}

/// Clump of density 1 in its principal axes about its centre of mass.
#[derive(Debug, Clone, PartialEq)]
pub struct PrincipalClump {
    pub balls: Vec<ClumpBall>,
    /// Volume, m^3.
    pub volume: f64,
    /// Distance of the farthest point from the centre of mass, m.
    pub reach: f64,
    /// Centre of mass and principal axes in the axes in which the balls were given.
    pub frame: CentredFrame,
}

impl PrincipalClump {
    /// Clump whose mass is that of the union of its balls.
    pub fn from_union(balls: &[ClumpBall]) -> PrincipalClump {
        PrincipalClump::new(balls, &union_properties(balls))
    }

    /// Clump of these balls with the given volume, centre and inertia, all in the same axes.
    pub fn new(balls: &[ClumpBall], properties: &MassProperties) -> PrincipalClump {
        let centre = Vector3::from(properties.centre);
        let reach = balls.iter().map(|ball| (ball.centre - centre).norm() + ball.radius).fold(0.0, f64::max);
        let frame = CentredFrame::from_properties(properties, reach);
        let balls = balls.iter().map(|ball| ClumpBall { centre: frame.centred_point(&ball.centre), ..*ball }).collect();
        PrincipalClump { balls, volume: properties.volume, reach, frame }
    }

    /// Radius of the sphere of equal volume, m.
    pub fn equivalent_radius(&self) -> f64 {
        libm::cbrt(0.75 * self.volume / std::f64::consts::PI)
    }
}

/// Clump of some size in its orientation; numbers have the digits of the files.
#[derive(Debug, Clone, PartialEq)]
pub struct OrientedClump {
    pub clump: Arc<PrincipalClump>,
    /// Factor of all lengths of the clump.
    pub scale: f64,
    /// Principal axes along the fixed axes, one a row.
    pub axes: Matrix3<f64>,
}

impl OrientedClump {
    /// Clump rotated by `rotation`, from the axes in which the balls were given to the fixed ones.
    pub fn new(clump: Arc<PrincipalClump>, scale: f64, rotation: &Matrix3<f64>) -> Self {
        let axes = round_axes(&(clump.frame.axes * rotation.transpose()));
        OrientedClump { clump, scale, axes }
    }

    /// Volume, m^3.
    pub fn volume(&self) -> f64 {
        self.scale.powi(3) * self.clump.volume
    }

    /// Principal moments at density 1, m^5.
    pub fn moments(&self) -> [f64; 3] {
        self.clump.frame.moments.map(|moment| self.scale.powi(5) * moment)
    }

    /// Balls along the principal axes, m.
    pub fn balls(&self) -> impl Iterator<Item = ClumpBall> {
        self.clump.balls.iter().map(|ball| ClumpBall {
            centre: round_point(&(self.scale * ball.centre)),
            radius: round_8_digits(self.scale * ball.radius),
        })
    }

    /// Distance of the farthest point from the centre of mass, m.
    pub fn reach(&self) -> f64 {
        self.balls().map(|ball| ball.centre.norm() + ball.radius).fold(0.0, f64::max)
    }
}

/// Checks that balls make a clump.
///
/// Errors: fewer than two balls or more than [`MAX_CLUMP_BALLS`], one that lies within another, or balls so far from the
/// origin that moments overflow.
pub fn check_balls(balls: &[ClumpBall]) -> Result<(), BallsError> {
    if !(2..=MAX_CLUMP_BALLS).contains(&balls.len()) {
        let expected = format!("2 to {MAX_CLUMP_BALLS} balls");
        return Err(BallsError { found: count_text(balls.len(), "ball"), expected });
    }
    let extent = balls.iter().map(|ball| ball.centre.norm() + ball.radius).fold(0.0, f64::max);
    if extent > MAX_CLUMP_EXTENT {
        let (found, expected) = (format!("a clump of {extent:e} m"), format!("at most {MAX_CLUMP_EXTENT:e} m"));
        return Err(BallsError { found, expected });
    }
    let is_within = |inner: &ClumpBall, outer: &ClumpBall| {
        (inner.centre - outer.centre).norm() + inner.radius <= outer.radius * (1.0 + f64::EPSILON)
    };
    for (k, inner) in balls.iter().enumerate() {
        if let Some(outer) = balls.iter().enumerate().position(|(j, outer)| j != k && is_within(inner, outer)) {
            let found = format!("ball {} lies within ball {}", k + 1, outer + 1);
            let expected = "no ball within another: leave out the inner one, which adds nothing".to_string();
            return Err(BallsError { found, expected });
        }
    }
    Ok(())
}

/// Clump of the balls of a file, of the size that `scale` says, and notes on it.
///
/// Errors: the faults of the file, and balls that make no clump.
pub fn read_clump(folder: &Path, file: &str, scale: ModelScale) -> Result<(PrincipalClump, String), Faults> {
    let path = folder.join(file);
    let file_fault =
        |found: String, expected: &str| Fault::new(&path, None, "balls", found, format!("expected {expected}"));
    let particles = read_particles(&path, None)?;
    let Some(radii) = particles.radii else {
        return Err(file_fault("no radii".to_string(), "a column r, m").into());
    };
    let balls = particles.centres.into_iter().zip(radii).map(|(centre, radius)| ClumpBall { centre, radius });
    let mut balls: Vec<ClumpBall> = balls.collect();
    let expect_clump = |balls: &[ClumpBall]| {
        check_balls(balls).map_err(|BallsError { found, expected }| Faults::from(file_fault(found, &expected)))
    };
    expect_clump(&balls)?;
    let factor = scale_factor(&balls, scale);
    if factor != 1.0 {
        let scaled_ball = |ball: &ClumpBall| ClumpBall { centre: factor * ball.centre, radius: factor * ball.radius };
        balls = balls.iter().map(scaled_ball).collect();
        expect_clump(&balls)?;
    }
    let clump = PrincipalClump::from_union(&balls);
    let summary = format!("{file}: {} balls, {:.6e} m^3", balls.len(), clump.volume);
    Ok((clump, summary))
}

/// Factor from the lengths of the balls to the requested size.
fn scale_factor(balls: &[ClumpBall], scale: ModelScale) -> f64 {
    let volume = || union_properties(balls).volume;
    match scale {
        ModelScale::Factor(factor) => factor,
        ModelScale::Volume(requested) => libm::cbrt(requested / volume()),
        ModelScale::Radius(radius) => radius / libm::cbrt(0.75 * volume() / std::f64::consts::PI),
        ModelScale::Length(length) => {
            let side = |k: usize| {
                let high = balls.iter().map(|ball| ball.centre[k] + ball.radius).fold(f64::NEG_INFINITY, f64::max);
                high - balls.iter().map(|ball| ball.centre[k] - ball.radius).fold(f64::INFINITY, f64::min)
            };
            length / side(0).max(side(1)).max(side(2))
        }
    }
}
