//! Contact laws: one table for the files, the scene, the solver, the observables and the docs.
//!
//! A row of the table has the name of a law in TACT_BEHAV.DAT and in a scene, its parameters line by line, its friction,
//! cohesion and rolling friction, and a description. The rest is derived:
//!
//! | used by | item |
//! |---|---|
//! | reader and writer of TACT_BEHAV.DAT | [`LAW_TABLE`], the lines of [`LawParameter`]s of each law |
//! | scene | [`LawModel`], whose variants have the names of the table, and [`LawModel::relation_faults`] |
//! | cd-solve | [`LawModel::from_values`]; its condition along the normal is a `match` of [`LawModel`] in `solver/src/laws` |
//! | cd-post | [`LawModel::friction_limit`] |
//! | docs | descriptions, units, [`LawModel::memory`]; `formats/tests/docs.rs` compares |
//!
//! The table itself and the solver match [`LawModel`] and [`LawCohesion`] without a wildcard, so that a law or a cohesion
//! that is not handled is an error of the compiler. Tests compare friction limit, memory and changes by events with the
//! solver for each law of the table.

mod error;
mod interface;
mod pair;
mod rejected;

use serde::Deserialize;

use crate::names::number_text;
use crate::ron_text::nearest_name;

pub use error::LawError;
pub use interface::{DamageLaw, InterfaceFault, InterfaceMode, InterfaceParameter, LawInterface, ModePair};
pub use pair::{PairCohesion, PairStrength, SpherePacking};
pub use rejected::rejection_reason;

/// Physical quantity of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ParameterQuantity {
    Number,
    /// Coefficient of Coulomb friction.
    Friction,
    Force,
    Length,
    Speed,
    Stress,
    Stiffness,
    Viscosity,
    StiffnessPerArea,
    SurfaceEnergy,
    Energy,
    DamageViscosity,
    /// Ratio of force to rate of strain.
    StrainViscosity,
}

impl ParameterQuantity {
    /// SI unit; empty for numbers.
    pub fn unit(self) -> &'static str {
        match self {
            ParameterQuantity::Number | ParameterQuantity::Friction => "",
            ParameterQuantity::Force => "N",
            ParameterQuantity::Length => "m",
            ParameterQuantity::Speed => "m/s",
            ParameterQuantity::Stress => "Pa",
            ParameterQuantity::Stiffness => "N/m",
            ParameterQuantity::Viscosity => "N s/m",
            ParameterQuantity::StiffnessPerArea => "Pa/m",
            ParameterQuantity::SurfaceEnergy => "J/m²",
            ParameterQuantity::Energy => "J",
            ParameterQuantity::DamageViscosity => "J s/m²",
            ParameterQuantity::StrainViscosity => "N s",
        }
    }
}

/// Values that a parameter can have in a law in use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ParameterLimit {
    NonNegative,
    ZeroToOne,
    Positive,
    NonPositive,
    /// Any finite number.
    Finite,
}

/// Values that the reader of TACT_BEHAV.DAT accepts. It accepts more than [`ParameterLimit`], which concerns laws in use:
/// a file may define laws that no contact uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileLimit {
    NonNegative,
    Finite,
}

macro_rules! law_parameters {
    ($($(#[doc = $help:literal])+
        $parameter:ident: $label:literal, $name:literal, $symbol:literal, $quantity:ident, $limit:ident, $file:ident;)+) => {
        /// Parameter of a contact law.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum LawParameter { $($(#[doc = $help])+ $parameter,)+ }

        impl LawParameter {
            /// Label in TACT_BEHAV.DAT, at most four characters. Two parameters of different laws can have the same label.
            pub fn label(self) -> &'static str {
                match self { $(LawParameter::$parameter => $label,)+ }
            }

            /// Name in a scene.
            pub fn name(self) -> &'static str {
                match self { $(LawParameter::$parameter => $name,)+ }
            }

            /// Symbol in the docs.
            pub fn symbol(self) -> &'static str {
                match self { $(LawParameter::$parameter => $symbol,)+ }
            }

            /// Physical quantity, which gives the unit.
            pub fn quantity(self) -> ParameterQuantity {
                match self { $(LawParameter::$parameter => ParameterQuantity::$quantity,)+ }
            }

            /// Values that a law in use can have.
            pub fn limit(self) -> ParameterLimit {
                match self { $(LawParameter::$parameter => ParameterLimit::$limit,)+ }
            }

            /// Values that the reader of TACT_BEHAV.DAT accepts.
            pub fn file_limit(self) -> FileLimit {
                match self { $(LawParameter::$parameter => FileLimit::$file,)+ }
            }
        }
    };
}

