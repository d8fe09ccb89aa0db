//! Observables of a [`Frame`], one idea a file, and the row of `series.csv` that they make.
//!
//! | module | observables |
//! |---|---|
//! | [`coordination`] | contacts per grain, rattlers |
//! | [`region`], [`region_kind`], [`probe`] | the region of the means of solid fraction, stress and neighbours, and these means |
//! | [`enclosure`], [`walls`] | the space that walls and periods enclose around the grains |
//! | [`heights`], [`polytope`] | heights of grains; polygons and polyhedra that are cut by planes |
//! | [`hull`] | volume of the convex hull of balls |
//! | [`enclosing`] | the smallest ball around the grains |
//! | [`stress`] | stress of the whole and of each grain, pressure |
//! | [`fabric`] | directions of contacts, mobilised friction, distributions |
//! | [`energy`], [`gravity`] | kinetic and potential energies |
//! | [`changing_cylinder`] | radius of a hollow cylinder that changes, and the pressure on its inside |
//! | [`motion`] | centre of mass, momenta, spin, semi-axes |
//! | [`fragments`], [`orbits`] | fragments, sets of grains connected by contacts, and their orbits about the largest |
//! | [`bed`] | grains that rest between walls: level, solid fraction, layers |
//! | [`profile`] | means over spherical shells |
//! | [`surface`] | heights and slopes by direction |
//! | [`free_surface`] | heights and slopes of a heap or bed, by verticals |
//! | [`impact`], [`crater`] | momentum that an impact gives to its target, ejecta, size of the crater |
//! | [`plane_fit`] | planes through heights, and their noise |
//!
//! Every function takes grains in any number. A mean over nothing is 0/0, so a value that is not
//! defined comes out as NaN; the writers leave it blank.

pub mod bed;
pub mod changing_cylinder;
pub mod coordination;
pub mod crater;
pub mod enclosing;
pub mod enclosure;
pub mod energy;
pub mod fabric;
pub mod fragments;
pub mod free_surface;
pub mod gravity;
pub mod heights;
pub mod hull;
pub mod impact;
pub mod motion;
pub mod orbits;
pub mod plane_fit;
pub mod polytope;
pub mod probe;
pub mod profile;
pub mod region;
pub mod region_kind;
pub mod stress;
pub mod surface;
pub mod walls;

use cd_formats::geometry::periodic_cell::PeriodicCell;

use crate::frame::{Frame, GrainId};
use crate::math::Vec3;
use energy::PairSummation;
use free_surface::FreeSurface;
use probe::Probe;
use region::Region;

/// Value of a column of `series.csv`.
pub trait SeriesValue {
    /// Field of the table.
    fn text(&self) -> String;
    /// The value as a number; NaN if it is not defined.
    fn number(&self) -> f64;
}

impl SeriesValue for u64 {
    fn text(&self) -> String {
        self.to_string()
    }
    fn number(&self) -> f64 {
        *self as f64
    }
}

impl SeriesValue for f64 {
    /// The shortest decimal that reads back as the same number, 0 for -0; blank if there is none.
    fn text(&self) -> String {
        if self.is_finite() { format!("{:?}", self + 0.0) } else { String::new() }
    }
    fn number(&self) -> f64 {
        *self
    }
}

/// Condition on a scene for a column of `series.csv`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ColumnCondition {
    /// Every scene.
    Always,
    /// The scene has a deforming cell.
    DeformingCell,
    /// The scene has a hollow cylinder whose radius changes.
    ChangingRadius,
}

