//! Kernel: contact laws. The local solver knows one problem, û = W r̂ + b̂ with Signorini's condition
//! and Coulomb's cone on (û, r̂). A law supplies the shifts û = u + shift and r = r̂ + c n. h is the
//! length of the step and T the time to the next contact configuration: T = h except in implicit steps,
//! which are taken with θ = 1 ([`LawInput::closing_time`]).
//!
//! | law | normal shift | tangential shift | c, N s | friction |
//! |---|---|---|---|---|
//! | IQS_CLB, inelastic quasi-shock | max(0, g/T) | 0 | 0 | mu |
//! | IQS_DS_CLB | max(0, g/T) | 0 | 0 | mu dynamic after sliding, else mu static |
//! | GAP_SGR_CLB, Signorini on the gap | g/T | 0 | 0 | mu |
//! | IQS_CLB_g0, with the reference gap g_0 | max(0, (g - g_0)/T) | 0 | 0 | mu |
//! | GAP_SGR_CLB_g0, with the reference gap g_0 | (g - g_0)/T | 0 | 0 | mu |
//! | ELASTIC_REPELL_CLB and ELASTIC_REPELL_CLB_g0, g less g_0, with the compliance 1/(k h T) | g/T | 0 | 0 | mu |
//! | VISCO_ELASTIC_REPELL_CLB, if g <= 0, with the compliance 1/(h (k T + η)) | k g/(k T + η) | 0 | 0 | mu |
//! | ELASTIC_WIRE, ELASTIC_ROD, VOIGT_WIRE, VOIGT_ROD, between points, see [`StrainSpring`] | - | - | - | none |
//! | COUPLED_DOF: u = 0 for any r | 0 | 0 | 0 | none |
//! | IQS_MAL_CZM, IQS_EXPO_CZM, IQS_TH_CZM, IQS_MAC_CZM: r less the impulse of the interface, see `interface` | max(0, g/T) | 0 | 0 | mu dynamic after sliding, else mu static |
//! | VEL_SGR_CLB, Signorini on the velocity, if g <= 1e-9 R | 0 | 0 | 0 | mu |
//! | RST_CLB, restitution, if g <= 1e-9 R, or if e_n > 0 and u_n⁻ and the free velocities close g | e_n u_n⁻ | e_t u_T⁻ where u_n⁻ < 0 | 0 | mu |
//! | RST_CLB with e_n > 0 otherwise, if at rest or closed by the free velocities | g/T | 0 | 0 | mu |
//! | RST_CLB with e_n > 0 otherwise | (g + d)/T | 0 | 0 | mu |
//! | VEL_SGR_CLB, RST_CLB with e_n = 0 otherwise | g/T | 0 | 0 | mu |
//! | RST_DS_CLB | the same | the same | 0 | mu dynamic after sliding, else mu static |
//! | IQS_VEL_DS_CLB | as IQS_DS_CLB | 0 | 0 | mu dynamic + (mu static - mu dynamic) exp(-\|u_T⁻\|/v_f) |
//! | RST_VEL_DS_CLB, e_n falls by (v_e/\|u_n⁻\|)^p above v_e | as RST_CLB | as RST_CLB | 0 | the same |
//! | RST_WET_CLB, cohesive force f while g <= range | the same | the same | -h f | as RST_DS_CLB |
//! | IQS_CLB_RGR, if g >= g_tol | max(0, g/T) | 0 | 0 | mu |
//! | IQS_CLB_RGR otherwise | 0 | 0 | 2 (g_tol - g)/(W_nn h τ²), τ = T/(2π h) | mu |
//! | IQS_WET_DS_CLB, cohesive force f while g <= range | max(0, g/T) | 0 | -h f | mu dynamic after sliding, else mu static |
//! | xQS_WET_DS_CLB, the same while the contact is wet | max(0, g/T) | 0 | -h f | the same |
//! | IQS_COH_DS_CLB, IQS_VDW_DS_CLB, with the share f of the contact in the attraction of the pair | max(0, g/T) | 0 | -h f | the same |
//! | RST_COH_DS_CLB, RST_VDW_DS_CLB, the same | as RST_DS_CLB | as RST_DS_CLB | -h f | the same |
//! | IQS_MOHR_DS_CLB while bonded over the area S | 0 | 0 | -h c_n S | c_t/c_n |
//! | IQS_BEAM_DS_CLB, as IQS_MOHR_DS_CLB | the same | the same | the same | the same |
//! | ELASTIC_BEAM_DS_CLB while bonded, with the compliances 1/(k h T S), see [`ContactLaw::bond_compliance`] | as IQS_MOHR_DS_CLB | the same | the same | the same |
//! | IQS_MOHR_DS_CLB, IQS_BEAM_DS_CLB and ELASTIC_BEAM_DS_CLB without a bond | max(0, g/T) | 0 | 0 | mu dynamic after sliding, else mu static |
//! | RST_MOHR_DS_CLB while bonded | as IQS_MOHR_DS_CLB | the same | the same | the same |
//! | RST_MOHR_DS_CLB without a bond | as RST_DS_CLB | the same | the same | the same |
//!
//! VEL_SGR_CLB and RST_CLB act on touching contacts. A pair that the free velocities would close within the step is thrown
//! back at once, or brought to touch where the law does not throw back or u_n⁻ does not close it; a pair at rest is kept in
//! touch. So bodies at rest do not sink into their support. If other contacts push together a pair that throws back, it
//! overlaps by the distance d at most, so that restitution acts in the next step.
//!
//! u⁻ is the relative velocity at the step's start. Friction acts on r̂_n = r_n + h f: a cohesive
//! contact slides at mu (r_n/h + f). Names, parameters, friction and cohesion are in [`cd_formats::law_table`].
//!
//! Some laws have a liquid bridge or a bond that does not form again by itself. A contact of xQS_WET_DS_CLB is wet if
//! g <= range at the start of the run or when an event bonds it, and dry once g > range. A bond of IQS_MOHR_DS_CLB,
//! RST_MOHR_DS_CLB, IQS_BEAM_DS_CLB or ELASTIC_BEAM_DS_CLB joins bodies that touch then, carries a traction up to c_n S
//! and a shear up to c_t S + (c_t/c_n) r_n/h, and breaks once it parts, reaches the limits of its moments or, if c_t > 0,
//! slides.
//! S = pi R², 1/R = 1/R_a + 1/R_b, but for spheres with the laws BEAM, see below.
//!
//! The reference gap g_0 = max(0, g) of the laws `_g0` is that of contacts within the alert distance at these moments; of
//! contacts that begin later it is 0. [`LawInput::gap`] is g - g_0.
//!
//! IQS_DS_ROLL_CLB, IQS_WET_DS_ROLL_CLB, IQS_COH_DS_ROLL_CLB and IQS_VDW_DS_ROLL_CLB, which LMGC90 does not have, are the laws
//! without ROLL with moments on top: up to mu_r R r̂_n against rolling and mu_s R r̂_n against spinning. Common models have such limits, e.g.
//! J. Ai et al., Powder Technol. 206 (2011) 269-282; rigid here, without a spring.
//!
//! A bond of a sphere by IQS_BEAM_DS_CLB is a disc of the radius R_b and the area S = pi R_b², with I = S R_b²/4 and J = S
//! R_b²/2. It also carries a bending moment and a torque, see [`MomentLimits`]. A bond of ELASTIC_BEAM_DS_CLB has the same
//! limits, within which it is elastic: the stiffnesses k_n S of opening, k_t S of sliding, k_n I of bending and k_t J of torsion.
//!
//! Restitution also applies to a contact that was parting: thrown back by its neighbours within the step, it may close at e_n
//! times its speed. So (v⁺ + e v⁻)/(1 + e) is the projection of v⁻ on the velocities that the contacts allow, and several
//! contacts of one e_n give no energy without friction. With friction this is true for a single contact of spheres only: if
//! an impulse along the normal turns a body, as at the end of a rod, Newton's law may give energy (T.R. Kane, D.A. Levinson,
//! Dynamics (1985), ch. 5), which the ledger counts as that of friction.
//!
//! Sources: M. Jean, Comput. Methods Appl. Mech. Engrg. 177 (1999) 235-257; J.J. Moreau, Unilateral
//! contact and dry friction in finite freedom dynamics, CISM 302 (1988).

pub mod interface;

use cd_formats::law_table::{BondStiffness, ContactMemory, FrictionPair, LawCohesion, LawModel, PairCohesion};
pub use cd_formats::law_table::{LawInterface, RollingFriction};

use crate::features::BARE;

