//! Options of the measurement of a case, as the command line gives them.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use clap::builder::RangedU64ValueParser;

use crate::axes::OutputAxes;
use crate::derive::MeasurementOptions;
use crate::derive::energy::PairSummation;
use crate::derive::free_surface::DEFAULT_SLOPE_REACH;
use crate::derive::impact::{BodyList, ImpactOptions};
use crate::derive::probe::Probe;
use crate::math::Vec3;

/// Value of a flag that is not a number of the required kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FlagNumberError {
    NotANumber,
    NotFinite,
    NotPositive,
    NotThree,
    NoDirection,
    NoInterval,
}

impl fmt::Display for FlagNumberError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            FlagNumberError::NotANumber => "expected a number",
            FlagNumberError::NotFinite => "expected a finite number",
            FlagNumberError::NotPositive => "expected a number > 0",
            FlagNumberError::NotThree => "expected three numbers X,Y,Z",
            FlagNumberError::NoDirection => "expected a vector other than 0,0,0",
            FlagNumberError::NoInterval => "expected a number from 1 to 86400",
        })
    }
}

impl std::error::Error for FlagNumberError {}

/// Reads a number of the command line. Errors: no number, or not finite.
pub fn parse_finite(text: &str) -> Result<f64, FlagNumberError> {
    let number: f64 = text.parse().map_err(|_| FlagNumberError::NotANumber)?;
    if number.is_finite() { Ok(number) } else { Err(FlagNumberError::NotFinite) }
}

/// Reads a positive number of the command line.
pub fn parse_positive(text: &str) -> Result<f64, FlagNumberError> {
    parse_finite(text).ok().filter(|number| *number > 0.0).ok_or(FlagNumberError::NotPositive)
}

/// Reads an interval, s. Errors: no number from 1 to 86400.
pub fn parse_interval(text: &str) -> Result<f64, FlagNumberError> {
    parse_finite(text).ok().filter(|number| (1.0..=86400.0).contains(number)).ok_or(FlagNumberError::NoInterval)
}

/// Reach of the planes whose angle is the slope of a surface.
#[derive(Debug, Clone, clap::Args)]
pub struct SlopeReach {
    /// Radius, in mean radii, within which planes are fitted to a surface for its slope; a smaller one resolves more of the
    /// shape, and of single grains [default: 12 for a heap or bed, 10 for an aggregate]
    #[arg(long, value_name = "RADII", allow_negative_numbers = true, value_parser = parse_positive)]
    pub slope_reach: Option<f64>,
}

/// Region and scale at which the observables of a series are measured.
#[derive(Debug, Clone, clap::Args)]
pub struct MeasurementFlags {
    /// Region in which coordination number Z, solid fraction nu, pressure and stress are measured: ball:RADIUS, box:X,Y,Z,
    /// cylinder:RADIUS,LENGTH or cylinder:RADIUS,LENGTH,AXIS_X,AXIS_Y,AXIS_Z with its centre at @X,Y,Z, @com or @largest, or
    /// layer:FROM,TO above the floor (m); default: chosen by the scene
    #[arg(long, value_name = "SHAPE")]
    pub region: Option<Probe>,
    #[command(flatten)]
    pub slope: SlopeReach,
}

impl Default for MeasurementFlags {
    /// Returns the values of a command line without flags.
    fn default() -> MeasurementFlags {
        MeasurementFlags { region: None, slope: SlopeReach { slope_reach: None } }
    }
}

/// Vector of the command line: three finite numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlagVector(pub Vec3);

impl FromStr for FlagVector {
    type Err = FlagNumberError;

    fn from_str(text: &str) -> Result<FlagVector, FlagNumberError> {
        let numbers: Vec<f64> = text.split(',').map(|part| parse_finite(part.trim())).collect::<Result<_, _>>()?;
        let &[x, y, z] = &numbers[..] else { return Err(FlagNumberError::NotThree) };
        Ok(FlagVector(Vec3::new(x, y, z)))
    }
}

/// Reads a direction of the command line, of any length above 0; the result has length 1.
fn parse_direction(text: &str) -> Result<FlagVector, FlagNumberError> {
    let FlagVector(vector) = text.parse()?;
    let largest = vector.amax();
    // Squares of components over the largest neither overflow nor vanish.
    if largest > 0.0 { Ok(FlagVector((vector / largest).normalize())) } else { Err(FlagNumberError::NoDirection) }
}

