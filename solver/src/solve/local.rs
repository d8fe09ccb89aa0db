//! One contact, exactly, with every other impulse frozen.

use crate::assemble::Row;
use crate::math::Vec3;

/// r̂ that solves one contact with Signorini's condition and Coulomb's law, N s.
///
/// * `velocity`: û with the contact's present impulse at work, m/s.
/// * `r`: that impulse, N s.
///
/// With W = diag(w_n, w_t, w_t) the solution is closed: the impulse that would stop the contact,
/// r - û_n/w_n n - û_T/w_t, has its normal part cut at 0 (Signorini) and its tangential part
/// projected on the disc of radius mu r̂_n (Coulomb); sticking where it lies inside.
///
/// Source: F. Jourdan, P. Alart, M. Jean, Comput. Methods Appl. Mech. Engrg. 155 (1998) 31-47.
#[inline(always)]
pub fn signorini_coulomb(row: &Row, velocity: &Vec3, r: &Vec3) -> Vec3 {
    let n = &row.normal;
    let u_n = n.dot(velocity);
    let r_n = n.dot(r);
    let normal = r_n - u_n / row.w_n;
    if normal <= 0.0 {
        return Vec3::zeros();
    }
    if row.friction == 0.0 {
        return n * normal;
    }
    let tangential = (r - n * r_n) - (velocity - n * u_n) / row.w_t;
    let bound = row.friction * normal;
    let size2 = tangential.norm_squared();
    let inside = if size2 > bound * bound { bound / size2.sqrt() } else { 1.0 };
    n * normal + tangential * inside
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assemble::Record;

    fn row(friction: f64) -> (Row, [Record; 2]) {
        let free = Record { v: Vec3::zeros(), inverse_mass: 0.5, w: Vec3::zeros(), inverse_inertia: 1.25 };
        let fixed = Record { inverse_mass: 0.0, inverse_inertia: 0.0, ..free };
        let row = Row {
            bodies: [0, 1],
            normal: Vec3::z(),
            levers: [1.0, 0.0],
            shift: Vec3::zeros(),
            w_n: 0.5,
            w_t: 0.5 + 1.25,
            friction,
            impulse_shift: 0.0,
            contact: 0,
            can_close: true,
            start: Vec3::zeros(),
            u_before: Vec3::zeros(),
        };
        (row, [free, fixed])
    }

    /// The solution and the velocity that it leaves.
    fn solved(friction: f64, v: Vec3) -> (Vec3, Vec3) {
        let (row, mut records) = row(friction);
        records[0].v = v;
        let r = signorini_coulomb(&row, &row.velocity(&records), &Vec3::zeros());
        row.apply(&mut records, &r);
        (r, row.velocity(&records))
    }

    #[test]
    fn parting_sticking_and_sliding() {
        assert_eq!(solved(0.5, Vec3::z()).0, Vec3::zeros());
        // 2 kg arriving at 2 m/s is stopped by 4 N s; u_t = 0.35 needs 0.2 N s, within 0.5 * 4.
        let (r, u) = solved(0.5, Vec3::new(0.35, 0.0, -2.0));
        assert!((r - Vec3::new(-0.2, 0.0, 4.0)).norm() < 1e-15 && u.norm() < 1e-15);
        // u_t = 7 would need 4 N s: slides at 0.5 * 4, against the velocity.
        let (r, u) = solved(0.5, Vec3::new(0.0, 7.0, -2.0));
        assert!((r - Vec3::new(0.0, -2.0, 4.0)).norm() < 1e-15 && (u - Vec3::y() * 3.5).norm() < 1e-14);
        // Frictionless keeps the tangential velocity.
        let (r, u) = solved(0.0, Vec3::new(0.0, 7.0, -2.0));
        assert!(r == Vec3::z() * 4.0 && (u - Vec3::y() * 7.0).norm() < 1e-15);
    }

    #[test]
    fn is_a_fixed_point_of_itself() {
        let (row, mut records) = row(0.3);
        records[0].v = Vec3::new(1.0, -2.0, -0.7);
        records[0].w = Vec3::new(0.2, 0.1, 5.0);
        let r = signorini_coulomb(&row, &row.velocity(&records), &Vec3::zeros());
        row.apply(&mut records, &r);
        let again = signorini_coulomb(&row, &row.velocity(&records), &r);
        assert!((again - r).norm() < 1e-15 * r.norm());
    }
}