/// Condition along the normal under which a contact resists.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum UnilateralLaw {
    /// An open gap may close within the step; an interpenetration is kept, unless `rescue` pushes it out.
    InelasticShock { rescue: Option<GapRescue> },
    /// The gap at the step's end is not negative: an interpenetration is pushed out within the step.
    Gap,
    /// The contact acts only once touching, and then without regard to the gap.
    Velocity,
    /// Newton's restitution with the coefficients e_n and e_t; the former falls with the speed of approach, if it has a
    /// `decline`.
    Restitution { normal: f64, tangential: f64, decline: Option<RestitutionDecline> },
    /// Spring of this stiffness (N/m) on the gap at the step's end, with a damper (N s/m); never pulls. With a `damper` it acts
    /// only in a step that begins with an overlap, and without the damper if velocities would close the pair too deep.
    Spring { stiffness: f64, damper: Option<f64> },
    /// No relative velocity, whatever the impulse.
    Coupling,
    /// Spring along the line between two points, which has no unilateral contact.
    Link(StrainSpring),
}

/// Fall of a coefficient of restitution with the speed of approach: by (v_e/|u_n|)^p above the speed v_e. With p = 1/4 it is that
/// of bodies that yield, with p = 0.234 that of frosted ice.
///
/// Sources: K.L. Johnson, Contact mechanics (1985), section 11.5; F.G. Bridges, A. Hatzes, D.N.C. Lin, Nature 309 (1984) 333-335.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestitutionDecline {
    /// v_e, m/s.
    pub speed: f64,
    /// p.
    pub exponent: f64,
}

impl RestitutionDecline {
    /// Factor of the coefficient of restitution at the normal velocity `u_n` (m/s), at most 1: with v_e = 1 m/s and p = 1/2
    /// it is 1/2 at 4 m/s.
    fn factor(&self, u_n: f64) -> f64 {
        let ratio = self.speed / u_n.abs();
        if ratio < 1.0 { libm::pow(ratio, self.exponent) } else { 1.0 }
    }
}

/// Velocity that Newton's restitution with the coefficient `e_n` adds to the normal velocity `u_n` at the start, m/s.
fn rebound_shift(e_n: f64, decline: Option<RestitutionDecline>, u_n: f64) -> f64 {
    decline.map_or(e_n, |decline| e_n * decline.factor(u_n)) * u_n
}

/// Wire or rod between two points. Its tension at the end of a step is k (ε - ε_0) + η dε/dt with the strain ε = L/L_0 - 1 of its
/// length L; a wire without tension is slack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrainSpring {
    /// k, N.
    pub stiffness: f64,
    /// ε_0.
    pub prestrain: f64,
    /// η, N s.
    pub viscosity: f64,
    /// Whether it pulls only.
    pub is_wire: bool,
}

impl StrainSpring {
    /// Normal shift, m/s, and compliance, 1/kg, of a spring of the length `length` in the contact configuration and of the length
    /// `rest_length` without strain, in a step of `h`, whose next contact configuration is after `closing_time` (s).
    ///
    /// The normal impulse r_n = -h (k (L + T u_n - L_0 (1 + ε_0)) + η u_n)/L_0 is û_n = u_n + shift + compliance r_n = 0. With
    /// 1000 N, 2 m long and stretched to 2.002 m, without a damper, in steps of 1 ms: 2 m/s and 2000 /kg, hence 1 N without motion.
    pub fn shift_and_compliance(&self, length: f64, rest_length: f64, h: f64, closing_time: f64) -> (f64, f64) {
        let effective_viscosity = self.stiffness * closing_time + self.viscosity;
        let elongation = length - rest_length * (1.0 + self.prestrain);
        (self.stiffness * elongation / effective_viscosity, rest_length / (h * effective_viscosity))
    }
}

/// Regularisation of the row of a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LawRegularisation {
    /// Compliance along the normal, 1/kg: velocity per impulse.
    Compliance(f64),
    /// No relative velocity.
    Coupling,
}

/// Attraction or bond between two bodies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cohesion {
    /// A constant attraction `force` (N) while the gap is at most `range` (m); if `remembers`, only until the gap
    /// was larger once.
    Wet { force: f64, range: f64, remembers: bool },
    /// An attraction by a force that follows from the size of the two bodies.
    Pair(PairCohesion),
    /// A bond that carries stresses (Pa) up to `normal` in traction and `tangential` in shear, until it breaks; once an
    /// event has changed them, up to `now` in traction and as much more or less in shear. With a `radius`, over the smaller
    /// radius of the two bodies, it is a disc of this size that also carries moments. With a `stiffness` it is elastic.
    Bond { normal: f64, tangential: f64, now: f64, radius: Option<f64>, stiffness: Option<BondStiffness> },
}

/// Limits of the moments of a contact: |M_T| <= bending R r̂_n across the normal and |M_n| <= torsion R r̂_n - shear R |r_T| about
/// it, N m s.
///
/// Rolling and spinning friction have R = 1/(1/R_a + 1/R_b). A bond has its own radius R_b. In it the traction of the outermost
/// fibre is |M_T| R_b/I - r_n/S and its shear |r_T|/S + |M_n| R_b/J, per length of the step. With r̂_n = r_n + h c_n S, these
/// reach c_n and c_t + (c_t/c_n) r_n/S at bending 1/4, torsion (c_t/c_n)/2 and shear 1/2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MomentLimits {
    pub bending: f64,
    pub torsion: f64,
    pub shear: f64,
}

/// Compliances of an elastic bond in a step: velocities per impulse, 1/kg, and angular velocities per angular impulse, 1/(kg m²).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BondCompliance {
    pub opening: f64,
    pub sliding: f64,
    pub bending: f64,
    pub torsion: f64,
}

/// Largest gap at which two bodies touch, for a bond, divided by 1/(1/R_a + 1/R_b).
pub const MAX_TOUCHING_GAP: f64 = 1e-3;

/// Largest gap at which two bodies touch, for laws on the velocity, divided by the same length: the corners of a face
/// that lies flat are within this gap, to rounding.
const CLOSED_GAP: f64 = 1e-9;

/// Contact law: condition along the normal, cohesion and friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactLaw {
    /// Condition along the normal.
    pub unilateral: UnilateralLaw,
    pub cohesion: Option<Cohesion>,
    /// Coefficient of friction of a contact that does not slide yet.
    pub friction_static: f64,
    /// Coefficient of friction of a contact that slid in the last step.
    pub friction_dynamic: f64,
    /// Speed of sliding over which friction falls from the static coefficient to the dynamic one, m/s, if it does so.
    pub friction_speed: Option<f64>,
    /// Rolling and spinning friction.
    pub rolling: Option<RollingFriction>,
    /// Whether gaps count from a reference gap.
    pub has_reference_gap: bool,
    /// Elastic interface with damage.
    pub interface: Option<LawInterface>,
}

/// Push against overlaps that are deeper than a bound, as of an oscillator that closes them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GapRescue {
    /// Ratio of the period of the oscillator to the length of the step.
    pub steps: f64,
    /// Gap below which it pushes, m, at most 0.
    pub gap: f64,
}

impl GapRescue {
    /// Normal velocity that the push gives the two bodies in a step of `h` (s), m/s; 0 if the overlap is not too deep.
    ///
    /// 2 (g_tol - g)/(h τ²), τ = T/(2π h): with T = 2π h and 1/2 mm too deep, 1 m/s in a step of 1 ms.
    pub fn velocity(&self, gap: f64, h: f64) -> f64 {
        let tau = self.steps / std::f64::consts::TAU;
        2.0 * (self.gap - gap).max(0.0) / (h * tau * tau)
    }
}

/// Input of a law for one contact and step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawInput {
    /// Gap, m, less the reference gap of the contact.
    pub gap: f64,
    /// Length of the step, s.
    pub h: f64,
    /// Time to the next contact configuration, s.
    pub closing_time: f64,
    /// Forecast of an open gap, for laws that act on touching contacts and damped springs.
    pub gap_forecast: GapForecast,
    /// Normal relative velocity at the step's start, m/s, > 0 parting.
    pub u_n: f64,
    /// Speed of sliding at the step's start, m/s.
    pub sliding_speed: f64,
    /// 1/(1/R_a + 1/R_b) of the two surfaces; where faces share an area S, √(S/π), and where edges or vertices meet under a
    /// stress 0, m.
    pub radius: f64,
    /// Whether the contact slid in the last step.
    pub slid_before: bool,
    /// Whether the contact has a bond or a liquid bridge.
    pub bonded: bool,
    /// Share of this contact in the attraction of a pair, N; 0 for laws without cohesion per pair.
    pub pair_attraction: f64,
}

