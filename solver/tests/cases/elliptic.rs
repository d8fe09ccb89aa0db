//! The exact torque-free rotation of a rigid body by Jacobi's elliptic functions: the oracle of the integrator.
//!
//! Sources: L.D. Landau, E.M. Lifshitz, Mechanics, section 37; R. van Zon, J. Schofield, J. Comput. Phys. 225 (2007)
//! 145-164; functions by M. Abramowitz, I. Stegun (1964) 16.4 and B.C. Carlson, Numer. Math. 33 (1979) 1-16.

/// sn, cn, dn of `u` for the complementary modulus `k1` = sqrt(1 - k²) > 0, by descending Landen transformations.
pub fn jacobi(u: f64, k1: f64) -> [f64; 3] {
    let (mut a, mut b) = (1.0, k1);
    let mut means = Vec::new();
    while f64::abs(a - b) > 1e-16 * a && means.len() < 40 {
        let (mean, difference) = (0.5 * (a + b), 0.5 * (a - b));
        b = (a * b).sqrt();
        a = mean;
        means.push(difference / mean);
    }
    let mut phi = 2f64.powi(means.len() as i32) * a * u;
    for ratio in means.iter().rev() {
        phi = 0.5 * (phi + (ratio * phi.sin()).asin());
    }
    let (sn, cn) = phi.sin_cos();
    let dn = (k1 * k1 + (1.0 - k1 * k1) * cn * cn).sqrt();
    [sn, cn, dn]
}

/// The incomplete integral of the first kind F(phi), |phi| <= pi, for the complementary modulus `k1`.
pub fn first_kind(phi: f64, k1: f64) -> f64 {
    let quarter = |phi: f64| {
        let (s, c) = phi.sin_cos();
        s * carlson_rf(c * c, c * c + k1 * k1 * s * s, 1.0)
    };
    let half_pi = std::f64::consts::FRAC_PI_2;
    if phi.abs() <= half_pi {
        quarter(phi)
    } else {
        let complete = carlson_rf(0.0, k1 * k1, 1.0);
        phi.signum() * (2.0 * complete - quarter(std::f64::consts::PI - phi.abs()))
    }
}

fn carlson_rf(mut x: f64, mut y: f64, mut z: f64) -> f64 {
    for _ in 0..60 {
        let step = (x * y).sqrt() + (y * z).sqrt() + (z * x).sqrt();
        (x, y, z) = (0.25 * (x + step), 0.25 * (y + step), 0.25 * (z + step));
        if (x - y).abs().max((y - z).abs()) < 1e-15 * x {
            break;
        }
    }
    3f64.sqrt() / (x + y + z).sqrt()
}

/// Angular velocity (body frame, rad/s) as a function of time, of a body of the principal moments J1 < J2 < J3.
pub struct FreeRotation {
    amplitudes: [f64; 3],
    rate: f64,
    start: f64,
    k1: f64,
    /// Whether it circles about the first axis, so that the first and third change places.
    about_first: bool,
}

impl FreeRotation {
    /// From the angular velocity `w` at t = 0.
    pub fn new(inertia: [f64; 3], w: [f64; 3]) -> Self {
        let [j1, j2, j3] = inertia;
        assert!(j1 < j2 && j2 < j3);
        // M² - 2E J_k without cancellation of the large parts.
        let excess = |k: usize| (0..3).map(|i| inertia[i] * (inertia[i] - inertia[k]) * w[i] * w[i]).sum::<f64>();
        let about_first = excess(1) < 0.0;
        let [j1, j3, e1, e3] =
            if about_first { [j3, j1, excess(2), excess(0)] } else { [j1, j3, excess(0), excess(2)] };
        let [w1, w2, w3] = if about_first { [w[2], w[1], w[0]] } else { w };
        let size = |e: f64, j: f64, other: f64| (e / (j * other)).abs().sqrt();
        let (a, b, c) = (size(e3, j1, j3 - j1), size(e3, j2, j3 - j2), size(e1, j3, j3 - j1));
        // Signs: J1 w1' = (J2 - J3) w2 w3, and with the axes changed J1 w1' = (J3 - J2) w2 w3; both are ~ -sn dn.
        let s3 = 1f64.copysign(w3);
        let s2 = s3;
        let rate = ((j3 - j2) * e1 / (j1 * j2 * j3)).abs().sqrt();
        let k1 = ((j3 - j1) * excess(1) / ((j3 - j2) * e1)).abs().sqrt();
        let start = if b > 0.0 { first_kind((w2 * s2 / b).atan2(w1 / a), k1) } else { 0.0 };
        FreeRotation { amplitudes: [a, s2 * b, s3 * c], rate, start, k1, about_first }
    }

    pub fn at(&self, t: f64) -> [f64; 3] {
        let [sn, cn, dn] = jacobi(self.start + self.rate * t, self.k1);
        let [a, b, c] = self.amplitudes;
        if self.about_first { [c * dn, b * sn, a * cn] } else { [a * cn, b * sn, c * dn] }
    }
}