/// Defines [`Row`] with its columns: name, type, unit and meaning of each, in the order of the file. `if Condition`: the file
/// has the column only if the scene meets this [`ColumnCondition`].
macro_rules! columns {
    (@condition) => { ColumnCondition::Always };
    (@condition $condition:ident) => { ColumnCondition::$condition };
    ($($name:ident: $type:ty, $unit:literal, $help:literal $(if $condition:ident)?;)+) => {
        /// One row of `series.csv`: the observables of one snapshot.
        #[allow(non_snake_case)] // the symbols of the method are the names of the columns
        #[derive(Debug, Clone, PartialEq, Default)]
        pub struct Row { $(#[doc = concat!($help, "; unit: ", $unit)] pub $name: $type,)+ }

        impl Row {
            /// Name, unit and meaning of each column, in the order of the file.
            pub const COLUMNS: &'static [(&'static str, &'static str, &'static str)] =
                &[$((stringify!($name), $unit, $help),)+];

            /// Condition for each column of [`Row::COLUMNS`].
            pub const CONDITIONS: &'static [ColumnCondition] = &[$(columns!(@condition $($condition)?),)+];

            /// The fields of the line, in the order of [`Row::COLUMNS`].
            pub fn texts(&self) -> Vec<String> {
                vec![$(self.$name.text(),)+]
            }

            /// The values, in the order of [`Row::COLUMNS`]; NaN where undefined.
            pub fn numbers(&self) -> Vec<f64> {
                vec![$(self.$name.number(),)+]
            }
        }
    };
}

