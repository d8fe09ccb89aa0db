//! File of a state: name and contents, which the modules of `state` make and `state::write` puts into the folder.

/// Name and contents of a file.
pub type StateFile = (&'static str, Vec<u8>);

/// Returns a file of text.
pub fn text_file(name: &'static str, text: String) -> StateFile {
    (name, text.into_bytes())
}
