//! One number at a time: any machine.

use pulp::NullaryFnOnce;

use super::arithmetic::{
    Arithmetic, BodyHalfLine, BodyHalfLineF32, BodyLine, BodyLineF32, F32Arithmetic, F64Arithmetic, LaneFloat,
};

/// Defines lanes of one number.
macro_rules! scalar_lanes {
    ($(#[$doc:meta])* $name:ident, $number:ty, $line:ty, $half:ty) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy)]
        pub struct $name;

        impl Arithmetic for $name {
            type T = $number;
            const WIDTH: usize = 1;
            type V = $number;

            fn run<Op: NullaryFnOnce>(self, op: Op) -> Op::Output {
                op.call()
            }
            #[inline(always)]
            fn prefetch<X: ?Sized>(self, _: &X) {}

            #[inline(always)]
            fn splat(self, x: f64) -> $number {
                <$number>::from_f64(x)
            }
            #[inline(always)]
            fn load(self, x: &[$number]) -> $number {
                x[0]
            }
            #[inline(always)]
            fn store(self, x: &mut [$number], v: $number) {
                x[0] = v;
            }
            #[inline(always)]
            fn add(self, a: $number, b: $number) -> $number {
                a + b
            }
            #[inline(always)]
            fn sub(self, a: $number, b: $number) -> $number {
                a - b
            }
            #[inline(always)]
            fn mul(self, a: $number, b: $number) -> $number {
                a * b
            }
            #[inline(always)]
            fn div(self, a: $number, b: $number) -> $number {
                a / b
            }
            #[inline(always)]
            fn sqrt(self, a: $number) -> $number {
                a.sqrt()
            }
            #[inline(always)]
            fn mul_add(self, a: $number, b: $number, c: $number) -> $number {
                a.mul_add(b, c)
            }
            #[inline(always)]
            fn neg_mul_add(self, a: $number, b: $number, c: $number) -> $number {
                (-a).mul_add(b, c)
            }
            #[inline(always)]
            fn select_greater(self, x: $number, y: $number, a: $number, b: $number) -> $number {
                if x > y { a } else { b }
            }
            #[inline(always)]
            fn mask_greater(self, x: $number, y: $number) -> u32 {
                u32::from(x > y)
            }
            #[inline(always)]
            fn min(self, a: $number, b: $number) -> $number {
                if a < b { a } else { b }
            }
            #[inline(always)]
            fn gather_lines(self, lines: &[[$number; 8]], index: &[u32]) -> [$number; 8] {
                lines[index[0] as usize]
            }
            #[inline(always)]
            fn scatter_lines(self, lines: &mut [[$number; 8]], index: &[u32], columns: [$number; 8]) {
                lines[index[0] as usize] = columns;
            }
            #[inline(always)]
            fn relative_velocity(self, lines: &[$line], a: &[u32], b: &[u32]) -> [$number; 8] {
                let (a, b) = (&lines[a[0] as usize].0, &lines[b[0] as usize].0);
                [a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6], a[7] + b[7]]
            }
            #[inline(always)]
            fn apply_impulse(self, lines: &mut [$line], a: &[u32], b: &[u32], f: [$number; 3], g: [$number; 3]) {
                for (line, sign) in [(a[0], 1.0), (b[0], -1.0)] {
                    let line = &mut lines[line as usize].0;
                    for k in 0..3 {
                        line[k] = (sign * f[k]).mul_add(line[3], line[k]);
                        line[4 + k] = g[k].mul_add(line[7], line[4 + k]);
                    }
                }
            }
            #[inline(always)]
            fn relative_half_velocity(self, halves: &[$half], a: &[u32], b: &[u32]) -> [$number; 4] {
                let (a, b) = (&halves[a[0] as usize].0, &halves[b[0] as usize].0);
                [a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] + b[3]]
            }
            #[inline(always)]
            fn apply_half_impulse(self, halves: &mut [$half], a: &[u32], b: &[u32], f: [$number; 3]) {
                for (half, sign) in [(a[0], 1.0), (b[0], -1.0)] {
                    let half = &mut halves[half as usize].0;
                    for k in 0..3 {
                        half[k] = (sign * f[k]).mul_add(half[3], half[k]);
                    }
                }
            }
        }
    };
}

scalar_lanes!(
    /// One number in double precision.
    Scalar,
    f64,
    BodyLine,
    BodyHalfLine
);
scalar_lanes!(
    /// One number in single precision.
    ScalarF32,
    f32,
    BodyLineF32,
    BodyHalfLineF32
);

impl F64Arithmetic for Scalar {
    type Single = ScalarF32;

    #[inline(always)]
    fn single(self) -> ScalarF32 {
        ScalarF32
    }
    #[inline(always)]
    fn min_lane(self, a: f64) -> f64 {
        a
    }
}

impl F32Arithmetic for ScalarF32 {
    #[inline(always)]
    fn rsqrt_seed(self, magic: u32, a: f32) -> f32 {
        f32::from_bits(magic.wrapping_sub(a.to_bits() >> 1))
    }
}