columns! {
    step: u64, "1", "number of the step";
    time: f64, "s", "time";
    n_contacts: u64, "1", "contacts between bodies that touch with force";
    Z: f64, "1", "mean number of neighbours that a grain of the region touches with force";
    Z_no_rattlers: f64, "1", "mean number of neighbours without rattlers, in the region";
    rattler_fraction: f64, "1", "share of the region's grains held by too few contacts";
    nu: f64, "1", "solid fraction of the region";
    region: u64, "1", "number of the region of Z, nu, pressure and stress";
    region_volume: f64, "m^3", "volume of the region";
    R_enclosing: f64, "m", "radius of the smallest enclosing ball";
    pressure: f64, "Pa", "a third of the trace of the mean stress of the region, > 0 compression";
    pressure_virial: f64, "Pa", "pressure of the region that balances the loads at rest";
    a: f64, "m", "longest semi-axis of the uniform ellipsoid of equal inertia";
    b: f64, "m", "middle semi-axis";
    c: f64, "m", "shortest semi-axis";
    Ec_mean: f64, "J", "kinetic energy per grain, translation and rotation";
    Ec_rot_mean: f64, "J", "kinetic energy of rotation per grain";
    E_grav: f64, "J", "potential energy of the self-gravity, 0 without";
    spin_x: f64, "rad/s", "angular velocity along x, of the rigid body of equal inertia and angular momentum";
    spin_y: f64, "rad/s", "angular velocity along y, of the rigid body of equal inertia and angular momentum";
    spin_z: f64, "rad/s", "angular velocity along z, of the rigid body of equal inertia and angular momentum";
    L_x: f64, "kg m^2/s", "angular momentum along x, about the centre of mass, own rotation of the grains included";
    L_y: f64, "kg m^2/s", "angular momentum along y, about the centre of mass, own rotation of the grains included";
    L_z: f64, "kg m^2/s", "angular momentum along z, about the centre of mass, own rotation of the grains included";
    n_fragments: u64, "1", "fragments: sets of grains connected by contacts";
    largest_fraction: f64, "1", "fraction of the mass in the largest remnant";
    n_grains: u64, "1", "grains";
    mass: f64, "kg", "mass of the grains";
    pressure_kinetic: f64, "Pa", "kinetic pressure in the region, of velocities relative to their mean";
    Ec_rigid_mean: f64, "J", "kinetic energy of the rigid motion of all grains together, per grain";
    E_uniform: f64, "J", "potential energy in the uniform gravity, 0 at the origin";
    E_fields: f64, "J", "potential energy in external fields";
    com_x: f64, "m", "centre of mass along x";
    com_y: f64, "m", "centre of mass along y";
    com_z: f64, "m", "centre of mass along z";
    P_x: f64, "kg m/s", "linear momentum along x";
    P_y: f64, "kg m/s", "linear momentum along y";
    P_z: f64, "kg m/s", "linear momentum along z";
    penetration: f64, "1", "largest penetration of the contacts over the mean radius";
    Z_constraints: f64, "1", "mean number of constraints per grain of the region: 3 for a face, 2 for an edge, 1 for a point";
    share_face: f64, "1", "share of the region's touching pairs that touch in a face";
    share_edge: f64, "1", "share of the region's touching pairs that touch in an edge";
    share_point: f64, "1", "share of the region's touching pairs that touch in a point";
    sigma_xx: f64, "Pa", "mean stress xx of the region, symmetric part, > 0 compression";
    sigma_yy: f64, "Pa", "mean stress yy of the region, symmetric part, > 0 compression";
    sigma_zz: f64, "Pa", "mean stress zz of the region, symmetric part, > 0 compression";
    sigma_xy: f64, "Pa", "mean stress xy of the region, symmetric part, > 0 compression";
    sigma_xz: f64, "Pa", "mean stress xz of the region, symmetric part, > 0 compression";
    sigma_yz: f64, "Pa", "mean stress yz of the region, symmetric part, > 0 compression";
    kinetic_xx: f64, "Pa", "kinetic stress xx in the region";
    kinetic_yy: f64, "Pa", "kinetic stress yy in the region";
    kinetic_zz: f64, "Pa", "kinetic stress zz in the region";
    kinetic_xy: f64, "Pa", "kinetic stress xy in the region";
    kinetic_xz: f64, "Pa", "kinetic stress xz in the region";
    kinetic_yz: f64, "Pa", "kinetic stress yz in the region";
    sqrt_J2: f64, "Pa", "root of the second invariant of the stress deviator";
    drucker_prager: f64, "1", "sqrt_J2 over the trace of the stress";
    friction_angle: f64, "rad", "angle of friction required by the mean stress";
    tensile_fraction: f64, "1", "share of the grains' volume in grains under tension";
    anisotropy: f64, "1", "anisotropy of the directions of the contacts";
    mobilised: f64, "1", "mean mobilised friction of touching contacts";
    sliding_fraction: f64, "1", "share of the touching contacts with friction that slide";
    largest_mass: f64, "kg", "mass of the largest remnant";
    largest_a: f64, "m", "longest semi-axis of the largest remnant";
    largest_b: f64, "m", "middle semi-axis of the largest remnant";
    largest_c: f64, "m", "shortest semi-axis of the largest remnant";
    largest_spin: f64, "rad/s", "angular velocity of the largest remnant";
    largest_period: f64, "s", "period of rotation of the largest remnant";
    bound_fraction: f64, "1", "fraction of the mass in other fragments bound to the largest remnant";
    escaping_fraction: f64, "1", "fraction of the mass in other fragments not bound to the largest remnant";
    E_total: f64, "J", "kinetic and potential energy";
    E_contacts: f64, "J", "work of all contacts of grains since the start";
    E_friction: f64, "J", "work of the tangential forces of these contacts since the start";
    E_shocks: f64, "J", "work of the normal forces of these contacts since the start";
    E_outside: f64, "J", "external work since the start";
    bed_height: f64, "m", "thickness of the uniform bed of equal centre of mass";
    bed_nu: f64, "1", "solid fraction of the bed";
    bed_pressure: f64, "Pa", "a third of the trace of the bed's mean stress, walls included";
    bed_stress_ratio: f64, "1", "horizontal over vertical stress of the bed";
    n_bonds: u64, "1", "contacts that a bond or a liquid bridge holds";
    surface_slope: f64, "rad", "slope of the free surface of a heap or bed";
    interval: f64, "s", "time since the previous snapshot";
    Z_interval: f64, "1", "mean number of neighbours that a grain of the region has touched with force since the previous snapshot";
    pressure_interval: f64, "Pa", "mean pressure of the region since the previous snapshot";
    bed_pressure_interval: f64, "Pa", "mean pressure of the bed since the previous snapshot";
    surface_slope_error: f64, "rad", "standard error of surface_slope due to single grains";
    nu_sphere: f64, "1", "solid fraction of the smallest enclosing ball of all grains";
    pressure_sphere: f64, "Pa", "pressure of the contacts between grains in the smallest enclosing ball of all grains";
    Z_all: f64, "1", "mean number of neighbours that a grain touches with force, of all grains";
    n_pulling: u64, "1", "pairs of bodies that only pull at a distance";
    cell_x: f64, "m", "length of a deforming cell along x" if DeformingCell;
    cell_y: f64, "m", "length of a deforming cell along y" if DeformingCell;
    cell_z: f64, "m", "length of a deforming cell along z" if DeformingCell;
    cell_xy: f64, "m", "shear of a deforming cell: x of its edge along y" if DeformingCell;
    cell_xz: f64, "m", "shear of a deforming cell: x of its edge along z" if DeformingCell;
    cell_yz: f64, "m", "shear of a deforming cell: y of its edge along z" if DeformingCell;
    strain_x: f64, "1", "logarithmic strain of a deforming cell along x since the start" if DeformingCell;
    strain_y: f64, "1", "logarithmic strain of a deforming cell along y since the start" if DeformingCell;
    strain_z: f64, "1", "logarithmic strain of a deforming cell along z since the start" if DeformingCell;
    strain_xy: f64, "1", "shear strain xy of a deforming cell since the start" if DeformingCell;
    strain_xz: f64, "1", "shear strain xz of a deforming cell since the start" if DeformingCell;
    strain_yz: f64, "1", "shear strain yz of a deforming cell since the start" if DeformingCell;
    cylinder_radius: f64, "m", "radius of the first hollow cylinder whose radius changes" if ChangingRadius;
    cylinder_pressure: f64, "Pa", "pressure of the contacts on the inside of this cylinder" if ChangingRadius;
}

