//! Pages of docs, of which examples write parts.

use std::error::Error;
use std::path::{Path, PathBuf};

/// The folder docs.
pub fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs")
}

/// Puts `text` into docs/explanation/accuracy.md between the marks of this name, in place of what stands there.
pub fn put(name: &str, text: &str) -> Result<(), Box<dyn Error>> {
    let [begin, end] = ["begin", "end"].map(|side| format!("<!-- {name}: {side} -->"));
    let page = docs().join("explanation/accuracy.md");
    let old = std::fs::read_to_string(&page)?;
    let missing = format!("{} has no place for {name}", page.display());
    let (before, rest) = old.split_once(&begin).ok_or(missing.as_str())?;
    let (_, after) = rest.split_once(&end).ok_or(missing.as_str())?;
    std::fs::write(&page, format!("{before}{begin}\n{text}{end}{after}"))?;
    Ok(())
}
