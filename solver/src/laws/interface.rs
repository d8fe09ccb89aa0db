//! Damage of elastic interfaces between contacts: the soundness β falls from 1 to 0 as an interface opens and slides, and
//! never rises.
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

/// Square of the length of mixed mode `m` on the ellipse of two lengths, in pure opening and sliding.
fn mixed_length(lengths: ModePair, m: f64) -> f64 {
    let ModePair { opening, sliding } = lengths;
    opening * sliding * ((1.0 + m) / (sliding * sliding + m * opening * opening)).sqrt()
}

/// Soundness of an interface at the end of a step of `h` (s), from `before`, with the opening `u_n` and the sliding `u_t` (m)
/// at its end.
///
/// ```
/// # use cd_solve::laws::interface::soundness;
/// # use cd_formats::law_table::{DamageLaw, LawInterface, ModePair};
/// let same = |x| ModePair { opening: x, sliding: x };
/// let damage = DamageLaw::Trapezoidal { strength: same(1.0), energy: same(2.5), plateau: same(2.0) };
/// let interface = LawInterface { normal_stiffness: 1.0, tangential_stiffness: 1.0, damage };
/// // 1 Pa from 1 m to 2 m, then down to 0 at 4 m: at 3 m 1/2 Pa of the 3 Pa that the sound interface would have.
/// assert_eq!(soundness(&interface, 1.0, 3.0, 0.0, 1.0), 0.5 / 3.0);
/// assert_eq!(soundness(&interface, 0.25, 1.5, 0.0, 1.0), 0.25);
/// ```
pub fn soundness(interface: &LawInterface, before: f64, u_n: f64, u_t: f64, h: f64) -> f64 {
    let LawInterface { normal_stiffness: k_n, tangential_stiffness: k_t, damage } = *interface;
    let (opened2, slid2) = (u_n.max(0.0).powi(2), u_t * u_t);
    let length = (opened2 + slid2).sqrt();
    // Pure sliding: large enough that nothing of the opening remains.
    let m = if opened2 > f64::MIN_POSITIVE { (slid2 / opened2).min(1e20) } else { 1e20 };
    let elastic_lengths =
        |strength: ModePair| ModePair { opening: strength.opening / k_n, sliding: strength.sliding / k_t };
    let after = match damage {
        DamageLaw::Viscous { energy, viscosity } => {
            let drive = k_t * slid2 + k_n * opened2;
            let loses = energy <= before * drive && viscosity + h * drive > 0.0;
            if loses { (h * energy + before * viscosity) / (viscosity + h * drive) } else { before }
        }
        DamageLaw::Parabolic { strength, energy } => {
            let elastic = mixed_length(elastic_lengths(strength), m);
            let mixed = (energy.sliding * k_n + energy.opening * k_t * m) / (1.0 + m);
            let tail = 1.5 * (energy.opening * energy.sliding - 0.5 * elastic * elastic * mixed) / (elastic * mixed);
            match length {
                _ if length < elastic => 1.0,
                _ if length < elastic + tail => elastic / length * (1.0 - ((length - elastic) / tail).powi(2)),
                _ => 0.0,
            }
        }
        DamageLaw::Exponential { strength, energy, rest } => {
            let ModePair { opening, sliding } = elastic_lengths(strength);
            let elastic = mixed_length(ModePair { opening, sliding }, m);
            let (o2, s2) = (opening * opening, sliding * sliding);
            let whole = (s2 * energy.opening + m * o2 * energy.sliding) / (s2 + m * o2);
            let stiffness = ((k_n * k_n + k_t * k_t * m) / (1.0 + m)).sqrt();
            let fall = stiffness * elastic / (whole - 0.5 * stiffness * elastic * elastic);
            match length {
                _ if length > elastic - libm::log(rest) / fall => 0.0,
                _ if length > elastic => elastic / length * libm::exp(fall * (elastic - length)),
                _ => 1.0,
            }
        }
        DamageLaw::Trapezoidal { strength, energy, plateau } => {
            let elastic = mixed_length(elastic_lengths(strength), m);
            let plateau = mixed_length(plateau, m);
            let mixed = k_n * energy.sliding + m * k_t * energy.opening;
            let whole = 2.0 * energy.opening * energy.sliding * (1.0 + m);
            let end = (whole - elastic * (plateau - elastic) * mixed) / (elastic * mixed);
            match length {
                _ if length > end => 0.0,
                _ if length > plateau => elastic / length * ((end - length) / (end - plateau)),
                _ if length > elastic => elastic / length,
                _ => 1.0,
            }
        }
    };
    let after = after.min(before);
    if after < BROKEN { 0.0 } else { after }
}

/// Share f of the stiffness that an interface of this soundness has.
pub fn stiffness_share(interface: &LawInterface, soundness: f64) -> f64 {
    match interface.damage {
        DamageLaw::Viscous { .. } => soundness * soundness,
        _ => soundness,
    }
}