/// User's choices about the observables.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasurementOptions {
    pub summation: PairSummation,
    /// Region of the means; None selects the one that fits the scene.
    pub region: Option<Probe>,
    /// Mean radii over which planes are fitted to the surface of a heap or bed.
    pub slope_reach: f64,
}

impl Default for MeasurementOptions {
    fn default() -> MeasurementOptions {
        MeasurementOptions {
            summation: PairSummation::default(),
            region: None,
            slope_reach: free_surface::DEFAULT_SLOPE_REACH,
        }
    }
}

impl MeasurementOptions {
    /// Region of a frame with these fragments.
    pub fn region(&self, frame: &Frame, fragments: &[fragments::Fragment]) -> Region {
        match &self.region {
            Some(probe) => Region::from_probe(frame, fragments, probe),
            None => Region::from_frame(frame, fragments),
        }
    }
}

impl Row {
    /// Calls [`Row::with_options`] with default options.
    pub fn from_frame(frame: &Frame) -> Row {
        Row::with_options(frame, &MeasurementOptions::default())
    }

    /// Finds the fragments of a frame and calls [`Row::with_fragments`].
    pub fn with_options(frame: &Frame, options: &MeasurementOptions) -> Row {
        Row::with_fragments(frame, &fragments::find_fragments(frame), options)
    }

