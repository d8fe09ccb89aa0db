//! The sphere: its volume, and points spread evenly on it.

/// Points evenly spread on the sphere of radius 1: a spiral from pole to pole, turned by the golden angle
/// (A. Gonzalez, Math. Geosci. 42, 2010).
pub fn sphere_spiral(count: usize) -> Vec<[f64; 3]> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let point = |k: usize| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
        let (sin, cos) = libm::sincos(golden_angle * k as f64);
        let distance_from_axis = (1.0 - z * z).sqrt();
        [distance_from_axis * cos, distance_from_axis * sin, z]
    };
    (0..count).map(point).collect()
}

/// Volume, m^3, of a sphere of `radius`, m.
pub fn sphere_volume(radius: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * radius * radius * radius
}