// Label, name, symbol, quantity, limit of laws in use, limit of the file. Parameters have no defaults.
law_parameters! {
    /// Coefficient of friction.
    Friction: "fric", "friction", "μ", Friction, NonNegative, NonNegative;
    /// Coefficient of friction of a contact that slides.
    DynamicFriction: "dyfr", "dynamic_friction", "μ dynamic", Friction, NonNegative, NonNegative;
    /// Coefficient of friction of a contact that does not slide yet.
    StaticFriction: "stfr", "static_friction", "μ static", Friction, NonNegative, NonNegative;
    /// Newton's coefficient of restitution along the normal.
    NormalRestitution: "rstn", "normal_restitution", "e_n", Number, ZeroToOne, NonNegative;
    /// Newton's coefficient of restitution in the tangent plane.
    TangentialRestitution: "rstt", "tangential_restitution", "e_t", Number, ZeroToOne, Finite;
    /// Speed of approach above which the restitution falls.
    RestitutionSpeed: "vrst", "restitution_speed", "v_e", Speed, Positive, NonNegative;
    /// Power of the ratio of speeds by which it falls.
    RestitutionExponent: "prst", "restitution_exponent", "p", Number, NonNegative, NonNegative;
    /// Speed of sliding at which friction has fallen by 63 % of the difference between its two coefficients.
    FrictionSpeed: "vfri", "friction_speed", "v_f", Speed, Positive, NonNegative;
    /// Attraction at each point of contact.
    LiquidCohesion: "cohn", "cohesion", "cohesion", Force, NonNegative, NonNegative;
    /// Second cohesion of LMGC90's laws with a liquid, which its 3D solver does not use. Not in scenes; written as 0.
    UnusedCohesion: "coht", "unused", "not used", Number, Finite, Finite;
    /// Largest gap at which a liquid attracts.
    LiquidRange: "Wthk", "range", "range", Length, NonNegative, NonNegative;
    /// Cohesive stress on the area π R² of a pair.
    CohesiveStress: "strs", "cohesive_stress", "c", Stress, NonNegative, NonNegative;
    /// Hamaker constant of the material.
    HamakerConstant: "hmkr", "hamaker_constant", "A", Energy, NonNegative, NonNegative;
    /// Distance of the surfaces of bodies that touch, by their roughness.
    SurfaceDistance: "dist", "surface_distance", "ζ", Length, Positive, NonNegative;
    /// Largest gap at which the whole force of a pair acts.
    FullRange: "full", "full_range", "full range", Length, NonNegative, NonNegative;
    /// Largest traction of a bond.
    NormalCohesion: "cohn", "normal_cohesion", "c_n", Stress, NonNegative, NonNegative;
    /// Largest shear of a bond without normal force.
    TangentialCohesion: "coht", "tangential_cohesion", "c_t", Stress, NonNegative, Finite;
    /// Radius of a bond that carries moments, over the smaller radius of its two bodies.
    BondRadius: "rbnd", "bond_radius", "λ", Number, Positive, NonNegative;
    /// Moment against rolling divided by R times the normal force.
    RollingFriction: "roll", "rolling_friction", "μ_r", Number, NonNegative, NonNegative;
    /// Moment against spinning divided by R times the normal force.
    SpinningFriction: "spin", "spinning_friction", "μ_s", Number, NonNegative, NonNegative;
    /// Largest tension of a capped bond.
    TensionCap: "sten", "tension_cap", "limit in tension", Stress, Finite, Finite;
    /// Largest compression of a capped bond.
    CompressionCap: "scom", "compression_cap", "limit in compression", Stress, Finite, Finite;
    /// Relaxation of a gap: ratio of the period to the time step.
    RelaxationSteps: "T/H", "relaxation_steps", "T/h", Number, Positive, Finite;
    /// Gap below which relaxation begins, at most 0.
    RelaxationGap: "gtol", "relaxation_gap", "gap", Length, NonPositive, Finite;
    /// Ratio of force to gap.
    Stiffness: "F/gp", "stiffness", "stiffness", Stiffness, Positive, NonNegative;
    /// Ratio of force to velocity of the gap.
    NormalViscosity: "etan", "normal_viscosity", "viscosity", Viscosity, NonNegative, Finite;
    /// Ratio of the traction of an interface or bond to its opening.
    NormalStiffness: "cn", "normal_stiffness", "k_n", StiffnessPerArea, Positive, NonNegative;
    /// Ratio of the shear of an interface or bond to its sliding.
    TangentialStiffness: "ct", "tangential_stiffness", "k_t", StiffnessPerArea, Positive, NonNegative;
    /// Largest traction of an interface.
    NormalStrength: "s1", "normal_strength", "s_n", Stress, Positive, NonNegative;
    /// Largest shear of an interface.
    TangentialStrength: "s2", "tangential_strength", "s_t", Stress, Positive, NonNegative;
    /// Energy that breaks an interface by opening.
    NormalEnergy: "G1", "normal_energy", "G_n", SurfaceEnergy, Positive, NonNegative;
    /// Energy that breaks an interface by sliding.
    TangentialEnergy: "G2", "tangential_energy", "G_t", SurfaceEnergy, Positive, NonNegative;
    /// Share of the strength at which an exponential interface is broken.
    RestShare: "eta", "rest_share", "η", Number, Positive, NonNegative;
    /// Opening at which the traction begins to fall.
    NormalPlateau: "dp1", "normal_plateau", "d_n", Length, Positive, NonNegative;
    /// Sliding at which the shear begins to fall.
    TangentialPlateau: "dp2", "tangential_plateau", "d_t", Length, Positive, NonNegative;
    /// Viscosity of the loss of adhesion.
    DamageViscosity: "visc", "damage_viscosity", "b", DamageViscosity, NonNegative, Finite;
    /// Energy of adhesion.
    AdhesionEnergy: "dupr", "adhesion_energy", "w", SurfaceEnergy, NonNegative, Finite;
    /// Ratio of the force of a wire or rod to its strain.
    WireStiffness: "F/gp", "stiffness", "stiffness", Force, Positive, NonNegative;
    /// Ratio of the force of a wire or rod to its rate of strain.
    WireViscosity: "F/vl", "viscosity", "viscosity", StrainViscosity, NonNegative, Finite;
    /// Strain of a wire or rod without force.
    Prestrain: "prst", "prestrain", "prestrain", Number, Finite, Finite;
}

impl LawParameter {
    /// Whether a law in use can have this value.
    pub fn accepts(self, value: f64) -> bool {
        value.is_finite()
            && match self.limit() {
                ParameterLimit::NonNegative => value >= 0.0,
                ParameterLimit::ZeroToOne => (0.0..=1.0).contains(&value),
                ParameterLimit::Positive => value > 0.0,
                ParameterLimit::NonPositive => value <= 0.0,
                ParameterLimit::Finite => true,
            }
    }

    /// Values that [`LawParameter::accepts`] accepts, in words: `a force >= 0 N`.
    pub fn expected(self) -> String {
        let noun = match self.quantity() {
            ParameterQuantity::Number | ParameterQuantity::Friction => "finite number",
            ParameterQuantity::Force => "force",
            ParameterQuantity::Length => "distance",
            ParameterQuantity::Speed => "speed",
            ParameterQuantity::Stress => "stress",
            ParameterQuantity::Stiffness => "stiffness",
            ParameterQuantity::Viscosity | ParameterQuantity::DamageViscosity | ParameterQuantity::StrainViscosity => {
                "viscosity"
            }
            ParameterQuantity::StiffnessPerArea => "stiffness",
            ParameterQuantity::SurfaceEnergy | ParameterQuantity::Energy => "energy",
        };
        let text = match self.limit() {
            ParameterLimit::NonNegative => format!("a {noun} >= 0 {}", self.quantity().unit()),
            ParameterLimit::Positive => format!("a {noun} > 0 {}", self.quantity().unit()),
            ParameterLimit::NonPositive => format!("a {noun} <= 0 {}", self.quantity().unit()),
            ParameterLimit::ZeroToOne => "0 to 1".into(),
            ParameterLimit::Finite => {
                format!("a finite {} {}", noun.trim_start_matches("finite "), self.quantity().unit())
            }
        };
        text.trim_end().to_string()
    }
}

/// Coefficients of Coulomb friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrictionPair {
    /// Coefficient of a contact that does not slide yet.
    pub static_friction: f64,
    /// Coefficient of a contact that slid in the last step.
    pub dynamic_friction: f64,
}

impl FrictionPair {
    /// One coefficient for both.
    fn constant_friction(friction: f64) -> FrictionPair {
        FrictionPair { static_friction: friction, dynamic_friction: friction }
    }
}