/// Forecast of the open gap of a pair until the next contact configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GapForecast {
    /// The free velocities leave it open; other contacts may push the pair together, to an overlap of at most `depth` (m).
    Apart { depth: f64 },
    /// The pair rests. Either it carried an impulse in the last step and hardly moves, or the change of velocity by forces in
    /// this step closes its gap and exceeds its speed.
    Resting,
    /// Two spheres approach but miss each other.
    Passing,
    /// The free velocities close it; with a damped spring, deeper than [`MAX_STEP_OVERLAP`] allows.
    Due,
}

/// Overlap that other contacts may bring in a step to a pair that throws back, and velocities to a pair with a damped
/// spring, divided by the size of the pair.
pub const MAX_STEP_OVERLAP: f64 = 0.1;

/// Motion of a contact by more than the errors of its velocity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ContactMotion {
    /// Whether the surfaces part.
    pub opens: bool,
    /// Whether they move along each other.
    pub slides: bool,
    /// Whether a bond that carries moments bends or twists.
    pub turns: bool,
}

impl ContactMotion {
    /// Whether it moves in any direction.
    pub fn is_any(self) -> bool {
        self.opens || self.slides || self.turns
    }
}

/// Terms that a law adds to the standard problem of one contact in one step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LawShift {
    /// Shift of u_n, m/s.
    pub normal: f64,
    /// Factor of the tangential shift: û_T = u_T + tangential u_T⁻.
    pub tangential: f64,
    /// Impulse shift c = r_n - r̂_n, N s; negative for an attraction.
    pub impulse: f64,
    /// Coefficient of friction mu on û and r̂.
    pub friction: f64,
    /// Whether the contact, if it can close, is solved from the first sweep; otherwise it is included if other contacts push
    /// it together.
    pub solved: bool,
}

/// Damper of a spring at a gap, N s/m: 0 while it is open.
fn closed_damper(damper: Option<f64>, gap: f64) -> f64 {
    damper.filter(|_| gap <= 0.0).unwrap_or(0.0)
}

impl ContactLaw {
    /// Mechanics of a law of the table: its condition along the normal, with the table's friction, cohesion and moments.
    pub fn new(model: &LawModel) -> ContactLaw {
        let unilateral = match *model {
            LawModel::IqsClb { .. }
            | LawModel::IqsClbG0 { .. }
            | LawModel::IqsMalCzm { .. }
            | LawModel::IqsExpoCzm { .. }
            | LawModel::IqsThCzm { .. }
            | LawModel::IqsMacCzm { .. }
            | LawModel::IqsDsClb { .. }
            | LawModel::IqsVelDsClb { .. }
            | LawModel::IqsDsRollClb { .. }
            | LawModel::IqsWetDsClb { .. }
            | LawModel::IqsWetDsRollClb { .. }
            | LawModel::IqsCohDsClb { .. }
            | LawModel::IqsCohDsRollClb { .. }
            | LawModel::IqsVdwDsClb { .. }
            | LawModel::IqsVdwDsRollClb { .. }
            | LawModel::XqsWetDsClb { .. }
            | LawModel::IqsMohrDsClb { .. }
            | LawModel::IqsBeamDsClb { .. }
            | LawModel::ElasticBeamDsClb { .. } => UnilateralLaw::InelasticShock { rescue: None },
            LawModel::IqsClbRgr { relaxation_steps: steps, relaxation_gap: gap, .. } => {
                UnilateralLaw::InelasticShock { rescue: Some(GapRescue { steps, gap }) }
            }
            LawModel::GapSgrClb { .. } | LawModel::GapSgrClbG0 { .. } => UnilateralLaw::Gap,
            LawModel::ElasticRepellClb { stiffness, .. } | LawModel::ElasticRepellClbG0 { stiffness, .. } => {
                UnilateralLaw::Spring { stiffness, damper: None }
            }
            LawModel::ViscoElasticRepellClb { stiffness, normal_viscosity, .. } => {
                UnilateralLaw::Spring { stiffness, damper: Some(normal_viscosity) }
            }
            LawModel::CoupledDof {} => UnilateralLaw::Coupling,
            LawModel::ElasticWire { stiffness, prestrain } => {
                UnilateralLaw::Link(StrainSpring { stiffness, prestrain, viscosity: 0.0, is_wire: true })
            }
            LawModel::ElasticRod { stiffness, prestrain } => {
                UnilateralLaw::Link(StrainSpring { stiffness, prestrain, viscosity: 0.0, is_wire: false })
            }
            LawModel::VoigtWire { stiffness, prestrain, viscosity } => {
                UnilateralLaw::Link(StrainSpring { stiffness, prestrain, viscosity, is_wire: true })
            }
            LawModel::VoigtRod { stiffness, prestrain, viscosity } => {
                UnilateralLaw::Link(StrainSpring { stiffness, prestrain, viscosity, is_wire: false })
            }
            LawModel::VelSgrClb { .. } => UnilateralLaw::Velocity,
            LawModel::RstClb { normal_restitution: normal, tangential_restitution: tangential, .. }
            | LawModel::RstDsClb { normal_restitution: normal, tangential_restitution: tangential, .. }
            | LawModel::RstWetClb { normal_restitution: normal, tangential_restitution: tangential, .. }
            | LawModel::RstMohrDsClb { normal_restitution: normal, tangential_restitution: tangential, .. }
            | LawModel::RstCohDsClb { normal_restitution: normal, tangential_restitution: tangential, .. }
            | LawModel::RstVdwDsClb { normal_restitution: normal, tangential_restitution: tangential, .. } => {
                UnilateralLaw::Restitution { normal, tangential, decline: None }
            }
            LawModel::RstVelDsClb {
                normal_restitution: normal,
                tangential_restitution: tangential,
                restitution_speed: speed,
                restitution_exponent: exponent,
                ..
            } => {
                let decline = Some(RestitutionDecline { speed, exponent });
                UnilateralLaw::Restitution { normal, tangential, decline }
            }
        };
        let cohesion = model.cohesion().map(|cohesion| match cohesion {
            LawCohesion::Liquid { force, range, remembers } => Cohesion::Wet { force, range, remembers },
            LawCohesion::Pair(pair) => Cohesion::Pair(pair),
            LawCohesion::Bond { normal, tangential, radius, stiffness } => {
                Cohesion::Bond { normal, tangential, now: normal, radius, stiffness }
            }
        });
        let FrictionPair { static_friction, dynamic_friction } = model.friction();
        ContactLaw {
            unilateral,
            cohesion,
            friction_static: static_friction,
            friction_dynamic: dynamic_friction,
            friction_speed: model.friction_speed(),
            rolling: model.rolling(),
            has_reference_gap: model.memory().contains(&ContactMemory::ReferenceGap),
            interface: model.interface(),
        }
    }

    /// Returns the law's shifts for a contact; `None` if it cannot act in this step.
    #[inline]
    pub fn contact_shift(&self, input: &LawInput) -> Option<LawShift> {
        let LawInput { gap, h, closing_time, u_n, .. } = *input;
        let mut solved = true;
        let (normal, tangential) = match self.unilateral {
            // Bonds are rigid: a redundant set of bonds cannot close gaps opened by errors.
            UnilateralLaw::InelasticShock { .. } | UnilateralLaw::Restitution { .. }
                if input.bonded && matches!(self.cohesion, Some(Cohesion::Bond { .. })) =>
            {
                (0.0, 0.0)
            }
            UnilateralLaw::InelasticShock { .. } => ((gap / closing_time).max(0.0), 0.0),
            UnilateralLaw::Gap => (gap / closing_time, 0.0),
            UnilateralLaw::Spring { damper: Some(_), .. } if gap > 0.0 && input.gap_forecast != GapForecast::Due => {
                return None;
            }
            UnilateralLaw::Spring { stiffness, damper } => {
                let effective_viscosity = stiffness * closing_time + closed_damper(damper, gap);
                (stiffness * gap / effective_viscosity, 0.0)
            }
            UnilateralLaw::Coupling => (0.0, 0.0),
            // Its row is made from the two points.
            UnilateralLaw::Link(_) => return None,
            UnilateralLaw::Velocity if self.is_closed(input) => (0.0, 0.0),
            UnilateralLaw::Restitution { normal, tangential, decline } if self.is_closed(input) => {
                (rebound_shift(normal, decline, u_n), if u_n < 0.0 { tangential } else { 0.0 })
            }
            UnilateralLaw::Velocity | UnilateralLaw::Restitution { .. } => {
                match (self.unilateral, input.gap_forecast) {
                    (_, GapForecast::Passing) if !self.attracts(input) => return None,
                    (UnilateralLaw::Restitution { normal, tangential, decline }, GapForecast::Due)
                        if self.throws_back(input) =>
                    {
                        (rebound_shift(normal, decline, u_n), tangential)
                    }
                    (_, GapForecast::Apart { depth }) if self.has_restitution() => {
                        solved = self.attracts(input);
                        ((gap + depth) / closing_time, 0.0)
                    }
                    _ => (gap / closing_time, 0.0),
                }
            }
        };
        let friction = match self.friction_speed {
            Some(speed) => {
                let fall = libm::exp(-input.sliding_speed / speed);
                self.friction_dynamic + (self.friction_static - self.friction_dynamic) * fall
            }
            None if input.slid_before => self.friction_dynamic,
            None => self.friction_static,
        };
        let (attraction, friction) = match self.cohesion() {
            Some(Cohesion::Wet { force, .. }) if self.attracts(input) => (force, friction),
            Some(Cohesion::Pair(_)) => (input.pair_attraction, friction),
            Some(Cohesion::Bond { normal, tangential, now, .. }) if input.bonded && now > 0.0 => {
                (now * std::f64::consts::PI * input.radius * input.radius, tangential / normal)
            }
            None | Some(Cohesion::Wet { .. } | Cohesion::Bond { .. }) => (0.0, friction),
        };
        // Not -h f, which would be -0 without an attraction.
        Some(LawShift { normal, tangential, impulse: 0.0 - h * attraction, friction, solved })
    }

