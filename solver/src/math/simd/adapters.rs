//! Vectors made of two narrower ones.

use pulp::NullaryFnOnce;

use super::arithmetic::{Arithmetic, LaneFloat};

/// Two vectors at once: while one waits for a quotient or a root, the other is computed.
#[derive(Debug, Clone, Copy)]
pub struct DoubleWidth<L>(pub L);

impl<L: Arithmetic> Arithmetic for DoubleWidth<L> {
    type T = L::T;
    const WIDTH: usize = 2 * L::WIDTH;
    type V = [L::V; 2];

    fn run<Op: NullaryFnOnce>(self, op: Op) -> Op::Output {
        self.0.run(op)
    }

    #[inline(always)]
    fn prefetch<X: ?Sized>(self, x: &X) {
        self.0.prefetch(x);
    }

    #[inline(always)]
    fn splat(self, x: f64) -> Self::V {
        [self.0.splat(x); 2]
    }
    #[inline(always)]
    fn load(self, x: &[L::T]) -> Self::V {
        [self.0.load(x), self.0.load(&x[L::WIDTH..])]
    }
    #[inline(always)]
    fn store(self, x: &mut [L::T], v: Self::V) {
        self.0.store(x, v[0]);
        self.0.store(&mut x[L::WIDTH..], v[1]);
    }
    #[inline(always)]
    fn add(self, a: Self::V, b: Self::V) -> Self::V {
        [self.0.add(a[0], b[0]), self.0.add(a[1], b[1])]
    }
    #[inline(always)]
    fn sub(self, a: Self::V, b: Self::V) -> Self::V {
        [self.0.sub(a[0], b[0]), self.0.sub(a[1], b[1])]
    }
    #[inline(always)]
    fn mul(self, a: Self::V, b: Self::V) -> Self::V {
        [self.0.mul(a[0], b[0]), self.0.mul(a[1], b[1])]
    }
    #[inline(always)]
    fn div(self, a: Self::V, b: Self::V) -> Self::V {
        [self.0.div(a[0], b[0]), self.0.div(a[1], b[1])]
    }
    #[inline(always)]
    fn sqrt(self, a: Self::V) -> Self::V {
        [self.0.sqrt(a[0]), self.0.sqrt(a[1])]
    }
    #[inline(always)]
    fn mul_add(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V {
        [self.0.mul_add(a[0], b[0], c[0]), self.0.mul_add(a[1], b[1], c[1])]
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V {
        [self.0.neg_mul_add(a[0], b[0], c[0]), self.0.neg_mul_add(a[1], b[1], c[1])]
    }
    #[inline(always)]
    fn select_greater(self, x: Self::V, y: Self::V, a: Self::V, b: Self::V) -> Self::V {
        [self.0.select_greater(x[0], y[0], a[0], b[0]), self.0.select_greater(x[1], y[1], a[1], b[1])]
    }
    #[inline(always)]
    fn mask_greater(self, x: Self::V, y: Self::V) -> u32 {
        self.0.mask_greater(x[0], y[0]) | self.0.mask_greater(x[1], y[1]) << L::WIDTH
    }
    #[inline(always)]
    fn min(self, a: Self::V, b: Self::V) -> Self::V {
        [self.0.min(a[0], b[0]), self.0.min(a[1], b[1])]
    }
    #[inline(always)]
    fn gather_lines(self, lines: &[[L::T; 8]], index: &[u32]) -> [Self::V; 8] {
        zip_halves(self.0.gather_lines(lines, index), self.0.gather_lines(lines, &index[L::WIDTH..]))
    }
    #[inline(always)]
    fn scatter_lines(self, lines: &mut [[L::T; 8]], index: &[u32], columns: [Self::V; 8]) {
        let [left, right] = unzip_halves(columns);
        self.0.scatter_lines(lines, index, left);
        self.0.scatter_lines(lines, &index[L::WIDTH..], right);
    }
    #[inline(always)]
    fn relative_velocity(self, lines: &[<L::T as LaneFloat>::Line], a: &[u32], b: &[u32]) -> [Self::V; 8] {
        let w = L::WIDTH;
        zip_halves(self.0.relative_velocity(lines, a, b), self.0.relative_velocity(lines, &a[w..], &b[w..]))
    }
    #[inline(always)]
    fn apply_impulse(
        self,
        lines: &mut [<L::T as LaneFloat>::Line],
        a: &[u32],
        b: &[u32],
        f: [Self::V; 3],
        g: [Self::V; 3],
    ) {
        let (w, [f0, f1], [g0, g1]) = (L::WIDTH, unzip_halves(f), unzip_halves(g));
        self.0.apply_impulse(lines, a, b, f0, g0);
        self.0.apply_impulse(lines, &a[w..], &b[w..], f1, g1);
    }
    #[inline(always)]
    fn relative_half_velocity(self, halves: &[<L::T as LaneFloat>::Half], a: &[u32], b: &[u32]) -> [Self::V; 4] {
        let w = L::WIDTH;
        zip_halves(self.0.relative_half_velocity(halves, a, b), self.0.relative_half_velocity(halves, &a[w..], &b[w..]))
    }
    #[inline(always)]
    fn apply_half_impulse(self, halves: &mut [<L::T as LaneFloat>::Half], a: &[u32], b: &[u32], f: [Self::V; 3]) {
        let (w, [f0, f1]) = (L::WIDTH, unzip_halves(f));
        self.0.apply_half_impulse(halves, a, b, f0);
        self.0.apply_half_impulse(halves, &a[w..], &b[w..], f1);
    }
}

/// Joins vectors of the left and of the right half.
#[inline(always)]
fn zip_halves<V: Copy, const N: usize>(left: [V; N], right: [V; N]) -> [[V; 2]; N] {
    let mut joined = [[left[0], right[0]]; N];
    let mut k = 1;
    while k < N {
        joined[k] = [left[k], right[k]];
        k += 1;
    }
    joined
}

/// Divides vectors into those of the left and of the right half.
#[inline(always)]
fn unzip_halves<V: Copy, const N: usize>(both: [[V; 2]; N]) -> [[V; N]; 2] {
    let mut sides = [[both[0][0]; N], [both[0][1]; N]];
    let mut k = 1;
    while k < N {
        (sides[0][k], sides[1][k]) = (both[k][0], both[k][1]);
        k += 1;
    }
    sides
}