    /// Measures all observables of a frame. `fragments`: all fragments of the frame.
    pub fn with_fragments(frame: &Frame, fragments: &[fragments::Fragment], options: &MeasurementOptions) -> Row {
        let (grains, summation) = (&frame.grains, options.summation);
        let count = grains.len() as f64;
        let cell = frame.cell();
        let all_grains: Vec<GrainId> = frame.grain_ids().collect();
        // A scene that repeats has no ball around it.
        let ball = enclosing::enclosing_ball(if cell.is_periodic() { &[] } else { grains });
        let gravity = energy::self_gravity_constant(frame);
        let aggregate = motion::AggregateSums::from_grains(grains);
        let [a, b, c] = aggregate.semi_axes();
        let fixed = aggregate.clone().in_fixed_axes(&motion::RotatingAxes::from_frame(frame));
        let spin = fixed.spin();
        let kinetic_energy = energy::KineticEnergy::of_grains(grains);
        let mean_radius = grains.iter().map(|g| g.radius).sum::<f64>() / count;
        let region = options.region(frame, fragments);
        let coordination = coordination::mean_coordination(frame, &region.members);
        let stress = region.stress(frame);
        let kinetic_stress = region.kinetic_stress(frame);
        let [sigma, motion_stress] = [stress, kinetic_stress].map(|s| 0.5 * (s + s.transpose()));
        let invariants = stress::StressInvariants::new(&stress);
        let mobilisation = fabric::mean_mobilisation(frame);
        let largest = LargestFragment::new(fragments, gravity, aggregate.mass);
        let bed = bed::Bed::from_frame(frame, fragments);
        let free_surface = FreeSurface::from_frame(frame, fragments, options.slope_reach);
        let bed_value = |value: &dyn Fn(&bed::Bed) -> f64| bed.as_ref().map_or(f64::NAN, value);
        let e_grav =
            gravity.map_or(0.0, |g| energy::gravitational_energy(grains.iter().map(|k| (k.x, k.mass)), g, summation));
        let e_uniform = energy::uniform_gravity_energy(grains, Vec3::from(frame.meta.parameters.uniform_gravity));
        let e_fields = energy::field_energy(grains, &energy::external_fields(frame));
        let ledger = &frame.meta.ledger;
        let com = frame.origin.written_position(aggregate.x);
        let momentum = aggregate.momentum - frame.origin.v * aggregate.mass;
        let [lengths, shears, log_strains, shear_strains] = frame
            .meta
            .cell
            .map_or([[f64::NAN; 3]; 4], |cell| [cell.periods, cell.shears, cell.log_strains(), cell.shear_strains]);
        let [cylinder_radius, cylinder_pressure] = changing_cylinder::radius_and_pressure(frame);
        let mut row = Row {
            step: frame.meta.step,
            time: frame.meta.time,
            n_contacts: coordination::touching_contacts(frame).count() as u64,
            n_pulling: coordination::count_distant_pairs(frame) as u64,
            region: region.kind.column_value(),
            region_volume: region.volume,
            Z: coordination.z,
            Z_no_rattlers: coordination.z_no_rattlers,
            rattler_fraction: coordination.rattler_fraction,
            Z_all: coordination::mean_coordination(frame, &all_grains).z,
            nu: region.solid_fraction(frame),
            nu_sphere: grains.iter().map(|g| g.volume()).sum::<f64>() / ball.volume(),
            R_enclosing: ball.radius,
            pressure: stress::pressure(&stress),
            pressure_virial: region.virial_pressure(frame, summation),
            pressure_sphere: stress::pressure(&stress::mean_stress(frame, ball.volume())),
            a,
            b,
            c,
            Ec_mean: kinetic_energy.total() / count,
            Ec_rot_mean: kinetic_energy.rotation / count,
            E_grav: e_grav,
            spin_x: spin.x,
            spin_y: spin.y,
            spin_z: spin.z,
            L_x: fixed.angular_momentum.x,
            L_y: fixed.angular_momentum.y,
            L_z: fixed.angular_momentum.z,
            n_fragments: fragments.len() as u64,
            largest_fraction: largest.sums.mass / aggregate.mass,
            n_grains: grains.len() as u64,
            mass: aggregate.mass,
            pressure_kinetic: stress::pressure(&kinetic_stress),
            Ec_rigid_mean: aggregate.rigid_energy() / count,
            E_uniform: e_uniform,
            E_fields: e_fields,
            com_x: com.x,
            com_y: com.y,
            com_z: com.z,
            P_x: momentum.x,
            P_y: momentum.y,
            P_z: momentum.z,
            Z_constraints: coordination.z_constraints,
            share_face: coordination.shares.face,
            share_edge: coordination.shares.edge,
            share_point: coordination.shares.point,
            penetration: frame.contacts.iter().map(|c| -c.gap).fold(0.0, f64::max) / mean_radius,
            sigma_xx: sigma[(0, 0)],
            sigma_yy: sigma[(1, 1)],
            sigma_zz: sigma[(2, 2)],
            sigma_xy: sigma[(0, 1)],
            sigma_xz: sigma[(0, 2)],
            sigma_yz: sigma[(1, 2)],
            kinetic_xx: motion_stress[(0, 0)],
            kinetic_yy: motion_stress[(1, 1)],
            kinetic_zz: motion_stress[(2, 2)],
            kinetic_xy: motion_stress[(0, 1)],
            kinetic_xz: motion_stress[(0, 2)],
            kinetic_yz: motion_stress[(1, 2)],
            sqrt_J2: invariants.sqrt_j2,
            drucker_prager: invariants.drucker_prager,
            friction_angle: invariants.friction_angle,
            tensile_fraction: stress::tensile_fraction(frame),
            anisotropy: fabric::anisotropy(&fabric::fabric_tensor(frame)),
            mobilised: mobilisation.mobilised_share,
            sliding_fraction: mobilisation.sliding_share,
            largest_mass: largest.sums.mass,
            largest_a: largest.axes[0],
            largest_b: largest.axes[1],
            largest_c: largest.axes[2],
            largest_spin: largest.spin,
            largest_period: if largest.spin > 0.0 { std::f64::consts::TAU / largest.spin } else { f64::NAN },
            bound_fraction: largest.bound,
            escaping_fraction: largest.escaping,
            E_total: kinetic_energy.total() + e_grav + e_uniform + e_fields,
            E_contacts: ledger.contact_work,
            E_friction: ledger.friction_work,
            E_shocks: ledger.contact_work - ledger.friction_work,
            E_outside: ledger.outside_work,
            bed_height: bed_value(&|bed| bed.height),
            bed_nu: bed_value(&|bed| bed.solid_fraction()),
            bed_pressure: bed_value(&|bed| stress::pressure(&bed.stress())),
            bed_stress_ratio: bed_value(&|bed| bed.stress_ratio()),
            n_bonds: frame.contacts.iter().filter(|contact| contact.bonded).count() as u64,
            surface_slope: free_surface.as_ref().map_or(f64::NAN, |surface| surface.slope),
            surface_slope_error: free_surface.as_ref().map_or(f64::NAN, |surface| surface.slope_error),
            cell_x: lengths[0],
            cell_y: lengths[1],
            cell_z: lengths[2],
            cell_xy: shears[0],
            cell_xz: shears[1],
            cell_yz: shears[2],
            strain_x: log_strains[0],
            strain_y: log_strains[1],
            strain_z: log_strains[2],
            strain_xy: shear_strains[0],
            strain_xz: shear_strains[1],
            strain_yz: shear_strains[2],
            cylinder_radius,
            cylinder_pressure,
            interval: frame.interval.length,
            Z_interval: coordination::interval_coordination(frame, &region.members),
            pressure_interval: region.interval_pressure(frame),
            bed_pressure_interval: bed_value(&bed::Bed::interval_pressure),
        };
        row.clear_origin_dependent(&cell);
        row
    }