/// Attraction or bond between two bodies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LawCohesion {
    /// Constant attraction `force` (N) at each point of contact while the gap is at most `range` (m). If `remembers`, only
    /// through a liquid bridge, which breaks for good once the gap exceeds the range.
    Liquid { force: f64, range: f64, remembers: bool },
    /// Attraction of the two bodies by a force that follows from their size.
    Pair(PairCohesion),
    /// Bond that carries stresses (Pa) up to `normal` in traction and `tangential` in shear, and breaks for good. With a
    /// `radius`, over the smaller radius of the two bodies, the bond of a sphere is a disc of this size that also carries
    /// moments. With a `stiffness` it is elastic, else rigid.
    Bond { normal: f64, tangential: f64, radius: Option<f64>, stiffness: Option<BondStiffness> },
}

/// Stiffnesses of an elastic bond per area, Pa/m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BondStiffness {
    /// Ratio of the traction to the opening.
    pub normal: f64,
    /// Ratio of the shear to the sliding.
    pub tangential: f64,
}

/// Coefficients of the moments of a contact. They multiply R r̂_n, where 1/R = 1/R_a + 1/R_b for bodies of the radii R_a and
/// R_b, and r̂_n is the normal force plus the attraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RollingFriction {
    /// Largest moment in the tangent plane, opposite to the rolling.
    pub rolling: f64,
    /// Largest moment along the normal, opposite to the spinning.
    pub spinning: f64,
}

/// State of a contact that a step hands to the next, besides its impulse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ContactMemory {
    /// Whether the contact slid, for the choice of the coefficient of friction.
    Sliding,
    /// Whether the liquid bridge holds.
    LiquidBridge,
    /// Whether the bond holds, and its gap.
    Bond,
    /// Angular impulse of rolling and spinning friction, for the warm start.
    Moment,
    /// Gap from which the law counts: the gap at the start.
    ReferenceGap,
    /// Damage of the interface, and the sliding of the contact.
    Damage,
}

/// State of a contact that determines its friction limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactLoad {
    /// Gap, m.
    pub gap: f64,
    /// Normal force, N, > 0 pushes.
    pub normal_force: f64,
    /// Area on which the stresses of a bond act, m².
    pub area: f64,
    /// Whether a bond or a liquid bridge holds.
    pub bonded: bool,
    /// Soundness β of an elastic interface, 0 to 1; 0 without an interface.
    pub soundness: f64,
    /// Attraction of a law with cohesion per pair at this contact, N; 0 for other laws.
    pub attraction: f64,
}

/// Internal variables of a contact in Vloc_Rloc files, in LMGC90's order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LawInternals {
    None,
    /// Size of an element of a deformable body, which LMGC90 reads for rigid ones, too; written as 0.
    Size,
    ReferenceGap,
    SizeAndReferenceGap,
    /// Sliding and soundness of an interface at [`INTERFACE_SLIDING`] and [`INTERFACE_SOUNDNESS`]; the others are 0.
    Interface,
}

/// Row of [`LAW_TABLE`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawEntry {
    /// Name in TACT_BEHAV.DAT and in a scene, e.g. `IQS_CLB`.
    pub label: &'static str,
    /// Parameters of each line of TACT_BEHAV.DAT.
    pub lines: &'static [&'static [LawParameter]],
    /// Whether the programs compute with the law; else its file can only be read and written.
    pub computed: bool,
    /// Internal variables of its contacts.
    pub internals: LawInternals,
    /// Beginning of the law's section in docs/reference/laws.md; empty if the law is not computed.
    pub description: &'static str,
}

impl LawEntry {
    /// Parameters in the order of the file.
    pub fn parameters(&self) -> impl Iterator<Item = LawParameter> + use<> {
        self.lines.iter().flat_map(|line| line.iter().copied())
    }
}

/// Row of a law; `None` for an unknown name.
pub fn law_entry(label: &str) -> Option<&'static LawEntry> {
    LAW_TABLE.iter().find(|entry| entry.label == label)
}

/// Parameters of a law in the order of the file; none for an unknown name.
pub fn law_parameters(label: &str) -> impl Iterator<Item = LawParameter> {
    law_entry(label).into_iter().flat_map(LawEntry::parameters)
}

/// Whether a law is one of wires and rods, which act between points `PT3Dx` and between nothing else: these laws, and no
/// others, have the parameter [`LawParameter::WireStiffness`].
pub fn is_law_of_points(label: &str) -> bool {
    law_parameters(label).any(|parameter| parameter == LawParameter::WireStiffness)
}

/// Internal variables of the contacts of a law; none for an unknown name.
pub fn law_internals(label: &str) -> LawInternals {
    law_entry(label).map_or(LawInternals::None, |entry| entry.internals)
}

/// Whether a law has an elastic interface.
pub fn has_interface(label: &str) -> bool {
    law_internals(label) == LawInternals::Interface
}

/// Positions of the sliding of an interface along t and s among the internal variables of a contact in Vloc_Rloc files,
/// where LMGC90 has them.
pub const INTERFACE_SLIDING: [usize; 2] = [1, 3];
/// Position of the soundness of an interface among these internal variables.
pub const INTERFACE_SOUNDNESS: usize = 4;
/// Number of the internal variables of an interface.
pub const INTERFACE_INTERNALS: usize = 7;

/// Position of the reference gap among the internal variables of a contact in Vloc_Rloc files, where LMGC90 has it; `None` for
/// laws without a reference gap.
pub fn reference_gap_position(label: &str) -> Option<usize> {
    match law_internals(label) {
        LawInternals::ReferenceGap => Some(0),
        LawInternals::SizeAndReferenceGap => Some(1),
        LawInternals::None | LawInternals::Size | LawInternals::Interface => None,
    }
}

/// Whether only the solvers `auto` and `nlgs` compute with a law: those with springs or moments, and `COUPLED_DOF`. Tests of
/// cd-solve compare with the conditions of each law.
pub fn needs_gauss_seidel(label: &str) -> bool {
    let is_of_springs_or_moments = |parameter: LawParameter| {
        matches!(parameter.quantity(), ParameterQuantity::Stiffness | ParameterQuantity::StiffnessPerArea)
            || [LawParameter::RollingFriction, LawParameter::BondRadius].contains(&parameter)
    };
    label == "COUPLED_DOF" || is_law_of_points(label) || law_parameters(label).any(is_of_springs_or_moments)
}