    /// Whether the two bodies attract each other at a distance.
    fn attracts(&self, input: &LawInput) -> bool {
        match self.cohesion() {
            Some(Cohesion::Wet { range, remembers, .. }) => input.gap <= range && (input.bonded || !remembers),
            Some(Cohesion::Pair(_)) => input.pair_attraction > 0.0,
            None | Some(Cohesion::Bond { .. }) => false,
        }
    }

    /// Whether a contact of a law that acts on touching contacts is closed, to rounding.
    fn is_closed(&self, input: &LawInput) -> bool {
        self.is_closed_gap(input.gap, input.radius)
    }

    /// Whether a gap, m, of a contact of the radius `radius`, m, of a law that acts on touching contacts is closed, to rounding.
    pub fn is_closed_gap(&self, gap: f64, radius: f64) -> bool {
        gap <= CLOSED_GAP * radius
    }

    /// Coefficient of restitution at the normal velocity `u_n`, m/s; `None` for a law other than those of Newton's restitution.
    pub fn restitution_at(&self, u_n: f64) -> Option<f64> {
        match self.unilateral {
            UnilateralLaw::Restitution { normal, decline, .. } => {
                Some(decline.map_or(normal, |decline| normal * decline.factor(u_n)))
            }
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Spring { .. }
            | UnilateralLaw::Coupling
            | UnilateralLaw::Link(_) => None,
        }
    }

    /// Whether an approaching pair is thrown back: the velocity at the start alone closes it.
    pub fn throws_back(&self, input: &LawInput) -> bool {
        self.has_restitution() && input.gap_forecast == GapForecast::Due && input.gap < -input.closing_time * input.u_n
    }

    /// Whether the law is a spring with a damper, which acts on closed contacts, and as a spring alone on pairs that a step
    /// would close deeper than [`MAX_STEP_OVERLAP`]: these might pass through each other.
    pub fn is_damped_spring(&self) -> bool {
        match self.unilateral {
            UnilateralLaw::Spring { damper, .. } => damper.is_some(),
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Restitution { .. }
            | UnilateralLaw::Coupling
            | UnilateralLaw::Link(_) => false,
        }
    }

    /// Whether a contact has dynamic friction once it slides, and another one before.
    pub fn has_two_frictions(&self) -> bool {
        self.friction_static != self.friction_dynamic && self.friction_speed.is_none()
    }

    /// Whether the law acts on touching contacts.
    pub fn acts_on_touch(&self) -> bool {
        match self.unilateral {
            UnilateralLaw::Velocity | UnilateralLaw::Restitution { .. } => true,
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Spring { .. }
            | UnilateralLaw::Coupling
            | UnilateralLaw::Link(_) => false,
        }
    }

    /// Push against deep overlaps, if the law has one.
    pub fn rescue(&self) -> Option<GapRescue> {
        match self.unilateral {
            UnilateralLaw::InelasticShock { rescue } => rescue,
            UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Restitution { .. }
            | UnilateralLaw::Spring { .. }
            | UnilateralLaw::Coupling
            | UnilateralLaw::Link(_) => None,
        }
    }

    /// Whether [`Self::contact_shift`] depends on the radius of the contact.
    pub fn depends_on_radius(&self) -> bool {
        self.acts_on_touch() || self.has_stress()
    }

    /// Cohesion in effect in a step.
    pub fn cohesion(&self) -> Option<Cohesion> {
        if BARE { None } else { self.cohesion }
    }

    /// Rolling friction in effect in a step.
    pub fn rolling_friction(&self) -> Option<RollingFriction> {
        if BARE { None } else { self.rolling }
    }

    /// Radius of a bond that carries moments over the smaller radius of its two bodies, if the law has such bonds.
    pub fn bond_radius(&self) -> Option<f64> {
        match self.cohesion() {
            Some(Cohesion::Bond { radius, .. }) => radius,
            None | Some(Cohesion::Wet { .. } | Cohesion::Pair(_)) => None,
        }
    }

    /// Stiffnesses of the bonds of the law, if it has elastic bonds.
    pub fn bond_stiffness(&self) -> Option<BondStiffness> {
        match self.cohesion() {
            Some(Cohesion::Bond { stiffness, .. }) => stiffness,
            None | Some(Cohesion::Wet { .. } | Cohesion::Pair(_)) => None,
        }
    }

    /// Compliances of an elastic bond of the radius `radius` (m) in a step of `h`, whose next contact configuration is after
    /// `closing_time` (s).
    ///
    /// The force at the end of the step is F = F⁻ - k S T u, that is u - C F⁻ h + C r = 0 with C = 1/(k S h T). With 10⁹ Pa/m on
    /// 10⁻³ m² in a step of 1 ms, 1 /kg.
    pub fn bond_compliance(&self, radius: f64, h: f64, closing_time: f64) -> Option<BondCompliance> {
        let BondStiffness { normal, tangential } = self.bond_stiffness()?;
        let area = std::f64::consts::PI * radius * radius;
        let [opening, sliding] = [normal, tangential].map(|k| 1.0 / (k * area * h * closing_time));
        let square = radius * radius;
        Some(BondCompliance { opening, sliding, bending: 4.0 * opening / square, torsion: 2.0 * sliding / square })
    }

    /// Whether contacts may carry moments.
    pub fn has_moments(&self) -> bool {
        self.rolling_friction().is_some() || self.bond_radius().is_some()
    }

    /// Limits of the moments of a contact, if it carries any. `bonded`: whether it has the bond of a sphere.
    pub fn moment_limits(&self, bonded: bool) -> Option<MomentLimits> {
        if let Some(RollingFriction { rolling, spinning }) = self.rolling_friction() {
            return Some(MomentLimits { bending: rolling, torsion: spinning, shear: 0.0 });
        }
        match self.cohesion() {
            Some(Cohesion::Bond { normal, tangential, now, radius: Some(_), .. }) if bonded && now > 0.0 => {
                Some(MomentLimits { bending: 0.25, torsion: 0.5 * tangential / normal, shear: 0.5 })
            }
            None | Some(Cohesion::Wet { .. } | Cohesion::Pair(_) | Cohesion::Bond { .. }) => None,
        }
    }

    /// Whether a contact may be bonded.
    pub fn can_bond(&self) -> bool {
        match self.cohesion() {
            Some(Cohesion::Wet { remembers, .. }) => remembers,
            Some(Cohesion::Bond { .. }) => true,
            None | Some(Cohesion::Pair(_)) => false,
        }
    }

    /// Attraction per pair of bodies, if the law has one.
    pub fn pair_cohesion(&self) -> Option<PairCohesion> {
        if let Some(Cohesion::Pair(pair)) = self.cohesion() { Some(pair) } else { None }
    }

    /// Whether bonds join their bodies as one, rigidly or elastically: bodies joined by a liquid bridge or a bond without shear slide and roll.
    pub fn bonds_are_rigid(&self) -> bool {
        match self.cohesion() {
            Some(Cohesion::Bond { tangential, .. }) => tangential > 0.0,
            None | Some(Cohesion::Wet { .. } | Cohesion::Pair(_)) => false,
        }
    }

    /// Whether contacts have a [`LawMemory`](crate::state::LawMemory).
    pub fn has_law_memory(&self) -> bool {
        self.has_reference_gap || self.interface.is_some()
    }

    /// Reference gap of a contact with this gap at the start or at an event, m; 0 if the law counts gaps from 0. A spring
    /// counts overlaps, too.
    pub fn reference_gap(&self, gap: f64) -> f64 {
        match self.unilateral {
            _ if !self.has_reference_gap => 0.0,
            UnilateralLaw::Spring { .. } => gap,
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Restitution { .. }
            | UnilateralLaw::Coupling
            | UnilateralLaw::Link(_) => gap.max(0.0),
        }
    }

