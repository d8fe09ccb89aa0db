//! A file of a state.

/// Name and contents of a file.
pub type StateFile = (&'static str, Vec<u8>);

/// Returns a file of text.
pub fn text_file(name: &'static str, text: String) -> StateFile {
    (name, text.into_bytes())
}
