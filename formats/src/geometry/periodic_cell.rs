//! Cell of a periodic scene: its periods and its shear.

use nalgebra::Vector3;

/// Cell of a periodic scene. Its edges are (L_x, 0, 0), (s_xy, L_y, 0) and (s_xz, s_yz, L_z) with the periods L and the
/// shears s; the scene repeats along each edge whose axis has a period.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PeriodicCell {
    /// Periods along x, y and z, m; None along an axis along which the scene does not repeat.
    pub periods: [Option<f64>; 3],
    /// Shears s_xy, s_xz and s_yz, m; 0 unless the cell deforms, which only cells with three periods do.
    pub shears: [f64; 3],
}

impl PeriodicCell {
    /// Returns the cell with right angles and these periods along x, y and z, m.
    pub fn with_periods(periods: [Option<f64>; 3]) -> PeriodicCell {
        PeriodicCell { periods, shears: [0.0; 3] }
    }

    /// Whether the scene repeats along any axis.
    pub fn is_periodic(&self) -> bool {
        self.periods != [None; 3]
    }

    /// Whether the scene repeats along all three axes.
    pub fn is_closed(&self) -> bool {
        self.periods.iter().all(Option::is_some)
    }

    /// Whether all angles between edges are right.
    pub fn is_rectangular(&self) -> bool {
        self.shears == [0.0; 3]
    }

    /// Edge along axis 0 to 2, m; 0 without a period.
    pub fn edge(&self, axis: usize) -> Vector3<f64> {
        let [xy, xz, yz] = self.shears;
        let length = self.periods[axis].unwrap_or(0.0);
        match axis {
            0 => Vector3::new(length, 0.0, 0.0),
            1 => Vector3::new(xy, length, 0.0),
            _ => Vector3::new(xz, yz, length),
        }
    }

    /// Sum of whole edges such that the components of the rest of `d` are at most half of the periods, m. In a cell with right
    /// angles it is the sum nearest to `d`; in a sheared one it is if the nearest is closer to `d` than half of the smallest
    /// period.
    #[inline]
    pub fn nearest_shift(&self, d: &Vector3<f64>) -> Vector3<f64> {
        // Pairs of every scene pass here.
        if self.periods.iter().all(Option::is_none) {
            return Vector3::zeros();
        }
        if self.is_rectangular() {
            let axis_shift = |period: Option<f64>, d: f64| period.map_or(0.0, |period| period * (d / period).round());
            let [x, y, z] = self.periods;
            return Vector3::new(axis_shift(x, d.x), axis_shift(y, d.y), axis_shift(z, d.z));
        }
        let mut shift = Vector3::<f64>::zeros();
        for axis in [2, 1, 0] {
            if let Some(period) = self.periods[axis] {
                shift += self.edge(axis) * ((d[axis] - shift[axis]) / period).round();
            }
        }
        shift
    }

    /// Sum of whole edges from the cell about the origin to the cell that contains `x`, m: the lattice coordinates of the rest
    /// are at most 1/2.
    pub fn cell_origin(&self, x: &Vector3<f64>) -> Vector3<f64> {
        if self.is_rectangular() {
            return self.nearest_shift(x);
        }
        let steps = self.lattice_coordinates(x).map(f64::round);
        self.edge(0) * steps.x + self.edge(1) * steps.y + self.edge(2) * steps.z
    }

    /// Lattice coordinates of a vector: numbers of edges, m along axes without a period.
    pub fn lattice_coordinates(&self, d: &Vector3<f64>) -> Vector3<f64> {
        let [xy, xz, yz] = self.shears;
        let [l_x, l_y, l_z] = self.periods.map(|period| period.unwrap_or(1.0));
        let z = d.z / l_z;
        let y = (d.y - yz * z) / l_y;
        Vector3::new((d.x - xy * y - xz * z) / l_x, y, z)
    }