    /// Whether the law adds to the row of a contact more than shifts.
    pub fn is_regularised(&self) -> bool {
        let is_spring = match self.unilateral {
            UnilateralLaw::Spring { .. } | UnilateralLaw::Coupling | UnilateralLaw::Link(_) => true,
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Restitution { .. } => false,
        };
        is_spring || self.interface.is_some() || self.bond_stiffness().is_some()
    }

    /// Wire or rod of the law, if it is one.
    pub fn strain_spring(&self) -> Option<&StrainSpring> {
        match &self.unilateral {
            UnilateralLaw::Link(spring) => Some(spring),
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Restitution { .. }
            | UnilateralLaw::Spring { .. }
            | UnilateralLaw::Coupling => None,
        }
    }

    /// Whether contacts have no relative velocity.
    pub fn is_coupled(&self) -> bool {
        match self.unilateral {
            UnilateralLaw::Coupling => true,
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Restitution { .. }
            | UnilateralLaw::Spring { .. }
            | UnilateralLaw::Link(_) => false,
        }
    }

    /// Whether contacts within the alert distance may carry force although they are apart.
    pub fn acts_apart(&self) -> bool {
        let joins_apart = match self.unilateral {
            UnilateralLaw::Coupling | UnilateralLaw::Link(_) => true,
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Restitution { .. }
            | UnilateralLaw::Spring { .. } => false,
        };
        joins_apart || self.has_reference_gap || self.interface.is_some()
    }

    /// Regularisation of a contact in a step of `h`, whose next contact configuration is after `closing_time` (s).
    ///
    /// The spring's force r/h = -k (g + T u_n) - η u_n is û_n = u_n + k g/(k T + η) + r/(h (k T + η)) = 0: with 10⁵ N/m in a
    /// step of 1 ms, 10 /kg.
    pub fn regularisation(&self, gap: f64, h: f64, closing_time: f64) -> Option<LawRegularisation> {
        match self.unilateral {
            UnilateralLaw::Spring { stiffness, damper } => {
                let effective_viscosity = stiffness * closing_time + closed_damper(damper, gap);
                Some(LawRegularisation::Compliance(1.0 / (h * effective_viscosity)))
            }
            UnilateralLaw::Coupling => Some(LawRegularisation::Coupling),
            // Wires and rods, like interfaces, have rows of their own.
            UnilateralLaw::Link(_) => None,
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Restitution { .. } => None,
        }
    }

    /// Whether a contact may be bonded or have a moment, which snapshots hold.
    pub fn has_memory(&self) -> bool {
        self.can_bond() || self.has_moments()
    }

    /// Gap of a bond made now, m; `None` if the law makes no bonds or the two bodies do not touch.
    pub fn bond_gap(&self, gap: f64, radius: f64) -> Option<f64> {
        match self.cohesion() {
            Some(Cohesion::Wet { range, remembers, .. }) => (remembers && gap <= range).then(|| self.bonded_at(gap)),
            Some(Cohesion::Bond { now, .. }) => {
                (now > 0.0 && gap <= MAX_TOUCHING_GAP * radius).then(|| self.bonded_at(gap))
            }
            None | Some(Cohesion::Pair(_)) => None,
        }
    }

    /// Gap that a bond made at `gap` keeps, m: a liquid bridge lets the two touch.
    pub fn bonded_at(&self, gap: f64) -> f64 {
        match self.cohesion() {
            Some(Cohesion::Wet { .. }) => 0.0,
            None | Some(Cohesion::Pair(_) | Cohesion::Bond { .. }) => gap,
        }
    }

    /// Whether a bond outlives a step in which the contact, with this gap at detection (m), has this motion.
    pub fn keeps_bond(&self, gap: f64, motion: ContactMotion) -> bool {
        match self.cohesion() {
            Some(Cohesion::Wet { range, .. }) => gap <= range,
            // Without resistance to shear a bond slides from the beginning.
            Some(Cohesion::Bond { tangential, now, .. }) => {
                now > 0.0 && !(motion.opens || motion.turns || motion.slides && tangential > 0.0)
            }
            None | Some(Cohesion::Pair(_)) => false,
        }
    }

    /// Share of the coefficient of friction that acts at a contact: the sound part of an interface does not rub, where the
    /// interface has an area.
    pub fn friction_share(&self, soundness: f64, radius: f64) -> f64 {
        if self.interface.is_some() && radius > 0.0 { 1.0 - soundness } else { 1.0 }
    }

    /// Whether the law has restitution.
    pub fn has_restitution(&self) -> bool {
        match self.unilateral {
            UnilateralLaw::Restitution { normal, .. } => normal > 0.0,
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Spring { .. }
            | UnilateralLaw::Coupling
            | UnilateralLaw::Link(_) => false,
        }
    }

    /// Sets the coefficients of restitution to 0.
    pub fn remove_restitution(&mut self) {
        match &mut self.unilateral {
            UnilateralLaw::Restitution { normal, tangential, .. } => (*normal, *tangential) = (0.0, 0.0),
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Spring { .. }
            | UnilateralLaw::Coupling
            | UnilateralLaw::Link(_) => {}
        }
    }

    /// Whether moving contacts lose an active bond or static friction. Elastic bonds yield by their load, not by a motion.
    pub fn has_irreversible_loss(&self) -> bool {
        let loses_bonds = match self.cohesion() {
            Some(Cohesion::Bond { stiffness, .. }) => stiffness.is_none(),
            None | Some(Cohesion::Wet { .. } | Cohesion::Pair(_)) => false,
        };
        self.has_two_frictions() || loses_bonds
    }

    /// Greatest speed at which a contact with force may close at the step's end, having parted with `u_n` at its start, m/s.
    pub fn max_closing_speed(&self, u_n: f64) -> f64 {
        match self.unilateral {
            UnilateralLaw::Restitution { normal, decline, .. } => rebound_shift(normal, decline, u_n.max(0.0)),
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Spring { .. }
            | UnilateralLaw::Coupling
            | UnilateralLaw::Link(_) => 0.0,
        }
    }

    /// Greatest gap at which a contact that is not closing can still act, m.
    pub fn interaction_range(&self, radius: f64) -> f64 {
        match self.cohesion() {
            Some(Cohesion::Wet { range, .. } | Cohesion::Pair(PairCohesion { range, .. })) => range,
            // Factor 2 for bonds that an unconverged solution lets part.
            Some(Cohesion::Bond { .. }) => 2.0 * MAX_TOUCHING_GAP * radius,
            None => 0.0,
        }
    }

    /// Largest gap at which an area of contact counts, m: beyond it no cohesive stress acts.
    pub fn range_of_stress(&self, radius: f64) -> f64 {
        let is_bond = self.has_stress() && self.interface.is_none();
        if is_bond { self.interaction_range(radius) } else { f64::INFINITY }
    }

    /// Whether the cohesion is a stress, which acts on the area of a contact.
    pub fn has_stress(&self) -> bool {
        let is_stress = match self.cohesion() {
            Some(Cohesion::Bond { .. }) => true,
            None | Some(Cohesion::Wet { .. } | Cohesion::Pair(_)) => false,
        };
        is_stress || self.interface.is_some()
    }

    /// Whether the law has friction.
    pub fn has_friction(&self) -> bool {
        match self.unilateral {
            UnilateralLaw::Coupling | UnilateralLaw::Link(_) => false,
            UnilateralLaw::InelasticShock { .. }
            | UnilateralLaw::Gap
            | UnilateralLaw::Velocity
            | UnilateralLaw::Restitution { .. }
            | UnilateralLaw::Spring { .. } => true,
        }
    }

    /// Gives friction, static and dynamic, a new value, if the law has friction.
    pub fn set_friction(&mut self, friction: f64) {
        if self.has_friction() {
            (self.friction_static, self.friction_dynamic) = (friction, friction);
        }
    }