/// Names of the laws that the programs compute with, as a text. Laws of the solvers `auto` and `nlgs`, and of points `PT3Dx`,
/// come last, since they are rejected with other solvers, or where the others act.
pub fn computed_list() -> String {
    let (of_points, of_surfaces): (Vec<&str>, Vec<&str>) = computed_labels().partition(|label| is_law_of_points(label));
    let (of_two_solvers, of_all): (Vec<&str>, Vec<&str>) =
        of_surfaces.into_iter().partition(|label| needs_gauss_seidel(label));
    let [of_all, of_two_solvers, of_points] = [of_all, of_two_solvers, of_points].map(|labels| labels.join(", "));
    format!("{of_all}; with solver auto or nlgs {of_two_solvers}, and between PT3Dx {of_points}")
}

/// Names of the laws that the programs compute with.
fn computed_labels() -> impl Iterator<Item = &'static str> {
    LAW_TABLE.iter().filter(|entry| entry.computed).map(|entry| entry.label)
}

/// Value of a parameter that a law in use cannot have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParameterFault {
    pub parameter: LawParameter,
    pub found: String,
    /// Values that are expected, without the word.
    pub expected: String,
}

impl std::fmt::Display for ParameterFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}; expected {}", self.parameter.name(), self.found, self.expected)
    }
}

impl std::error::Error for ParameterFault {}

impl From<InterfaceFault> for ParameterFault {
    fn from(InterfaceFault { parameter, found, expected }: InterfaceFault) -> ParameterFault {
        let parameter = match parameter {
            InterfaceParameter::Energy(InterfaceMode::Opening) => LawParameter::NormalEnergy,
            InterfaceParameter::Energy(InterfaceMode::Sliding) => LawParameter::TangentialEnergy,
            InterfaceParameter::Plateau(InterfaceMode::Opening) => LawParameter::NormalPlateau,
            InterfaceParameter::Plateau(InterfaceMode::Sliding) => LawParameter::TangentialPlateau,
            InterfaceParameter::Rest => LawParameter::RestShare,
        };
        ParameterFault { parameter, found, expected }
    }
}

impl std::fmt::Display for InterfaceFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        ParameterFault::from(self.clone()).fmt(f)
    }
}

impl std::error::Error for InterfaceFault {}

/// Error of a law that the programs do not compute, or that does not have `count` parameters.
fn law_error(label: &str, count: usize) -> LawError {
    let (found, expected) = match (law_entry(label), rejection_reason(label)) {
        (_, Some(reason)) => {
            (format!("its kind {label} is not computed: {reason}"), format!("computed are {}", computed_list()))
        }
        (None, None) => {
            let near = nearest_name(label, &computed_labels().collect::<Vec<_>>());
            let expected = match near {
                Some(near) => format!("did you mean {near}?"),
                None => format!("expected one of {}", computed_list()),
            };
            (format!("its kind '{label}' is not known"), expected)
        }
        (Some(entry), None) => {
            let names: Vec<&str> = entry.parameters().map(LawParameter::label).collect();
            (format!("{label} with {count} parameters"), format!("expected {}: {}", names.len(), names.join(", ")))
        }
    };
    LawError { found, expected }
}

/// Pattern that ignores the value of a parameter that no law uses.
macro_rules! ignored {
    ($unused:ident) => {
        _
    };
}

/// Value written for a parameter that no law uses.
macro_rules! zero {
    ($unused:ident) => {
        0.0
    };
}

/// Internal variables of a law; none if its row has no `internals`.
macro_rules! internals {
    () => {
        LawInternals::None
    };
    ($internals:ident) => {
        LawInternals::$internals
    };
}

macro_rules! contact_laws {
    (computed { $($(#[doc = $help:literal])+ $law:ident $label:literal {
        lines: [$([$($field:ident: $parameter:ident),* $(; $unused:ident)?]),*],
        friction: $friction:expr
        $(, friction_speed: $friction_speed:expr)?
        $(, cohesion: $cohesion:expr)?
        $(, rolling: $rolling:expr)?
        $(, remembers: $memory:ident)?
        $(, internals: $internals:ident)?
        $(, interface: $interface:expr)?
    })+ } exchanged { $($other:literal [$([$($other_parameter:ident),*]),*];)+ }) => {
        /// Contact law with the values of its parameters, in SI units. A scene gives it by the name of the table, as
        /// `IQS_CLB(friction: 0.4)`.
        #[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub enum LawModel { $($(#[doc = $help])+ #[serde(rename = $label)] $law { $($($field: f64,)*)* },)+ }

        /// All laws that TACT_BEHAV.DAT can have: first those that the programs compute with, then those that are only read
        /// and written, for exchange with LMGC90.
        pub const LAW_TABLE: &[LawEntry] = &[
            $(LawEntry {
                label: $label,
                lines: &[$(&[$(LawParameter::$parameter,)* $(LawParameter::$unused)?]),*],
                computed: true,
                internals: internals!($($internals)?),
                description: concat!($($help),+).trim_ascii(),
            },)+
            $(LawEntry {
                label: $other,
                lines: &[$(&[$(LawParameter::$other_parameter),*]),*],
                computed: false,
                internals: LawInternals::None,
                description: "",
            },)+
        ];

        impl LawModel {
            /// Law of a name and values in the order of TACT_BEHAV.DAT. Errors: a name that is not known or not computed, or
            /// another number of values than the law has.
            pub fn from_values(label: &str, values: &[f64]) -> Result<LawModel, LawError> {
                match (label, values) {
                    $(($label, &[$($($field,)* $(ignored!($unused),)?)*]) => Ok(LawModel::$law { $($($field,)*)* }),)+
                    _ => Err(law_error(label, values.len())),
                }
            }

            /// Name in TACT_BEHAV.DAT and in a scene.
            pub fn label(&self) -> &'static str {
                match self { $(LawModel::$law { .. } => $label,)+ }
            }

            /// Values of the parameters in the order of TACT_BEHAV.DAT.
            pub fn values(&self) -> Vec<f64> {
                match *self { $(LawModel::$law { $($($field,)*)* } => vec![$($($field,)* $(zero!($unused),)?)*],)+ }
            }

            /// Coefficients of Coulomb friction.
            #[allow(unused_variables)]
            pub fn friction(&self) -> FrictionPair {
                match *self { $(LawModel::$law { $($($field,)*)* } => $friction,)+ }
            }

            /// Speed of sliding over which friction falls from the static to the dynamic coefficient, m/s, if it does.
            #[allow(unused_variables)]
            pub fn friction_speed(&self) -> Option<f64> {
                match *self { $(LawModel::$law { $($($field,)*)* } => None$(.or(Some($friction_speed)))?,)+ }
            }

            /// Attraction or bond, if the law has one.
            #[allow(unused_variables)]
            pub fn cohesion(&self) -> Option<LawCohesion> {
                match *self { $(LawModel::$law { $($($field,)*)* } => None$(.or(Some($cohesion)))?,)+ }
            }

            /// Moments against rolling and spinning, if the law has them.
            #[allow(unused_variables)]
            pub fn rolling(&self) -> Option<RollingFriction> {
                match *self { $(LawModel::$law { $($($field,)*)* } => None$(.or(Some($rolling)))?,)+ }
            }

            /// Elastic interface with damage, if the law has one.
            #[allow(unused_variables)]
            pub fn interface(&self) -> Option<LawInterface> {
                match *self { $(LawModel::$law { $($($field,)*)* } => None$(.or(Some($interface)))?,)+ }
            }

            /// State of a contact that the row of the law names in `remembers`.
            fn named_memory(&self) -> Option<ContactMemory> {
                match self { $(LawModel::$law { .. } => None$(.or(Some(ContactMemory::$memory)))?,)+ }
            }
        }
    };
}