    /// Clears the values that would depend on the position of the cell's border through arms from a centre.
    fn clear_origin_dependent(&mut self, cell: &PeriodicCell) {
        if cell.is_periodic() {
            let axes = [&mut self.a, &mut self.b, &mut self.c, &mut self.Ec_rigid_mean];
            let motion = [&mut self.spin_x, &mut self.spin_y, &mut self.spin_z];
            let momentum = [&mut self.L_x, &mut self.L_y, &mut self.L_z];
            let largest = [&mut self.largest_a, &mut self.largest_b, &mut self.largest_c];
            axes.into_iter().chain(motion).chain(momentum).chain(largest).for_each(|value| *value = f64::NAN);
            (self.largest_spin, self.largest_period) = (f64::NAN, f64::NAN);
        }
        for (value, period) in [&mut self.com_x, &mut self.com_y, &mut self.com_z].into_iter().zip(cell.periods) {
            if period.is_some() {
                *value = f64::NAN;
            }
        }
    }
}

/// The largest remnant, and the shares of the mass in others that are bound to it and that are not.
struct LargestFragment {
    sums: motion::AggregateSums,
    /// Semi-axes, m.
    axes: [f64; 3],
    /// Spin, rad/s.
    spin: f64,
    /// Share of the mass of all grains in fragments that are bound to it, and in the others.
    bound: f64,
    escaping: f64,
}

