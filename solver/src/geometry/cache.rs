//! Features of a pair that are kept from one step to the next.

use super::pair::{PolyhedronPair, SearchAxis, SearchFeature};
use super::search::SearchStart;
use crate::math::Vec3;

/// Cached feature of a pair, kept from one step to the next.
///
/// In [`Accurate`](super::NarrowPhaseMode::Accurate) it saves time, and decides between directions that are equal to 1e-11 of the size. In
/// [`Fast`](super::NarrowPhaseMode::Fast) the search starts from it and usually ends there. A bitwise identical resume needs it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CachedFeature {
    kind: u32,
    data: [u32; 3],
}

impl CachedFeature {
    /// Feature of the axis that a search has found.
    pub(super) fn from_axis(axis: &SearchAxis) -> Self {
        let (kind, data) = match axis.feature {
            SearchFeature::FaceOfA(f) => (1, [f, 0, 0]),
            SearchFeature::FaceOfB(f) => (2, [f, 0, 0]),
            SearchFeature::Edges(ea, eb) => (3, [ea, eb, 0]),
            SearchFeature::None => (4, [axis.n.x, axis.n.y, axis.n.z].map(|x| (x as f32).to_bits())),
        };
        CachedFeature { kind, data }
    }

    /// Start of the search of the pair in the next step.
    pub(super) fn search_start(&self, pair: &PolyhedronPair) -> SearchStart {
        let (a, b) = (pair.shape_a, pair.shape_b);
        let [first, second, _] = self.data.map(|k| k as usize);
        match self.kind {
            1 if first < a.face_planes().len() => SearchStart::Feature(SearchFeature::FaceOfA(self.data[0])),
            2 if first < b.face_planes().len() => SearchStart::Feature(SearchFeature::FaceOfB(self.data[0])),
            3 if first < a.edges().len() && second < b.edges().len() => {
                SearchStart::Feature(SearchFeature::Edges(self.data[0], self.data[1]))
            }
            4 => SearchStart::Direction(Vec3::from(self.data.map(|bits| f64::from(f32::from_bits(bits))))),
            _ => SearchStart::Nothing,
        }
    }

    /// Converts to the words of a snapshot.
    pub fn to_words(&self) -> [u64; 2] {
        let [a, b, c] = self.data.map(u64::from);
        [u64::from(self.kind) << 32 | a, b << 32 | c]
    }

    /// Converts from the words of a snapshot; any words are safe.
    pub fn from_words([first, second]: [u64; 2]) -> Self {
        CachedFeature { kind: (first >> 32) as u32, data: [first as u32, (second >> 32) as u32, second as u32] }
    }
}