    /// Gives the cohesion a new value, N, Pa or J; that of a bond in shear changes in proportion. Returns false if the law has
    /// no cohesion.
    pub fn set_cohesion(&mut self, value: f64) -> bool {
        match &mut self.cohesion {
            Some(Cohesion::Wet { force, .. }) => *force = value,
            Some(Cohesion::Pair(pair)) => *pair = pair.with_strength_parameter(value),
            Some(Cohesion::Bond { normal, now, .. }) if *normal > 0.0 => *now = value,
            None | Some(Cohesion::Bond { .. }) => return false,
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cd_formats::law_table::{
        ContactLoad, LAW_TABLE, LawParameter, has_interface, is_law_of_points, needs_gauss_seidel,
    };

    fn new_law(label: &str, parameters: &[f64]) -> ContactLaw {
        ContactLaw::new(&LawModel::from_values(label, parameters).unwrap())
    }

    #[test]
    fn shifts_follow_the_table() {
        let h = 0.5;
        let gap_forecast = GapForecast::Apart { depth: 0.25 };
        let at = |gap, u_n, slid_before| LawInput {
            gap,
            h,
            closing_time: h,
            gap_forecast,
            u_n,
            sliding_speed: 1.0,
            radius: 2.0,
            slid_before,
            bonded: false,
            pair_attraction: 0.0,
        };
        let shift =
            |kind, parameters: &[f64], gap, u_n, slid| new_law(kind, parameters).contact_shift(&at(gap, u_n, slid));
        let plain = |normal, friction| Some(LawShift { normal, tangential: 0.0, impulse: 0.0, friction, solved: true });
        let waiting = |normal| Some(LawShift { normal, tangential: 0.0, impulse: 0.0, friction: 0.4, solved: false });
        assert_eq!(shift("IQS_CLB", &[0.4], 0.1, -1.0, false), plain(0.2, 0.4));
        assert_eq!(shift("IQS_CLB", &[0.4], -0.1, -1.0, false), plain(0.0, 0.4));
        assert_eq!(shift("IQS_DS_CLB", &[0.1, 0.4], 0.1, -1.0, true), plain(0.2, 0.1));
        assert_eq!(shift("GAP_SGR_CLB", &[0.4], -0.1, 0.0, false), plain(-0.2, 0.4));
        assert_eq!(shift("VEL_SGR_CLB", &[0.4], -0.1, 0.0, false), plain(0.0, 0.4));
        assert_eq!(shift("VEL_SGR_CLB", &[0.4], 0.125, 0.0, false), plain(0.25, 0.4));
        assert_eq!(shift("RST_CLB", &[0.0, 0.25, 0.4], 0.125, 0.0, false), plain(0.25, 0.4));
        assert_eq!(shift("RST_CLB", &[0.5, 0.25, 0.4], 0.125, -1.0, false), waiting(0.75));
        let shock = LawShift { normal: -0.5, tangential: 0.25, impulse: 0.0, friction: 0.4, solved: true };
        assert_eq!(shift("RST_CLB", &[0.5, 0.25, 0.4], 0.0, -1.0, false), Some(shock));
        assert_eq!(shift("RST_CLB", &[0.5, 0.25, 0.4], 0.0, 1.0, false), plain(0.5, 0.4));
        // At 1 m/s of sliding, e = 0.5 (1/4)^(1/2) at 4 m/s and 0.5 up to 1 m/s.
        let falling = [0.5, 0.0, 1.0, 0.5, 0.2, 0.4, 2.0];
        let friction = 0.2 + (0.4 - 0.2) * libm::exp(-0.5);
        assert_eq!(shift("RST_VEL_DS_CLB", &falling, 0.0, -4.0, true), plain(-1.0, friction));
        assert_eq!(shift("RST_VEL_DS_CLB", &falling, 0.0, -0.5, false), plain(-0.25, friction));
        assert_eq!(shift("IQS_VEL_DS_CLB", &[0.2, 0.4, 2.0], 0.1, -1.0, false), plain(0.2, friction));
        // A face that lies flat has all its corners closed to rounding: R = 2 here.
        assert_eq!(shift("VEL_SGR_CLB", &[0.4], 1.9e-9, 0.0, false), plain(0.0, 0.4));
        assert_eq!(shift("RST_CLB", &[0.5, 0.25, 0.4], 2.1e-9, -0.25, false), waiting((2.1e-9 + 0.25) / h));
        let wet = LawShift { normal: 0.02, tangential: 0.0, impulse: -5.0, friction: 0.3, solved: true };
        assert_eq!(shift("IQS_WET_DS_CLB", &[10.0, 0.0, 0.01, 0.2, 0.3], 0.01, 0.0, false), Some(wet));
        assert_eq!(shift("IQS_WET_DS_CLB", &[10.0, 0.0, 0.01, 0.2, 0.3], 0.02, 0.0, false), plain(0.04, 0.3));
        assert_eq!(shift("xQS_WET_DS_CLB", &[10.0, 0.0, 0.01, 0.2, 0.3], 0.01, 0.0, false), plain(0.02, 0.3));
        assert_eq!(shift("IQS_MOHR_DS_CLB", &[10.0, 5.0, 0.2, 0.3], 0.01, 0.0, true), plain(0.02, 0.2));
    }

    fn touching() -> LawInput {
        let gap_forecast = GapForecast::Apart { depth: 0.0 };
        LawInput {
            gap: 0.0,
            h: 0.5,
            closing_time: 0.5,
            gap_forecast,
            u_n: 0.0,
            sliding_speed: 0.0,
            radius: 2.0,
            slid_before: false,
            bonded: false,
            pair_attraction: 0.0,
        }
    }

    fn acting() -> LawShift {
        LawShift { solved: true, ..LawShift::default() }
    }

    #[test]
    fn laws_of_touching_contacts_act_before_a_step_would_close_a_pair() {
        let law = |kind, parameters: &[f64]| new_law(kind, parameters);
        let due = |u_n| LawInput { gap: 1.0, u_n, gap_forecast: GapForecast::Due, ..touching() };
        let thrown = LawShift { normal: -2.0, tangential: 0.25, ..acting() };
        assert_eq!(law("RST_CLB", &[0.5, 0.25, 0.0]).contact_shift(&due(-4.0)), Some(thrown));
        // 1 m in 0.5 s: to touch, where the law does not throw back or the velocity at the start does not close it.
        let touches = Some(LawShift { normal: 2.0, ..acting() });
        assert_eq!(law("RST_CLB", &[0.5, 0.25, 0.0]).contact_shift(&due(-1.9)), touches);
        assert_eq!(law("RST_CLB", &[0.0, 0.25, 0.0]).contact_shift(&due(-4.0)), touches);
        assert_eq!(law("VEL_SGR_CLB", &[0.0]).contact_shift(&due(-4.0)), touches);
        let resting = LawInput { gap_forecast: GapForecast::Resting, ..due(-4.0) };
        assert_eq!(law("RST_CLB", &[0.5, 0.25, 0.0]).contact_shift(&resting), touches);
        let passing = LawInput { gap_forecast: GapForecast::Passing, ..due(-4.0) };
        assert_eq!(law("RST_CLB", &[0.5, 0.25, 0.0]).contact_shift(&passing), None);
    }

    #[test]
    fn bonds_join_touching_bodies_and_break_by_their_law() {
        let bonded = LawInput { gap: 0.015625, u_n: 0.0, slid_before: true, bonded: true, ..touching() };
        let mohr = new_law("IQS_MOHR_DS_CLB", &[10.0, 5.0, 0.2, 0.3]);
        let impulse = -0.5 * (10.0 * std::f64::consts::PI * 2.0 * 2.0);
        let held = LawShift { impulse, friction: 0.5, ..acting() };
        assert_eq!(mohr.contact_shift(&bonded), Some(held));
        let rebounds = new_law("RST_MOHR_DS_CLB", &[10.0, 5.0, 0.5, 0.25, 0.2, 0.3]);
        assert_eq!(rebounds.contact_shift(&LawInput { u_n: -4.0, ..bonded }), Some(held));
        let unbonded = LawInput { u_n: -4.0, gap: 0.0, bonded: false, ..bonded };
        let thrown = LawShift { normal: -2.0, tangential: 0.25, friction: 0.2, ..acting() };
        assert_eq!(rebounds.contact_shift(&unbonded), Some(thrown));
        assert_eq!(
            (mohr.bond_gap(0.002, 2.0), mohr.bond_gap(-0.1, 2.0), mohr.bond_gap(0.0021, 2.0)),
            (Some(0.002), Some(-0.1), None)
        );
        let rest = ContactMotion::default();
        let [opens, slides] = [ContactMotion { opens: true, ..rest }, ContactMotion { slides: true, ..rest }];
        assert!(mohr.keeps_bond(1.0, ContactMotion::default()));
        assert!(!mohr.keeps_bond(0.0, opens) && !mohr.keeps_bond(0.0, slides));
        assert!(new_law("IQS_MOHR_DS_CLB", &[10.0, 0.0, 0.2, 0.3]).keeps_bond(0.0, slides));
        assert_eq!(new_law("IQS_MOHR_DS_CLB", &[0.0, 0.0, 0.2, 0.3]).bond_gap(0.0, 2.0), None);

        let wet = new_law("xQS_WET_DS_CLB", &[10.0, 0.0, 0.02, 0.2, 0.3]);
        let bridged = LawShift { normal: 0.03125, impulse: -5.0, friction: 0.2, ..acting() };
        assert_eq!(wet.contact_shift(&bonded), Some(bridged));
        assert_eq!((wet.bond_gap(0.02, 2.0), wet.bond_gap(0.03, 2.0)), (Some(0.0), None));
        let moves = ContactMotion { opens: true, slides: true, turns: false };
        assert!(wet.keeps_bond(0.02, moves) && !wet.keeps_bond(0.03, ContactMotion::default()));
    }

    /// The disc of the bond as a beam: at its limits the outermost fibre has the strength of the bond.
    #[test]
    fn moments_of_a_bond_are_limited_by_the_stress_of_its_outermost_fibre() {
        let (c_n, c_t) = (10.0, 4.0);
        let law = new_law("IQS_BEAM_DS_CLB", &[c_n, c_t, 0.5, 0.2, 0.3]);
        assert_eq!((law.moment_limits(false), law.bond_radius()), (None, Some(0.5)));
        let limits = law.moment_limits(true).unwrap();
        let (radius, force, shear_force) = (0.25f64, -0.5, 0.125);
        let area = std::f64::consts::PI * radius * radius;
        let (i, j) = (0.25 * area * radius * radius, 0.5 * area * radius * radius);
        let cohesive_force = force + c_n * area;
        let bending = limits.bending * radius * cohesive_force;
        let torque = radius * (limits.torsion * cohesive_force - limits.shear * shear_force);
        let traction = bending * radius / i - force / area;
        let shear = shear_force / area + torque * radius / j;
        assert!((traction - c_n).abs() < 1e-14 * c_n && (shear - c_t - c_t / c_n * force / area).abs() < 1e-14 * c_t);
        let turns = ContactMotion { turns: true, ..ContactMotion::default() };
        assert!(!law.keeps_bond(0.0, turns) && law.keeps_bond(0.0, ContactMotion::default()));
        let mut gone = law;
        assert!(gone.set_cohesion(0.0) && gone.moment_limits(true).is_none());
    }

    #[test]
    fn events_change_friction_and_cohesion() {
        let mut mohr = new_law("IQS_MOHR_DS_CLB", &[10.0, 5.0, 0.2, 0.3]);
        mohr.set_friction(0.4);
        assert!(mohr.set_cohesion(20.0));
        let at = LawInput { bonded: true, ..touching() };
        let twice = new_law("IQS_MOHR_DS_CLB", &[20.0, 10.0, 0.4, 0.4]);
        assert_eq!(mohr.contact_shift(&at), twice.contact_shift(&at));
        // No bond is left, and a new cohesion acts on contacts bonded later.
        assert!(mohr.set_cohesion(0.0));
        assert_eq!(mohr.contact_shift(&at), Some(LawShift { friction: 0.4, ..acting() }));
        assert_eq!((mohr.bond_gap(0.0, 2.0), mohr.keeps_bond(0.0, ContactMotion::default())), (None, false));
        assert!(mohr.set_cohesion(20.0));
        assert_eq!((mohr.contact_shift(&at), mohr.bond_gap(0.0, 2.0)), (twice.contact_shift(&at), Some(0.0)));
        assert!(!new_law("IQS_CLB", &[0.3]).set_cohesion(1.0));
    }

    /// The friction limit of the table is that of the solver, μ r̂_n: for each law, with and without a bond, in touch, within
    /// the range and beyond it, for sound and damaged interfaces, while the contact does not slide.
    #[test]
    fn friction_limits_are_those_of_the_table() {
        for entry in LAW_TABLE.iter().filter(|entry| entry.computed) {
            // Distinct values in the limits: 1/4, 1/2, 3/4 ...; a static coefficient follows its dynamic one.
            let values: Vec<f64> = (1..).take(entry.parameters().count()).map(|k| 0.25 * f64::from(k)).collect();
            let model = LawModel::from_values(entry.label, &values).unwrap();
            let law = ContactLaw::new(&model);
            let range = model.attraction_range();
            let states = [(0.0, false), (0.0, true), (range, false), (range, true), (range + 0.5, false)];
            let interfaces = [0.0, 0.25, 1.0];
            for ((gap, bonded), soundness) in states.into_iter().flat_map(|at| interfaces.map(|sound| (at, sound))) {
                let pair_attraction = law.pair_cohesion().map_or(0.0, |pair| pair.gap_factor(gap) * pair.force(2.0));
                let at = LawInput { gap, bonded, gap_forecast: GapForecast::Due, pair_attraction, ..touching() };
                let Some(shift) = law.contact_shift(&at) else { continue };
                let normal_force = 2.0;
                let area = std::f64::consts::PI * at.radius * at.radius;
                let friction = shift.friction * law.friction_share(soundness, at.radius);
                let found = friction * (normal_force - shift.impulse / at.h);
                let load = ContactLoad { gap, normal_force, area, bonded, soundness, attraction: pair_attraction };
                let limit = model.friction_limit(&load);
                assert!((found - limit).abs() <= 1e-14 * limit, "{} at {gap}, {bonded}, {soundness}", entry.label);
            }
        }
    }

    #[test]
    fn the_table_of_shifts_names_every_law() {
        let (head, _) = include_str!("mod.rs").split_once("\nuse ").unwrap();
        for entry in LAW_TABLE.iter().filter(|entry| entry.computed) {
            assert!(head.contains(entry.label), "{}", entry.label);
        }
    }

    /// A parameter of the table that the mechanics ignore would be read, written and documented without an effect.
    #[test]
    fn every_parameter_changes_the_law() {
        for entry in LAW_TABLE.iter().filter(|entry| entry.computed) {
            let values: Vec<f64> = (1..).take(entry.parameters().count()).map(|k| 0.25 * f64::from(k)).collect();
            let law = |values: &[f64]| new_law(entry.label, values);
            for (k, parameter) in entry.parameters().enumerate().filter(|(_, p)| *p != LawParameter::UnusedCohesion) {
                let mut changed = values.clone();
                changed[k] += 0.125;
                assert_ne!(law(&changed), law(&values), "{}: {} has no effect", entry.label, parameter.name());
            }
        }
    }

    #[test]
    fn memory_is_that_of_the_table() {
        for entry in LAW_TABLE.iter().filter(|entry| entry.computed) {
            let values: Vec<f64> = (1..).take(entry.parameters().count()).map(|k| 0.25 * f64::from(k)).collect();
            let model = LawModel::from_values(entry.label, &values).unwrap();
            let (law, memory) = (ContactLaw::new(&model), model.memory());
            assert_eq!(law.strain_spring().is_some(), is_law_of_points(entry.label), "{}", entry.label);
            let needs_sweeps = model.has_moments() || law.is_regularised();
            assert_eq!(needs_sweeps, needs_gauss_seidel(entry.label), "{}", entry.label);
            assert_eq!(law.interface.is_some(), has_interface(entry.label), "{}", entry.label);
            let bonds = memory.iter().any(|kind| [ContactMemory::LiquidBridge, ContactMemory::Bond].contains(kind));
            assert_eq!(law.can_bond(), bonds, "{}", entry.label);
            assert_eq!(law.has_two_frictions(), memory.contains(&ContactMemory::Sliding), "{}", entry.label);
            let moment = memory.contains(&ContactMemory::Moment);
            assert_eq!(law.has_memory(), bonds || moment, "{}", entry.label);
            assert_eq!(law.has_reference_gap, memory.contains(&ContactMemory::ReferenceGap), "{}", entry.label);
            assert_eq!(law.interface.is_some(), memory.contains(&ContactMemory::Damage), "{}", entry.label);
        }
    }

    /// Edges and vertices meet with the radius 0; a pair in exact touch is closed, and no law acts on it as on an open one.
    #[test]
    fn the_limits_of_laws_belong_to_closed_and_resting_contacts() {
        let restitution = new_law("RST_CLB", &[0.5, 0.25, 0.4]);
        for radius in [0.0, 2.0] {
            assert!(restitution.is_closed_gap(CLOSED_GAP * radius, radius));
        }
        // A pair that rests is not reversed along the tangent.
        let at_rest = LawShift { friction: 0.4, ..acting() };
        assert_eq!(restitution.contact_shift(&touching()), Some(at_rest));
        // 1 m in 0.5 s at 2 m/s: it comes to touch, and is thrown back in the next step.
        let due = LawInput { gap: 1.0, u_n: -2.0, gap_forecast: GapForecast::Due, ..touching() };
        assert!(!restitution.throws_back(&due));
        // Spheres that miss each other act only by an attraction, up to its range.
        let wet = new_law("RST_WET_CLB", &[10.0, 0.0, 0.5, 0.25, 0.125, 0.2, 0.3]);
        let passing = |gap| LawInput { gap, gap_forecast: GapForecast::Passing, ..touching() };
        let bridged = LawShift { normal: 0.25, impulse: -5.0, friction: 0.3, ..acting() };
        assert_eq!((wet.contact_shift(&passing(0.125)), wet.contact_shift(&passing(0.25))), (Some(bridged), None));
        // The first sweep solves only those pairs that are apart and attract each other.
        let pair = new_law("RST_COH_DS_CLB", &[10.0, 0.5, 0.25, 0.25, 0.5, 0.2, 0.3]);
        let is_solved = |pair_attraction| {
            pair.contact_shift(&LawInput { gap: 1.0, pair_attraction, ..touching() }).map(|shift| shift.solved)
        };
        assert_eq!((is_solved(1.0), is_solved(0.0)), (Some(true), Some(false)));
    }

    /// 4 N/m and 8 N s/m, of which the damper acts on closed contacts, in steps of 0.5 s with the next contact after 0.25 s.
    #[test]
    fn a_damped_spring_is_a_spring_while_it_is_open() {
        let law = new_law("VISCO_ELASTIC_REPELL_CLB", &[4.0, 8.0, 0.4]);
        let shift = |gap, gap_forecast| {
            law.contact_shift(&LawInput { gap, closing_time: 0.25, gap_forecast, ..touching() })
                .map(|shift| shift.normal)
        };
        let apart = GapForecast::Apart { depth: 0.0 };
        assert_eq!((shift(-0.5, apart), shift(0.0, apart), shift(0.5, apart)), (Some(-2.0 / 9.0), Some(0.0), None));
        assert_eq!(shift(0.5, GapForecast::Due), Some(2.0));
        let regularisation = |gap| law.regularisation(gap, 0.5, 0.25);
        assert_eq!(regularisation(0.0), Some(LawRegularisation::Compliance(1.0 / 4.5)));
        assert_eq!(regularisation(0.5), Some(LawRegularisation::Compliance(2.0)));
    }

    #[test]
    fn springs_bonds_and_rescues_follow_their_formulas() {
        // 4 N, 2 m without strain and 2.5 m with the prestrain, stretched to 3 m; k T + η = 9 N s.
        let law = new_law("VOIGT_ROD", &[4.0, 0.25, 8.0]);
        let spring = law.strain_spring().unwrap();
        assert_eq!(spring.shift_and_compliance(3.0, 2.0, 0.5, 0.25), (2.0 / 9.0, 2.0 / 4.5));
        // T = 4π h, that is τ = 2; 3 m too deep.
        let rescue = GapRescue { steps: 2.0 * std::f64::consts::TAU, gap: -0.25 };
        assert_eq!(
            (rescue.velocity(-3.25, 0.5), rescue.velocity(-0.25, 0.5), rescue.velocity(0.5, 0.5)),
            (3.0, 0.0, 0.0)
        );
        // A disc of 0.5 m: C = 1/(k S h T) along the normal, and I = S R²/4, J = S R²/2.
        let bond = new_law("ELASTIC_BEAM_DS_CLB", &[4.0, 2.0, 10.0, 5.0, 0.5, 0.2, 0.3]);
        let BondCompliance { opening, sliding, bending, torsion } = bond.bond_compliance(0.5, 0.5, 0.25).unwrap();
        let area = 0.25 * std::f64::consts::PI;
        let expected = [1.0 / (0.5 * area), 1.0 / (0.25 * area), 4.0 / (0.125 * area), 2.0 / (0.0625 * area)];
        for (found, expected) in [opening, sliding, bending, torsion].into_iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 1e-15, "{found} {expected}"); // one rounding
        }
        // Edges without an area rub with the whole coefficient.
        let interface = new_law("IQS_MAL_CZM", &[0.2, 0.3, 4.0, 4.0, 2.0, 2.0, 8.0, 8.0]);
        assert_eq!((interface.friction_share(0.75, 2.0), interface.friction_share(0.75, 0.0)), (0.25, 1.0));
        let reference_gaps = |law: ContactLaw| [-0.5, 0.5].map(|gap| law.reference_gap(gap));
        assert_eq!(reference_gaps(new_law("ELASTIC_REPELL_CLB_g0", &[4.0, 0.3])), [-0.5, 0.5]);
        assert_eq!(reference_gaps(new_law("IQS_CLB_g0", &[0.3])), [0.0, 0.5]);
        assert_eq!(reference_gaps(new_law("IQS_CLB", &[0.3])), [0.0, 0.0]);
    }

