//! Damage of elastic interfaces of contacts, for the laws of cohesive zones (`_CZM`): the soundness β falls from 1 to 0 as an
//! interface opens and slides, and never rises.
//!
//! With δ² = max(0, u_n)² + u_T² and the mode m = u_T²/max(0, u_n)², all lengths and energies are mixed between those of pure
//! opening and of pure sliding. The stress is f k u with f = β, of the viscous law β².
//!
//! Sources: Y. Monerie, V. Acary, C. R. Acad. Sci. Paris 329 (2001) 839 (viscous adhesion); V. Tvergaard, J.W. Hutchinson,
//! J. Mech. Phys. Solids 40 (1992) 1377 (trapezoid); F. Perales et al., Int. J. Eng. Sci. 46 (2008) 60 (cohesive zones in
//! contact dynamics).

use cd_formats::law_table::{DamageLaw, LawInterface, ModePair};

/// Soundness below which an interface is broken.
const BROKEN: f64 = 1e-12;

/// Length in the mode `m` on the ellipse through the lengths in pure opening and in pure sliding.
fn mixed_length(lengths: ModePair, m: f64) -> f64 {
    let ModePair { opening, sliding } = lengths;
    opening * sliding * ((1.0 + m) / (sliding * sliding + m * opening * opening)).sqrt()
}

/// Soundness of an interface at the end of a step of `h` (s), from the `earlier` one at its start, with the opening `u_n` and
/// the sliding `u_t` (m) at its end.
///
/// ```
/// # use cd_solve::laws::interface::soundness;
/// # use cd_formats::law_table::{DamageLaw, LawInterface, ModePair};
/// let equal_pair = |x| ModePair { opening: x, sliding: x };
/// let damage = DamageLaw::Trapezoidal { strength: equal_pair(1.0), energy: equal_pair(2.5), plateau: equal_pair(2.0) };
/// let interface = LawInterface { normal_stiffness: 1.0, tangential_stiffness: 1.0, damage };
/// // 1 Pa from 1 m to 2 m, then down to 0 at 4 m: at 3 m 1/2 Pa of the 3 Pa that the sound interface would have.
/// assert_eq!(soundness(&interface, 1.0, 3.0, 0.0, 1.0), 0.5 / 3.0);
/// assert_eq!(soundness(&interface, 0.25, 1.5, 0.0, 1.0), 0.25);
/// ```
pub fn soundness(interface: &LawInterface, earlier: f64, u_n: f64, u_t: f64, h: f64) -> f64 {
    let LawInterface { normal_stiffness: k_n, tangential_stiffness: k_t, damage } = *interface;
    let (opening_squared, sliding_squared) = (u_n.max(0.0).powi(2), u_t * u_t);
    let length = (opening_squared + sliding_squared).sqrt();
    // The bound stands for pure sliding: terms of the opening are below the rounding of the others.
    let m = if opening_squared > f64::MIN_POSITIVE { (sliding_squared / opening_squared).min(1e20) } else { 1e20 };
    let elastic_lengths =
        |strength: ModePair| ModePair { opening: strength.opening / k_n, sliding: strength.sliding / k_t };
    let damaged = match damage {
        DamageLaw::Viscous { energy, viscosity } => {
            let driving_force = k_t * sliding_squared + k_n * opening_squared;
            let decays = energy <= earlier * driving_force && viscosity + h * driving_force > 0.0;
            if decays { (h * energy + earlier * viscosity) / (viscosity + h * driving_force) } else { earlier }
        }
        DamageLaw::Parabolic { strength, energy } => {
            let elastic = mixed_length(elastic_lengths(strength), m);
            // k/G of opening and of sliding, weighted by the mode, times both energies G.
            let weighted_stiffness = (energy.sliding * k_n + energy.opening * k_t * m) / (1.0 + m);
            let softening = 1.5 * (energy.opening * energy.sliding - 0.5 * elastic * elastic * weighted_stiffness)
                / (elastic * weighted_stiffness);
            match length {
                _ if length < elastic => 1.0,
                _ if length < elastic + softening => {
                    elastic / length * (1.0 - ((length - elastic) / softening).powi(2))
                }
                _ => 0.0,
            }
        }
        DamageLaw::Exponential { strength, energy, rest } => {
            let ModePair { opening, sliding } = elastic_lengths(strength);
            let elastic = mixed_length(ModePair { opening, sliding }, m);
            let (o2, s2) = (opening * opening, sliding * sliding);
            let mixed_energy = (s2 * energy.opening + m * o2 * energy.sliding) / (s2 + m * o2);
            let stiffness = ((k_n * k_n + k_t * k_t * m) / (1.0 + m)).sqrt();
            let decay_rate = stiffness * elastic / (mixed_energy - 0.5 * stiffness * elastic * elastic);
            match length {
                _ if length > elastic - libm::log(rest) / decay_rate => 0.0,
                _ if length > elastic => elastic / length * libm::exp(decay_rate * (elastic - length)),
                _ => 1.0,
            }
        }
        DamageLaw::Trapezoidal { strength, energy, plateau } => {
            let elastic = mixed_length(elastic_lengths(strength), m);
            let plateau = mixed_length(plateau, m);
            // k/G of opening and of sliding, weighted by the mode, times both energies G.
            let weighted_stiffness = k_n * energy.sliding + m * k_t * energy.opening;
            let twice_energies = 2.0 * energy.opening * energy.sliding * (1.0 + m);
            let end =
                (twice_energies - elastic * (plateau - elastic) * weighted_stiffness) / (elastic * weighted_stiffness);
            match length {
                _ if length > end => 0.0,
                _ if length > plateau => elastic / length * ((end - length) / (end - plateau)),
                _ if length > elastic => elastic / length,
                _ => 1.0,
            }
        }
    };
    let damaged = damaged.min(earlier);
    if damaged < BROKEN { 0.0 } else { damaged }
}

/// Share f of the stiffness that an interface of this soundness has.
pub fn stiffness_share(interface: &LawInterface, soundness: f64) -> f64 {
    match interface.damage {
        DamageLaw::Viscous { .. } => soundness * soundness,
        DamageLaw::Parabolic { .. } | DamageLaw::Exponential { .. } | DamageLaw::Trapezoidal { .. } => soundness,
    }
}
