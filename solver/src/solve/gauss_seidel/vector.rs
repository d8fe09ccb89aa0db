//! Vectors of three components in lanes.

use crate::math::simd::Arithmetic;

/// Three components.
pub type LaneVector<V> = [V; 3];

/// Scalar product a . b.
#[inline(always)]
pub fn dot_product<L: Arithmetic>(l: L, a: LaneVector<L::V>, b: LaneVector<L::V>) -> L::V {
    l.mul_add(a[0], b[0], l.mul_add(a[1], b[1], l.mul(a[2], b[2])))
}

/// a x b + c.
#[inline(always)]
pub fn cross_add<L: Arithmetic>(
    l: L,
    a: LaneVector<L::V>,
    b: LaneVector<L::V>,
    c: LaneVector<L::V>,
) -> LaneVector<L::V> {
    [
        l.mul_add(a[1], b[2], l.neg_mul_add(a[2], b[1], c[0])),
        l.mul_add(a[2], b[0], l.neg_mul_add(a[0], b[2], c[1])),
        l.mul_add(a[0], b[1], l.neg_mul_add(a[1], b[0], c[2])),
    ]
}

/// Vector product a x b.
#[inline(always)]
pub fn cross_product<L: Arithmetic>(l: L, a: LaneVector<L::V>, b: LaneVector<L::V>) -> LaneVector<L::V> {
    [
        l.neg_mul_add(a[2], b[1], l.mul(a[1], b[2])),
        l.neg_mul_add(a[0], b[2], l.mul(a[2], b[0])),
        l.neg_mul_add(a[1], b[0], l.mul(a[0], b[1])),
    ]
}

/// The three components of an expression in `$k`. Not a closure, which a compiler may leave outside
/// the instruction set that its caller is compiled for.
macro_rules! triple {
    ($k:ident => $component:expr) => {
        [
            {
                let $k = 0;
                $component
            },
            {
                let $k = 1;
                $component
            },
            {
                let $k = 2;
                $component
            },
        ]
    };
}
pub(super) use triple;

/// Nearest point to `v` of the ball of radius `bound` >= 0.
#[inline(always)]
pub fn project_to_ball<L: Arithmetic>(l: L, v: LaneVector<L::V>, bound: L::V) -> LaneVector<L::V> {
    let size2 = dot_product(l, v, v);
    // bound/size, as a product of a root and a quotient, which are computed independently.
    let ratio = l.mul(l.div(bound, size2), l.sqrt(size2));
    let inside = l.select_greater(size2, l.mul(bound, bound), ratio, l.splat(1.0));
    triple!(k => l.mul(v[k], inside))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::simd::Scalar;

    #[test]
    fn products_of_vectors() {
        assert_eq!(cross_add(Scalar, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0; 3]), [0.0, 0.0, 1.0]);
        assert_eq!(cross_add(Scalar, [1.0, 2.0, 3.0], [-4.0, 5.0, 6.0], [1.0; 3]), [-2.0, -17.0, 14.0]);
        assert_eq!(cross_product(Scalar, [1.0, 2.0, 3.0], [-4.0, 5.0, 6.0]), [-3.0, -18.0, 13.0]);
    }
}