    #[test]
    fn laws_without_restitution_cohesion_or_shear_strength_have_none() {
        assert!(!new_law("RST_CLB", &[0.0, 0.25, 0.4]).has_restitution());
        let mut law = new_law("RST_CLB", &[0.5, 0.25, 0.4]);
        assert_eq!((law.max_closing_speed(4.0), law.max_closing_speed(-4.0)), (2.0, 0.0));
        assert_eq!((law.restitution_at(-4.0), new_law("IQS_CLB", &[0.4]).restitution_at(-4.0)), (Some(0.5), None));
        law.remove_restitution();
        assert_eq!((law.restitution_at(-4.0), law.max_closing_speed(4.0)), (Some(0.0), 0.0));
        // e = 0.5 (1/4)^(1/2) at 4 m/s.
        let falling = new_law("RST_VEL_DS_CLB", &[0.5, 0.0, 1.0, 0.5, 0.2, 0.4, 2.0]);
        assert_eq!(falling.restitution_at(-4.0), Some(0.25));
        let bond = |shear| new_law("IQS_MOHR_DS_CLB", &[10.0, shear, 0.2, 0.3]);
        assert!(bond(5.0).bonds_are_rigid() && !bond(0.0).bonds_are_rigid());
        let ranges = |law: ContactLaw| (law.interaction_range(2.0), law.range_of_stress(2.0));
        assert_eq!(ranges(bond(5.0)), (4.0 * MAX_TOUCHING_GAP, 4.0 * MAX_TOUCHING_GAP));
        assert_eq!(ranges(new_law("IQS_WET_DS_CLB", &[10.0, 0.0, 0.25, 0.2, 0.3])), (0.25, f64::INFINITY));
        assert_eq!(ranges(law), (0.0, f64::INFINITY));
        let interface = new_law("IQS_MAL_CZM", &[0.2, 0.3, 4.0, 4.0, 2.0, 2.0, 8.0, 8.0]);
        assert_eq!(ranges(interface), (0.0, f64::INFINITY));
        // Without cohesion in the table there is no ratio of shear to traction to keep.
        assert!(!new_law("IQS_MOHR_DS_CLB", &[0.0, 0.0, 0.2, 0.3]).set_cohesion(1.0));
    }

