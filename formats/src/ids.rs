//! Indices with types, so that indices into different lists are not confused.

/// Defines index types: a number from 0, of the width of the integer in parentheses.
///
/// ```
/// cd_formats::index_types! {
///     /// Index of a grain.
///     GrainId(u32);
/// }
/// assert_eq!(GrainId::new(3).index(), 3);
/// ```
#[macro_export]
macro_rules! index_types {
    ($($(#[doc = $help:literal])+ $name:ident($number:ty);)+) => {
        $(
            $(#[doc = $help])+
            #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
            #[repr(transparent)]
            pub struct $name(pub $number);

            impl $name {
                /// Index number `index`; panics beyond the range of the integer.
                pub fn new(index: usize) -> Self {
                    $name(<$number>::try_from(index).expect("an index fits into its type"))
                }

                /// Position in a list.
                #[inline(always)]
                pub fn index(self) -> usize {
                    self.0 as usize
                }

                /// Number counted from 1, for messages.
                pub fn number(self) -> usize {
                    self.index() + 1
                }
            }
        )+
    };
}

index_types! {
    /// Index of a body: its row in BODIES.DAT and in the body arrays of a snapshot.
    BodyId(u32);
}