/// Projectile, target and axes of an impact.
#[derive(Debug, Clone, clap::Args)]
pub struct ImpactFlags {
    /// Bodies of the projectile: numbers in BODIES.DAT, such as 301 or 301,305-309, or colour:NAME
    #[arg(long, value_name = "BODIES")]
    pub projectile: BodyList,
    /// Bodies of the target, likewise; default: all grains but the projectile
    #[arg(long, value_name = "BODIES")]
    pub target: Option<BodyList>,
    /// Direction along which the momentum is measured; default: that of the projectile's velocity relative to the target
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_direction)]
    pub direction: Option<FlagVector>,
    /// Outward normal of the surface at the point of the impact; default: measured
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_direction)]
    pub normal: Option<FlagVector>,
    /// Point of the impact, m; default: where a straight trajectory meets the target
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub point: Option<FlagVector>,
    /// Distance from the target's centre of mass up to which grains belong to it, m; default: the remnant and the fragments bound
    /// to it; without self-gravity the remnant and the grains within the farthest point of the target before the impact
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = parse_positive)]
    pub within: Option<f64>,
    /// Speed above which ejecta escape, m/s; default: escape speed of the target
    #[arg(long, value_name = "M/S", allow_negative_numbers = true, value_parser = parse_positive)]
    pub escape_speed: Option<f64>,
}

impl ImpactFlags {
    /// Choices about the impact.
    pub fn impact_options(&self) -> ImpactOptions {
        let vector = |flag: Option<FlagVector>| flag.map(|FlagVector(vector)| vector);
        ImpactOptions {
            projectile: self.projectile.clone(),
            target: self.target.clone(),
            direction: vector(self.direction),
            normal: vector(self.normal),
            point: vector(self.point),
            target_radius: self.within,
            escape_speed: self.escape_speed,
        }
    }
}

/// Axes in which positions and velocities are written.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct AxesFlag {
    /// Axes of written positions and velocities in a run with orbits: those of the computation, which fall freely
    /// (computed), axes at rest (inertial), or axes about the mass of field N (primary:N)
    #[arg(long = "frame", value_name = "AXES", default_value_t = OutputAxes::Computed)]
    pub axes: OutputAxes,
}

/// Threads of the commands that compute from the snapshots of one case.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct ThreadCount {
    /// Number of threads; 0: all cores. Results do not depend on it
    #[arg(long, default_value_t = 0, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(..=1024))]
    pub threads: usize,
}

/// Format of the ParaView files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum VtkFormat {
    /// A file for each snapshot, kind.pvd with their times
    Vtp,
    /// A file for all snapshots, on HDF5; ParaView 5.12 or later
    Vtkhdf,
}

/// Options of the measurement of a case and of its files.
#[derive(Debug, Clone, clap::Args)]
pub struct SeriesOptions {
    /// Case folder
    #[arg(default_value = ".")]
    pub dir: PathBuf,
    /// Use every Nth snapshot, counted from the first, and the last
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    /// Write no plots and no pictures
    #[arg(long)]
    pub no_plots: bool,
    /// Write no ParaView files
    #[arg(long)]
    pub no_vtk: bool,
    /// Format of the ParaView files
    #[arg(long, value_enum, default_value_t = VtkFormat::Vtp, value_name = "FORMAT", conflicts_with = "no_vtk")]
    pub vtk_format: VtkFormat,
    /// Write ParaView files in pieces of at most this number of cells, which kind-NNNNNN.pvtp names
    #[arg(long, value_name = "CELLS", conflicts_with = "no_vtk", value_parser = RangedU64ValueParser::<usize>::new().range(1..))]
    pub piece_cells: Option<usize>,
    /// Compute the potential energy by the sum over all pairs, for any number of grains
    #[arg(long)]
    pub direct_gravity: bool,
    #[command(flatten)]
    pub measures: MeasurementFlags,
    #[command(flatten)]
    pub axes: AxesFlag,
    #[command(flatten)]
    pub threads: ThreadCount,
}

impl Default for SeriesOptions {
    /// Returns the options of a command line without flags.
    fn default() -> SeriesOptions {
        let dir = PathBuf::new();
        let (every, no_plots, no_vtk, direct_gravity) = (1, false, false, false);
        let (vtk_format, measures, threads) = (VtkFormat::Vtp, MeasurementFlags::default(), ThreadCount::default());
        let (piece_cells, axes) = (None, AxesFlag::default());
        SeriesOptions { dir, every, no_plots, no_vtk, vtk_format, piece_cells, direct_gravity, measures, axes, threads }
    }
}

impl SeriesOptions {
    /// Options of the observables themselves.
    pub fn measurement_options(&self) -> MeasurementOptions {
        let summation = if self.direct_gravity { PairSummation::Direct } else { PairSummation::Fast };
        let MeasurementFlags { region, slope } = self.measures.clone();
        MeasurementOptions { summation, region, slope_reach: slope.slope_reach.unwrap_or(DEFAULT_SLOPE_REACH) }
    }
}