    #[test]
    fn families_of_laws_have_their_properties() {
        for entry in LAW_TABLE.iter().filter(|entry| entry.computed) {
            let values: Vec<f64> = (1..).take(entry.parameters().count()).map(|k| 0.25 * f64::from(k)).collect();
            let (law, label) = (new_law(entry.label, &values), entry.label);
            let is_bond = label.contains("MOHR") || label.contains("BEAM");
            let is_elastic_bond = label == "ELASTIC_BEAM_DS_CLB";
            let is_on_touch = label == "VEL_SGR_CLB" || label.starts_with("RST_");
            let is_interface = label.ends_with("_CZM");
            let has_reference = label.ends_with("_g0");
            let (is_coupling, is_link) = (label == "COUPLED_DOF", is_law_of_points(label));
            let is_pair = label.contains("_COH_") || label.contains("_VDW_");
            for (name, found, expected) in [
                ("damped spring", law.is_damped_spring(), label == "VISCO_ELASTIC_REPELL_CLB"),
                ("on touch", law.acts_on_touch(), is_on_touch),
                ("rescue", law.rescue().is_some(), label == "IQS_CLB_RGR"),
                ("stress", law.has_stress(), is_bond || is_interface),
                ("radius", law.depends_on_radius(), is_on_touch || is_bond || is_interface),
                ("elastic bond", law.bond_stiffness().is_some(), is_elastic_bond),
                ("pair", law.pair_cohesion().is_some(), is_pair),
                ("memory", law.has_law_memory(), has_reference || is_interface),
                ("coupling", law.is_coupled(), is_coupling),
                ("apart", law.acts_apart(), is_coupling || is_link || has_reference || is_interface),
                ("friction", law.has_friction(), !is_coupling && !is_link),
                ("loss", law.has_irreversible_loss(), law.has_two_frictions() || is_bond && !is_elastic_bond),
            ] {
                assert_eq!(found, expected, "{label}: {name}");
            }
        }
        let rest = ContactMotion::default();
        assert!(!rest.is_any());
        for motion in [
            ContactMotion { opens: true, ..rest },
            ContactMotion { slides: true, ..rest },
            ContactMotion { turns: true, ..rest },
        ] {
            assert!(motion.is_any(), "{motion:?}");
        }
    }
}