impl LargestFragment {
    fn new(fragments: &[fragments::Fragment], constant: Option<f64>, mass: f64) -> LargestFragment {
        let sums =
            fragments.first().map_or_else(|| motion::AggregateSums::from_grains(&[]), |first| first.sums.clone());
        let mut bound = 0.0;
        if let Some(constant) = constant {
            let others = fragments.iter().skip(1).zip(orbits::fragment_orbits(fragments, constant));
            bound = others.filter(|(_, orbit)| orbit.is_bound()).map(|(other, _)| other.sums.mass).sum::<f64>() / mass;
        }
        let escaping = fragments.iter().skip(1).map(|other| other.sums.mass).sum::<f64>() / mass - bound;
        // A rounding residue of a difference of sums is not a mass.
        let escaping = if escaping < 1e-12 { 0.0 } else { escaping };
        LargestFragment { axes: sums.semi_axes(), spin: sums.spin().norm(), sums, bound, escaping }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    /// Values with arms from a centre are blanked by [`Row::clear_origin_dependent`]: the border of the cell is next to the
    /// grains, or between them.
    #[test]
    fn no_value_depends_on_the_border_of_a_periodic_cell() {
        let row_at = |shift: [f64; 2]| {
            let mut scene = Scene::self_gravitating(0.0);
            (scene.snapshot.meta.parameters.xperiode, scene.snapshot.meta.parameters.yperiode) = (Some(8.0), Some(8.0));
            scene.snapshot.meta.parameters.uniform_gravity = [0.0, 0.0, -1.0];
            let grains =
                [([0.0, 0.0, 1.0], 1.0), ([2.0, 0.0, 1.0], 1.0), ([0.0, 3.0, 2.0], 2.0), ([-3.5, 2.0, 2.5], 0.5)]
                    .map(|([x, y, z], radius)| scene.grain([x + shift[0], y + shift[1], z], radius));
            for (k, grain) in grains.into_iter().enumerate() {
                let k = k as f64;
                scene.snapshot.bodies.body_v[grain] = [k, 1.0 - k, k * k];
                scene.snapshot.bodies.body_w_world[grain] = [0.5, k, 0.25 * k];
            }
            scene.push(grains[1], grains[0], 2.0);
            scene.push(grains[2], grains[0], 3.0);
            // The surface of a layer of so few grains depends on the border: the region is a ball that moves with them.
            let region = format!("ball:2.5@{},{},1.5", 0.5 + shift[0], 1.0 + shift[1]);
            let options = MeasurementOptions { region: Some(region.parse().unwrap()), ..MeasurementOptions::default() };
            Row::with_options(&scene.frame(), &options).numbers()
        };
        let whole = row_at([0.0; 2]);
        for shift in [[3.0, 0.0], [0.0, 2.5], [3.5, -2.75], [80.0, 0.0]] {
            for ((name, _, _), (found, expected)) in Row::COLUMNS.iter().zip(row_at(shift).iter().zip(&whole)) {
                let is_same =
                    found.is_nan() && expected.is_nan() || (found - expected).abs() <= 1e-9 * (1.0 + expected.abs());
                assert!(is_same, "{name}: {found:e} is not {expected:e} where the grains are moved by {shift:?}");
            }
        }
    }
}
