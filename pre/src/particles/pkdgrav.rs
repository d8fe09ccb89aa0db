//! Binary `ss` files of pkdgrav: big-endian numbers (XDR) in units of which the constant of gravitation is 1.
//!
//! A header of 16 bytes, time (f64), number of particles (i32) and a mark (i32), is followed by 96 bytes for each
//! particle: mass, radius, position, velocity and spin (f64), colour and original index (i32); as read by `ssio.c` of the
//! ss_core tools of D. C. Richardson.

use std::path::Path;

use cd_formats::error::{Fault, Faults};
use nalgebra::Vector3;

use super::state::ParticleState;

/// Astronomical unit, m (IAU 2012), the unit of length.
const LENGTH_UNIT: f64 = 1.495978707e11;

/// Mass of the sun, kg, the unit of mass, as in `ss.h` of ss_core.
const MASS_UNIT: f64 = 1.9884e30;

/// Sidereal year, s, as in `ss.h` of ss_core; the unit of time is the year divided by 2 pi.
const YEAR: f64 = 3.15581497635e7;

const TIME_UNIT: f64 = YEAR / std::f64::consts::TAU;

/// Bytes of the header and of a particle.
const HEADER_LENGTH: usize = 16;
const PARTICLE_LENGTH: usize = 96;

/// Mark of files with fewer data per particle, which have no velocities.
const REDUCED_MARK: i32 = -10101;

/// Reads a file.
pub fn read(path: &Path, bytes: &[u8], faults: &mut Faults) -> ParticleState {
    let mut fault = |object: &str, found: String, expected: &str| {
        faults.push(Fault::new(path, None, object, found, expected));
        ParticleState::default()
    };
    let (Some(time), Some(count), Some(mark)) = (real(bytes, 0), integer(bytes, 8), integer(bytes, 12)) else {
        return fault("header", format!("{} bytes", bytes.len()), "expected an ss file of pkdgrav");
    };
    if mark == REDUCED_MARK {
        return fault("header", "a reduced ss file".into(), "expected an ss file with velocities");
    }
    let expected_length =
        usize::try_from(count).ok().and_then(|n| n.checked_mul(PARTICLE_LENGTH)?.checked_add(HEADER_LENGTH));
    if expected_length != Some(bytes.len()) || !time.is_finite() {
        let found = format!("{count} particles in {} bytes", bytes.len());
        return fault("header", found, "expected 16 bytes and 96 for each particle, big-endian");
    }
    let mut state = ParticleState { part: format!("time {:.6e} s", time * TIME_UNIT), ..Default::default() };
    let (mut masses, mut radii, mut velocities, mut spins) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let units = [MASS_UNIT, LENGTH_UNIT, LENGTH_UNIT, LENGTH_UNIT / TIME_UNIT, 1.0 / TIME_UNIT];
    for particle in bytes[HEADER_LENGTH..].chunks_exact(PARTICLE_LENGTH) {
        let number = |k: usize| real(particle, 8 * k).unwrap_or(f64::NAN);
        let vector = |k: usize, unit: f64| Vector3::new(number(k), number(k + 1), number(k + 2)) * unit;
        let values = (0..11).map(number);
        let (mass, radius) = (number(0) * units[0], number(1) * units[1]);
        if values.clone().any(|value| !value.is_finite()) || mass <= 0.0 || radius <= 0.0 {
            let object = format!("particle {}", masses.len() + 1);
            let found = format!("mass {mass:e} kg, radius {radius:e} m");
            faults.push(Fault::new(path, None, object, found, "expected finite numbers, mass and radius > 0"));
        }
        masses.push(mass);
        radii.push(radius);
        state.centres.push(vector(2, units[2]));
        velocities.push(vector(5, units[3]));
        spins.push(vector(8, units[4]));
    }
    ParticleState {
        radii: Some(radii),
        velocities: Some(velocities),
        spins: Some(spins),
        masses: Some(masses),
        ..state
    }
}

/// Number of 8 bytes at an offset; none past the end.
fn real(bytes: &[u8], offset: usize) -> Option<f64> {
    Some(f64::from_be_bytes(bytes.get(offset..offset + 8)?.try_into().ok()?))
}

/// Integer of 4 bytes at an offset; none past the end.
fn integer(bytes: &[u8], offset: usize) -> Option<i32> {
    Some(i32::from_be_bytes(bytes.get(offset..offset + 4)?.try_into().ok()?))
}