// A row: lines of TACT_BEHAV.DAT, `field: parameter` where the field has the name of the parameter, behind `;` one that is
// not used; then the friction, the speed over which it falls, cohesion and rolling friction, made of the fields; memory of
// its own (`remembers`), the internal variables in Vloc_Rloc files (`internals`), and the elastic interface, made of the
// fields, next to which the contact acts (`interface`).
contact_laws! {
    computed {
        /// inelastic quasi-shock with Coulomb friction
        IqsClb "IQS_CLB" {
            lines: [[friction: Friction]],
            friction: FrictionPair::constant_friction(friction)
        }
        /// as `IQS_CLB`, with dynamic and static friction
        IqsDsClb "IQS_DS_CLB" {
            lines: [[dynamic_friction: DynamicFriction, static_friction: StaticFriction]],
            friction: FrictionPair { static_friction, dynamic_friction }
        }
        /// attraction by the constant force `cohesion` while the gap is at most `range`
        IqsWetDsClb "IQS_WET_DS_CLB" {
            lines: [
                [cohesion: LiquidCohesion; UnusedCohesion],
                [range: LiquidRange],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Liquid { force: cohesion, range, remembers: false }
        }
        /// as `IQS_WET_DS_CLB`, for contacts within `range` at the start of the run or at an event `Bond`, until the gap first exceeds `range`
        XqsWetDsClb "xQS_WET_DS_CLB" {
            lines: [
                [cohesion: LiquidCohesion; UnusedCohesion],
                [range: LiquidRange],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Liquid { force: cohesion, range, remembers: true }
        }
        /// bonds between bodies that touch at the start or at an event `Bond`
        IqsMohrDsClb "IQS_MOHR_DS_CLB" {
            lines: [
                [normal_cohesion: NormalCohesion, tangential_cohesion: TangentialCohesion],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Bond { normal: normal_cohesion, tangential: tangential_cohesion, radius: None, stiffness: None }
        }
        /// as `RST_DS_CLB`, with the bonds of `IQS_MOHR_DS_CLB`; not in LMGC90
        RstMohrDsClb "RST_MOHR_DS_CLB" {
            lines: [
                [normal_cohesion: NormalCohesion, tangential_cohesion: TangentialCohesion],
                [normal_restitution: NormalRestitution, tangential_restitution: TangentialRestitution],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Bond { normal: normal_cohesion, tangential: tangential_cohesion, radius: None, stiffness: None }
        }
        /// as `IQS_MOHR_DS_CLB`, with bonds of spheres that also carry bending and torsion; not in LMGC90
        IqsBeamDsClb "IQS_BEAM_DS_CLB" {
            lines: [
                [normal_cohesion: NormalCohesion, tangential_cohesion: TangentialCohesion],
                [bond_radius: BondRadius],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Bond { normal: normal_cohesion, tangential: tangential_cohesion, radius: Some(bond_radius), stiffness: None }
        }
        /// as `IQS_BEAM_DS_CLB`, with elastic bonds; not in LMGC90
        ElasticBeamDsClb "ELASTIC_BEAM_DS_CLB" {
            lines: [
                [normal_stiffness: NormalStiffness, tangential_stiffness: TangentialStiffness],
                [normal_cohesion: NormalCohesion, tangential_cohesion: TangentialCohesion],
                [bond_radius: BondRadius],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Bond {
                normal: normal_cohesion,
                tangential: tangential_cohesion,
                radius: Some(bond_radius),
                stiffness: Some(BondStiffness { normal: normal_stiffness, tangential: tangential_stiffness })
            }
        }
        /// as `IQS_DS_CLB`, with moments against rolling and spinning; not in LMGC90
        IqsDsRollClb "IQS_DS_ROLL_CLB" {
            lines: [
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction],
                [rolling_friction: RollingFriction, spinning_friction: SpinningFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            rolling: RollingFriction { rolling: rolling_friction, spinning: spinning_friction }
        }
        /// as `IQS_WET_DS_CLB`, with moments; not in LMGC90
        IqsWetDsRollClb "IQS_WET_DS_ROLL_CLB" {
            lines: [
                [cohesion: LiquidCohesion; UnusedCohesion],
                [range: LiquidRange],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction],
                [rolling_friction: RollingFriction, spinning_friction: SpinningFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Liquid { force: cohesion, range, remembers: false },
            rolling: RollingFriction { rolling: rolling_friction, spinning: spinning_friction }
        }
        /// attraction of each two bodies by `cohesive_stress` times π R²
        IqsCohDsClb "IQS_COH_DS_CLB" {
            lines: [
                [cohesive_stress: CohesiveStress],
                [full_range: FullRange, range: LiquidRange],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Pair(PairCohesion { strength: PairStrength::Stress(cohesive_stress), full_range, range })
        }
        /// as `IQS_COH_DS_CLB`, with moments against rolling and spinning
        IqsCohDsRollClb "IQS_COH_DS_ROLL_CLB" {
            lines: [
                [cohesive_stress: CohesiveStress],
                [full_range: FullRange, range: LiquidRange],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction],
                [rolling_friction: RollingFriction, spinning_friction: SpinningFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Pair(PairCohesion { strength: PairStrength::Stress(cohesive_stress), full_range, range }),
            rolling: RollingFriction { rolling: rolling_friction, spinning: spinning_friction }
        }
        /// as `RST_DS_CLB`, with the attraction of `IQS_COH_DS_CLB`
        RstCohDsClb "RST_COH_DS_CLB" {
            lines: [
                [cohesive_stress: CohesiveStress],
                [normal_restitution: NormalRestitution, tangential_restitution: TangentialRestitution],
                [full_range: FullRange, range: LiquidRange],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Pair(PairCohesion { strength: PairStrength::Stress(cohesive_stress), full_range, range })
        }
        /// attraction of each two bodies by the van der Waals force A R/(12 ζ²)
        IqsVdwDsClb "IQS_VDW_DS_CLB" {
            lines: [
                [hamaker_constant: HamakerConstant, surface_distance: SurfaceDistance],
                [full_range: FullRange, range: LiquidRange],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Pair(PairCohesion { strength: PairStrength::VanDerWaals { hamaker: hamaker_constant, distance: surface_distance }, full_range, range })
        }
        /// as `IQS_VDW_DS_CLB`, with moments against rolling and spinning
        IqsVdwDsRollClb "IQS_VDW_DS_ROLL_CLB" {
            lines: [
                [hamaker_constant: HamakerConstant, surface_distance: SurfaceDistance],
                [full_range: FullRange, range: LiquidRange],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction],
                [rolling_friction: RollingFriction, spinning_friction: SpinningFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Pair(PairCohesion { strength: PairStrength::VanDerWaals { hamaker: hamaker_constant, distance: surface_distance }, full_range, range }),
            rolling: RollingFriction { rolling: rolling_friction, spinning: spinning_friction }
        }
        /// as `RST_DS_CLB`, with the attraction of `IQS_VDW_DS_CLB`
        RstVdwDsClb "RST_VDW_DS_CLB" {
            lines: [
                [hamaker_constant: HamakerConstant, surface_distance: SurfaceDistance],
                [normal_restitution: NormalRestitution, tangential_restitution: TangentialRestitution],
                [full_range: FullRange, range: LiquidRange],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Pair(PairCohesion { strength: PairStrength::VanDerWaals { hamaker: hamaker_constant, distance: surface_distance }, full_range, range })
        }
        /// Newton's restitution
        RstClb "RST_CLB" {
            lines: [
                [normal_restitution: NormalRestitution, tangential_restitution: TangentialRestitution],
                [friction: Friction]
            ],
            friction: FrictionPair::constant_friction(friction)
        }
        /// as `RST_CLB`, with dynamic and static friction
        RstDsClb "RST_DS_CLB" {
            lines: [
                [normal_restitution: NormalRestitution, tangential_restitution: TangentialRestitution],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction }
        }
        /// as `IQS_DS_CLB`, with friction that falls with the speed of sliding
        IqsVelDsClb "IQS_VEL_DS_CLB" {
            lines: [[dynamic_friction: DynamicFriction, static_friction: StaticFriction], [friction_speed: FrictionSpeed]],
            friction: FrictionPair { static_friction, dynamic_friction },
            friction_speed: friction_speed
        }
        /// as `RST_DS_CLB`, with restitution that falls with the speed of approach and friction that falls with the speed of sliding
        RstVelDsClb "RST_VEL_DS_CLB" {
            lines: [
                [normal_restitution: NormalRestitution, tangential_restitution: TangentialRestitution],
                [restitution_speed: RestitutionSpeed, restitution_exponent: RestitutionExponent],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction],
                [friction_speed: FrictionSpeed]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            friction_speed: friction_speed
        }
        /// as `RST_DS_CLB`, with attraction by the constant force `cohesion` while the gap is at most `range`
        RstWetClb "RST_WET_CLB" {
            lines: [
                [cohesion: LiquidCohesion; UnusedCohesion],
                [normal_restitution: NormalRestitution, tangential_restitution: TangentialRestitution],
                [range: LiquidRange],
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            cohesion: LawCohesion::Liquid { force: cohesion, range, remembers: false }
        }
        /// as `IQS_CLB`, with overlaps deeper than -`relaxation_gap` pushed out in about `relaxation_steps` steps
        IqsClbRgr "IQS_CLB_RGR" {
            lines: [[relaxation_steps: RelaxationSteps, relaxation_gap: RelaxationGap], [friction: Friction]],
            friction: FrictionPair::constant_friction(friction)
        }
        /// Signorini's condition on the gap: removes a penetration in one step
        GapSgrClb "GAP_SGR_CLB" {
            lines: [[friction: Friction]],
            friction: FrictionPair::constant_friction(friction),
            internals: Size
        }
        /// as `IQS_CLB`, with gaps counted from those at the start of the run or at an event `Bond`
        IqsClbG0 "IQS_CLB_g0" {
            lines: [[friction: Friction]],
            friction: FrictionPair::constant_friction(friction),
            remembers: ReferenceGap,
            internals: ReferenceGap
        }
        /// as `GAP_SGR_CLB`, with gaps counted from those at the start of the run or at an event `Bond`
        GapSgrClbG0 "GAP_SGR_CLB_g0" {
            lines: [[friction: Friction]],
            friction: FrictionPair::constant_friction(friction),
            remembers: ReferenceGap,
            internals: SizeAndReferenceGap
        }
        /// linear spring on the overlap at the end of the step
        ElasticRepellClb "ELASTIC_REPELL_CLB" {
            lines: [[stiffness: Stiffness], [friction: Friction]],
            friction: FrictionPair::constant_friction(friction)
        }
        /// as `ELASTIC_REPELL_CLB`, with gaps counted from those at the start of the run or at an event `Bond`
        ElasticRepellClbG0 "ELASTIC_REPELL_CLB_g0" {
            lines: [[stiffness: Stiffness], [friction: Friction]],
            friction: FrictionPair::constant_friction(friction),
            remembers: ReferenceGap,
            internals: ReferenceGap
        }
        /// linear spring and damper on overlaps
        ViscoElasticRepellClb "VISCO_ELASTIC_REPELL_CLB" {
            lines: [[stiffness: Stiffness, normal_viscosity: NormalViscosity], [friction: Friction]],
            friction: FrictionPair::constant_friction(friction)
        }
        /// spring between two points `PT3Dx` that pulls where it is longer than at rest, and is slack where it is shorter
        ElasticWire "ELASTIC_WIRE" {
            lines: [[stiffness: WireStiffness, prestrain: Prestrain]],
            friction: FrictionPair::constant_friction(0.0)
        }
        /// spring between two points `PT3Dx` that pulls and pushes
        ElasticRod "ELASTIC_ROD" {
            lines: [[stiffness: WireStiffness, prestrain: Prestrain]],
            friction: FrictionPair::constant_friction(0.0)
        }
        /// as `ELASTIC_WIRE`, with a damper
        VoigtWire "VOIGT_WIRE" {
            lines: [[stiffness: WireStiffness, prestrain: Prestrain], [viscosity: WireViscosity]],
            friction: FrictionPair::constant_friction(0.0)
        }
        /// as `ELASTIC_ROD`, with a damper
        VoigtRod "VOIGT_ROD" {
            lines: [[stiffness: WireStiffness, prestrain: Prestrain], [viscosity: WireViscosity]],
            friction: FrictionPair::constant_friction(0.0)
        }
        /// no relative velocity within the alert distance, whatever the force
        CoupledDof "COUPLED_DOF" {
            lines: [],
            friction: FrictionPair::constant_friction(0.0)
        }
        /// as `IQS_DS_CLB`, over an elastic interface whose stress falls as a parabola
        IqsMalCzm "IQS_MAL_CZM" {
            lines: [
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction],
                [normal_stiffness: NormalStiffness, tangential_stiffness: TangentialStiffness],
                [normal_strength: NormalStrength, tangential_strength: TangentialStrength],
                [normal_energy: NormalEnergy, tangential_energy: TangentialEnergy]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            remembers: Damage,
            internals: Interface,
            interface: LawInterface {
                normal_stiffness,
                tangential_stiffness,
                damage: DamageLaw::Parabolic { strength: ModePair { opening: normal_strength, sliding: tangential_strength }, energy: ModePair { opening: normal_energy, sliding: tangential_energy } }
            }
        }
        /// as `IQS_DS_CLB`, over an elastic interface whose stress falls exponentially
        IqsExpoCzm "IQS_EXPO_CZM" {
            lines: [
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction],
                [normal_stiffness: NormalStiffness, tangential_stiffness: TangentialStiffness],
                [normal_strength: NormalStrength, tangential_strength: TangentialStrength],
                [normal_energy: NormalEnergy, tangential_energy: TangentialEnergy],
                [rest_share: RestShare]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            remembers: Damage,
            internals: Interface,
            interface: LawInterface {
                normal_stiffness,
                tangential_stiffness,
                damage: DamageLaw::Exponential { strength: ModePair { opening: normal_strength, sliding: tangential_strength }, energy: ModePair { opening: normal_energy, sliding: tangential_energy }, rest: rest_share }
            }
        }
        /// as `IQS_DS_CLB`, over an elastic interface whose stress falls linearly behind a plateau
        IqsThCzm "IQS_TH_CZM" {
            lines: [
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction],
                [normal_stiffness: NormalStiffness, tangential_stiffness: TangentialStiffness],
                [normal_strength: NormalStrength, tangential_strength: TangentialStrength],
                [normal_energy: NormalEnergy, tangential_energy: TangentialEnergy],
                [normal_plateau: NormalPlateau, tangential_plateau: TangentialPlateau]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            remembers: Damage,
            internals: Interface,
            interface: LawInterface {
                normal_stiffness,
                tangential_stiffness,
                damage: DamageLaw::Trapezoidal { strength: ModePair { opening: normal_strength, sliding: tangential_strength }, energy: ModePair { opening: normal_energy, sliding: tangential_energy }, plateau: ModePair { opening: normal_plateau, sliding: tangential_plateau } }
            }
        }
        /// as `IQS_DS_CLB`, over an elastic interface whose adhesion is lost with a viscosity
        IqsMacCzm "IQS_MAC_CZM" {
            lines: [
                [dynamic_friction: DynamicFriction, static_friction: StaticFriction],
                [normal_stiffness: NormalStiffness, tangential_stiffness: TangentialStiffness],
                [damage_viscosity: DamageViscosity, adhesion_energy: AdhesionEnergy]
            ],
            friction: FrictionPair { static_friction, dynamic_friction },
            remembers: Damage,
            internals: Interface,
            interface: LawInterface {
                normal_stiffness,
                tangential_stiffness,
                damage: DamageLaw::Viscous { energy: adhesion_energy, viscosity: damage_viscosity }
            }
        }
        /// Signorini's condition on the velocity
        VelSgrClb "VEL_SGR_CLB" {
            lines: [[friction: Friction]],
            friction: FrictionPair::constant_friction(friction),
            internals: Size
        }
    }
    exchanged {
        "IQS_CAP_MOHR_DS_CLB" [
            [NormalCohesion, TangentialCohesion],
            [DynamicFriction, StaticFriction],
            [TensionCap, CompressionCap]
        ];
    }
}

impl LawModel {
    /// Parameters and their values in the order of TACT_BEHAV.DAT.
    pub fn parameter_values(&self) -> Vec<(LawParameter, f64)> {
        law_parameters(self.label()).zip(self.values()).collect()
    }

    /// Largest tangential force, N, of a contact that does not slide yet: μ f_n, with a liquid μ (f_n + cohesion) while it
    /// attracts, with cohesion per pair μ (f_n + attraction), of a bond on the area S (c_t/c_n) (f_n + c_n S), next to an
    /// elastic interface of the soundness β (1 - β) μ f_n.
    ///
    /// Next to an interface both forces are those of the contact alone, without that of the interface.
    ///
    /// ```
    /// use cd_formats::law_table::{ContactLoad, LawModel};
    /// let law = LawModel::from_values("IQS_WET_DS_CLB", &[4.0, 0.0, 0.1, 0.4, 0.5]).unwrap();
    /// let load = ContactLoad { gap: 0.1, normal_force: 2.0, area: 1.0, bonded: false, soundness: 0.0, attraction: 0.0 };
    /// assert_eq!(law.friction_limit(&load), 0.5 * (2.0 + 4.0));
    /// assert_eq!(law.friction_limit(&ContactLoad { gap: 0.2, ..load }), 0.5 * 2.0);
    /// ```
    pub fn friction_limit(&self, load: &ContactLoad) -> f64 {
        let &ContactLoad { gap, normal_force, area, bonded, soundness, attraction } = load;
        let broken_share = if self.interface().is_some() { 1.0 - soundness } else { 1.0 };
        let coulomb_limit = self.friction().static_friction * broken_share * normal_force;
        match self.cohesion() {
            None => coulomb_limit,
            Some(LawCohesion::Liquid { force, range, remembers }) => {
                if gap <= range && (bonded || !remembers) {
                    self.friction().static_friction * (normal_force + force)
                } else {
                    coulomb_limit
                }
            }
            Some(LawCohesion::Pair(_)) => self.friction().static_friction * (normal_force + attraction),
            Some(LawCohesion::Bond { normal, tangential, .. }) => {
                if bonded {
                    tangential / normal * (normal_force + normal * area)
                } else {
                    coulomb_limit
                }
            }
        }
    }

    /// State that a contact of this law keeps from step to step.
    pub fn memory(&self) -> Vec<ContactMemory> {
        let two_coefficients = law_parameters(self.label()).any(|parameter| parameter == LawParameter::DynamicFriction);
        let cohesion = match self.cohesion() {
            None | Some(LawCohesion::Liquid { remembers: false, .. } | LawCohesion::Pair(_)) => None,
            Some(LawCohesion::Liquid { remembers: true, .. }) => Some(ContactMemory::LiquidBridge),
            Some(LawCohesion::Bond { .. }) => Some(ContactMemory::Bond),
        };
        let chooses = two_coefficients && self.friction_speed().is_none();
        let sliding = chooses.then_some(ContactMemory::Sliding);
        let moment = self.has_moments().then_some(ContactMemory::Moment);
        [sliding, cohesion, moment, self.named_memory()].into_iter().flatten().collect()
    }

    /// Radius of a bond that carries moments over the smaller radius of its two bodies, if the law has such bonds.
    pub fn bond_radius(&self) -> Option<f64> {
        match self.cohesion() {
            Some(LawCohesion::Bond { radius, .. }) => radius,
            None | Some(LawCohesion::Liquid { .. } | LawCohesion::Pair(_)) => None,
        }
    }

    /// Stiffnesses of the bonds of the law, if it has elastic bonds.
    pub fn bond_stiffness(&self) -> Option<BondStiffness> {
        match self.cohesion() {
            Some(LawCohesion::Bond { stiffness, .. }) => stiffness,
            None | Some(LawCohesion::Liquid { .. } | LawCohesion::Pair(_)) => None,
        }
    }

    /// Opening at which pure traction breaks an elastic bond, c_n/k_n, m; 0 of other laws.
    pub fn breaking_opening(&self) -> f64 {
        match self.cohesion() {
            Some(LawCohesion::Bond { normal, stiffness: Some(stiffness), .. }) => normal / stiffness.normal,
            None | Some(LawCohesion::Liquid { .. } | LawCohesion::Pair(_) | LawCohesion::Bond { .. }) => 0.0,
        }
    }

    /// Whether contacts may carry moments.
    pub fn has_moments(&self) -> bool {
        self.rolling().is_some() || self.bond_radius().is_some()
    }

    /// Area on which the stresses of a bond act between two bodies of these curvatures (1/m), one of which is a sphere, m²:
    /// π R² with 1/R = 1/R_a + 1/R_b, or, of a bond that carries moments, with its radius.
    pub fn bond_area(&self, [a, b]: [f64; 2]) -> f64 {
        std::f64::consts::PI / self.bond_radius().map_or(a + b, |share| a.max(b) / share).powi(2)
    }

    /// Largest gap at which the two bodies attract each other, m; 0 for laws without attraction.
    pub fn attraction_range(&self) -> f64 {
        match self.cohesion() {
            Some(LawCohesion::Liquid { range, .. } | LawCohesion::Pair(PairCohesion { range, .. })) => range,
            None | Some(LawCohesion::Bond { .. }) => 0.0,
        }
    }

    /// Attraction at each point of contact, N, whatever the area of contact; 0 for other laws.
    pub fn point_attraction(&self) -> f64 {
        match self.cohesion() {
            Some(LawCohesion::Liquid { force, .. }) => force,
            None | Some(LawCohesion::Pair(_) | LawCohesion::Bond { .. }) => 0.0,
        }
    }

    /// Attraction per pair of bodies, if the law has one.
    pub fn pair_cohesion(&self) -> Option<PairCohesion> {
        if let Some(LawCohesion::Pair(pair)) = self.cohesion() { Some(pair) } else { None }
    }

    /// Law with another cohesive stress (Pa) or Hamaker constant (J), its first parameter, if it has cohesion per pair.
    pub fn with_pair_value(&self, value: f64) -> Option<LawModel> {
        self.pair_cohesion()?;
        let values: Vec<f64> = [value].into_iter().chain(self.values().into_iter().skip(1)).collect();
        LawModel::from_values(self.label(), &values).ok()
    }

    /// Whether an event can change the cohesion: bonds need a cohesion that is not 0.
    pub fn has_settable_cohesion(&self) -> bool {
        match self.cohesion() {
            None => false,
            Some(LawCohesion::Liquid { .. } | LawCohesion::Pair(_)) => true,
            Some(LawCohesion::Bond { normal, .. }) => normal > 0.0,
        }
    }

    /// Parameters that are out of their limits, or contradict each other.
    pub fn parameter_faults(&self) -> Vec<ParameterFault> {
        let values = self.parameter_values().into_iter();
        let outside = values.filter(|(parameter, value)| !parameter.accepts(*value)).map(|(parameter, value)| {
            ParameterFault { parameter, found: number_text(value), expected: parameter.expected() }
        });
        outside.chain(self.relation_faults()).collect()
    }

    /// Parameters that contradict each other.
    pub fn relation_faults(&self) -> Vec<ParameterFault> {
        let mut faults = Vec::new();
        let FrictionPair { static_friction, dynamic_friction } = self.friction();
        if dynamic_friction > static_friction {
            faults.push(ParameterFault {
                parameter: LawParameter::DynamicFriction,
                found: format!(
                    "{} is larger than static_friction {}",
                    number_text(dynamic_friction),
                    number_text(static_friction)
                ),
                expected: "dynamic_friction <= static_friction".into(),
            });
        }
        match self.cohesion() {
            // Shear without traction has no friction cone.
            Some(LawCohesion::Bond { normal: 0.0, tangential, .. }) if tangential > 0.0 => {
                faults.push(ParameterFault {
                    parameter: LawParameter::TangentialCohesion,
                    found: format!("{} without normal_cohesion", number_text(tangential)),
                    expected: "both, or none".into(),
                })
            }
            // A bond that slides without resistance cannot hold a moment.
            Some(LawCohesion::Bond { normal, tangential: 0.0, radius: Some(_), .. }) if normal > 0.0 => {
                faults.push(ParameterFault {
                    parameter: LawParameter::TangentialCohesion,
                    found: format!("0 with normal_cohesion {}", number_text(normal)),
                    expected: "both, or none, for bonds that carry moments".into(),
                });
            }
            Some(LawCohesion::Pair(PairCohesion { full_range, range, .. })) if full_range > range => {
                faults.push(ParameterFault {
                    parameter: LawParameter::FullRange,
                    found: format!("{} is larger than range {}", number_text(full_range), number_text(range)),
                    expected: "full_range <= range".into(),
                });
            }
            None | Some(LawCohesion::Liquid { .. } | LawCohesion::Pair(_) | LawCohesion::Bond { .. }) => {}
        }
        let contradictions = self.interface().map(|interface| interface.contradictions()).unwrap_or_default();
        faults.extend(contradictions.into_iter().map(ParameterFault::from));
        faults
    }
}

#[cfg(test)]
mod tests;
