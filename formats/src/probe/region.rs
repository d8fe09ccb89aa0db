//! Columns of the probe of means over a region.

/// Means over a region in one step, or over the steps of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegionMeans {
    /// Number of grains with their centre inside.
    pub grains: f64,
    /// Solid fraction.
    pub nu: f64,
    /// Mass over volume, kg/m³.
    pub density: f64,
    /// Mean diameter of the grains, m.
    pub diameter: f64,
    /// Velocity of the centre of mass, m/s.
    pub velocity: [f64; 3],
    /// Granular temperature, m²/s².
    pub temperature: f64,
    /// Stress of the contacts, Pa, symmetric part: xx, yy, zz, xy, xz, yz; positive in compression.
    pub stress: [f64; 6],
    /// Stress of the motion about the mean field, Pa, in the same order.
    pub kinetic: [f64; 6],
    /// Gradient of the velocity, 1/s: row the component of the velocity, column the axis of the position.
    pub gradient: [[f64; 3]; 3],
}

/// Columns of a region; those from `pressure` on follow from the others.
pub(super) const REGION_COLUMNS: [&str; 34] = [
    "grains",
    "nu",
    "density",
    "diameter",
    "v_x",
    "v_y",
    "v_z",
    "temperature",
    "sigma_xx",
    "sigma_yy",
    "sigma_zz",
    "sigma_xy",
    "sigma_xz",
    "sigma_yz",
    "kinetic_xx",
    "kinetic_yy",
    "kinetic_zz",
    "kinetic_xy",
    "kinetic_xz",
    "kinetic_yz",
    "gradient_xx",
    "gradient_xy",
    "gradient_xz",
    "gradient_yx",
    "gradient_yy",
    "gradient_yz",
    "gradient_zx",
    "gradient_zy",
    "gradient_zz",
    "pressure",
    "pressure_kinetic",
    "shear_rate",
    "mu",
    "inertial_number",
];

/// Number of columns that are measured, from the first.
const MEASURED: usize = 29;

impl RegionMeans {
    /// Values of all columns.
    pub fn columns(&self) -> Vec<f64> {
        let RegionMeans { grains, nu, density, diameter, velocity, temperature, stress, kinetic, gradient } = self;
        let mut values = vec![*grains, *nu, *density, *diameter];
        values.extend(velocity);
        values.push(*temperature);
        values.extend(stress.iter().chain(kinetic).chain(gradient.iter().flatten()));
        values.extend(self.derived_columns());
        values
    }

    /// Computes those of the values of all columns that follow from the others, which may be means over several steps.
    pub fn complete_columns(values: &mut [f64]) {
        if let Some(means) = RegionMeans::from_columns(values) {
            values[MEASURED..].copy_from_slice(&means.derived_columns());
        }
    }

    /// Means with these values of the columns.
    fn from_columns(values: &[f64]) -> Option<RegionMeans> {
        let [grains, nu, density, diameter, v_x, v_y, v_z, temperature] = *values.first_chunk()?;
        let gradient: &[f64; 9] = values.get(20..)?.first_chunk()?;
        Some(RegionMeans {
            grains,
            nu,
            density,
            diameter,
            velocity: [v_x, v_y, v_z],
            temperature,
            stress: *values.get(8..)?.first_chunk()?,
            kinetic: *values.get(14..)?.first_chunk()?,
            gradient: [0, 3, 6].map(|k| [gradient[k], gradient[k + 1], gradient[k + 2]]),
        })
    }

    /// Values of the columns that follow from the others: pressures p_c and p_k of the contacts and of the motion, shear rate
    /// γ̇ = √(2 d:d), d being the deviator of the strain rate, μ = √(s:s/2) / p, s being the deviator of the sum of both
    /// stresses and p = p_c + p_k, and the inertial number I = γ̇ D √(ρ/p), D and ρ being diameter and density of the grains.
    ///
    /// For v_x = γ̇ z the shear rate is |γ̇|; with the stress xz alone √(s:s/2) is |σ_xz|. μ and I are not a number unless p is
    /// positive. Source: GDR MiDi, Eur. Phys. J. E 14 (2004) 341-365; Jop, Forterre & Pouliquen, Nature 441 (2006) 727-730.
    fn derived_columns(&self) -> [f64; REGION_COLUMNS.len() - MEASURED] {
        let pressure = |stress: &[f64; 6]| (stress[0] + stress[1] + stress[2]) / 3.0;
        let (of_contacts, of_motion) = (pressure(&self.stress), pressure(&self.kinetic));
        let g = &self.gradient;
        let rate_of_strain = [
            g[0][0],
            g[1][1],
            g[2][2],
            0.5 * (g[0][1] + g[1][0]),
            0.5 * (g[0][2] + g[2][0]),
            0.5 * (g[1][2] + g[2][1]),
        ];
        let shear_rate = 2.0 * deviator_size(&rate_of_strain);
        let total: [f64; 6] = std::array::from_fn(|k| self.stress[k] + self.kinetic[k]);
        let p = of_contacts + of_motion;
        let (mu, inertial_number) = if p > 0.0 {
            (deviator_size(&total) / p, shear_rate * self.diameter * (self.density / (self.nu * p)).sqrt())
        } else {
            (f64::NAN, f64::NAN)
        };
        [of_contacts, of_motion, shear_rate, mu, inertial_number]
    }
}

/// √(s:s/2) of the deviator s of a symmetric tensor by its components xx, yy, zz, xy, xz, yz.
fn deviator_size(tensor: &[f64; 6]) -> f64 {
    let [xx, yy, zz, xy, xz, yz] = *tensor;
    let mean = (xx + yy + zz) / 3.0;
    let diagonal = [xx, yy, zz].iter().map(|x| (x - mean) * (x - mean)).sum::<f64>();
    (0.5 * diagonal + xy * xy + xz * xz + yz * yz).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derived_columns_have_their_closed_forms() {
        let means = RegionMeans {
            grains: 7.0,
            nu: 0.5,
            density: 1000.0,
            diameter: 0.25,
            velocity: [1.0, 2.0, 3.0],
            temperature: 0.125,
            // A pressure of 4 Pa, with a shear stress of 3 Pa less 1 Pa of the motion.
            stress: [3.0, 4.0, 5.0, 0.0, -3.0, 0.0],
            kinetic: [1.0, 0.0, -1.0, 0.0, 1.0, 0.0],
            // Shear by 8/s with an expansion and a rotation, which do not count.
            gradient: [[1.0, -2.0, 8.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        };
        let columns = means.columns();
        assert_eq!(columns.len(), REGION_COLUMNS.len());
        assert_eq!(REGION_COLUMNS[MEASURED], "pressure");
        // I = 8 · 0.25 √(2000/4).
        assert_eq!(columns[MEASURED..], [4.0, 0.0, 8.0, 0.5, 2.0 * 500f64.sqrt()]);
        let mut again = columns.clone();
        again[MEASURED..].fill(f64::NAN);
        RegionMeans::complete_columns(&mut again);
        assert_eq!(again, columns);
        let of = |name: &str| columns[REGION_COLUMNS.iter().position(|column| *column == name).unwrap()];
        assert_eq!((of("v_z"), of("sigma_xz"), of("kinetic_xx"), of("gradient_xz")), (3.0, -3.0, 1.0, 8.0));
        assert!(RegionMeans { stress: [-3.0; 6], ..means }.columns()[MEASURED + 3..].iter().all(|x| x.is_nan()));
    }
}