    /// Distances between the faces of the cell, m; infinite along axes without a period.
    pub fn widths(&self) -> [f64; 3] {
        let [Some(l_x), Some(l_y), Some(l_z)] = self.periods else {
            return self.periods.map(|period| period.unwrap_or(f64::INFINITY));
        };
        let [xy, xz, yz] = self.shears;
        // Gradients of the lattice coordinates: rows of the inverse of the matrix of the edges.
        let along_x = Vector3::new(1.0, -xy / l_y, (xy * yz - xz * l_y) / (l_y * l_z));
        [l_x / along_x.norm(), l_y / (1.0 + (yz / l_z).powi(2)).sqrt(), l_z]
    }

    /// Images of a position in the cell that are in the cell or within `margin` (m) of it, the position first.
    pub fn images_near(&self, x: Vector3<f64>, margin: f64) -> Vec<Vector3<f64>> {
        if !self.is_periodic() {
            return vec![x];
        }
        let (coordinates, widths) = (self.lattice_coordinates(&x), self.widths());
        let steps = |axis: usize| {
            let mut steps = vec![0.0];
            if self.periods[axis].is_some() {
                let is_near = |step: &f64| (coordinates[axis] + step).abs() <= 0.5 + margin / widths[axis];
                steps.extend([-1.0, 1.0].into_iter().filter(is_near));
            }
            steps
        };
        let [along_x, along_y, along_z] = [steps(0), steps(1), steps(2)];
        let [a, b, c] = [0, 1, 2].map(|axis| self.edge(axis));
        let mut images = Vec::with_capacity(along_x.len() * along_y.len() * along_z.len());
        for i in &along_x {
            for j in &along_y {
                images.extend(along_z.iter().map(|k| x + a * *i + b * *j + c * *k));
            }
        }
        images
    }

    /// Volume, m^3; None unless the scene repeats along all three axes.
    pub fn volume(&self) -> Option<f64> {
        let [x, y, z] = self.periods;
        Some(x? * y? * z?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheared_cell() -> PeriodicCell {
        PeriodicCell { periods: [Some(4.0), Some(3.0), Some(5.0)], shears: [1.5, -1.75, 1.25] }
    }

    #[test]
    fn shifts_are_whole_edges() {
        let cell = sheared_cell();
        for k in 0..200 {
            let k = f64::from(k);
            let d = Vector3::new(17.0 * (1.3 * k).sin(), 13.0 * (2.1 * k).cos(), 11.0 * (0.7 * k).sin());
            let shift = cell.nearest_shift(&d);
            let steps = cell.lattice_coordinates(&shift);
            assert!((steps - steps.map(f64::round)).norm() < 1e-13, "{shift}"); // rounding of some edges
            assert!((d - shift).abs().component_div(&Vector3::new(4.0, 3.0, 5.0)).max() <= 0.5);
            let rest = cell.lattice_coordinates(&(d - cell.cell_origin(&d)));
            assert!(rest.abs().max() <= 0.5 + 1e-13);
            // A vector shorter than half of each period is the same image whatever edges are added.
            let short = Vector3::new(1.9 * (0.9 * k).sin(), 1.4 * (1.7 * k).cos(), 2.4 * (3.1 * k).sin());
            assert!((cell.nearest_shift(&(short + shift)) - shift).norm() < 1e-13);
        }
    }

    #[test]
    fn widths_are_those_of_the_faces() {
        let cell = sheared_cell();
        let volume = cell.volume().unwrap();
        assert_eq!(volume, 60.0);
        let area = |i: usize, j: usize| cell.edge(i).cross(&cell.edge(j)).norm();
        let expected = [volume / area(1, 2), volume / area(2, 0), volume / area(0, 1)];
        for (found, expected) in cell.widths().into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-14 * expected); // some roundings
        }
    }

    #[test]
    fn images_near_a_cell_are_those_within_the_margin() {
        let cell = PeriodicCell::with_periods([Some(10.0), None, Some(8.0)]);
        let images = cell.images_near(Vector3::new(4.5, 70.0, -3.5), 1.0);
        let expected = [[4.5, -3.5], [4.5, 4.5], [-5.5, -3.5], [-5.5, 4.5]].map(|[x, z]| Vector3::new(x, 70.0, z));
        assert_eq!(images, expected);
        assert_eq!(PeriodicCell::default().images_near(Vector3::x(), 1.0), [Vector3::x()]);
    }
}
