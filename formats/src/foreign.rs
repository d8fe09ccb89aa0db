//! Folders of LMGC90 with bodies other than rigid ones in 3D.

use std::path::Path;

use crate::error::Fault;
use crate::names::count_text;
use crate::scan::AsciiText;
use crate::words::FOREIGN_BODIES;

/// Fault of a BODIES.DAT with 2D or deformable bodies, one for all of them; `path` is for the message.
pub fn foreign_bodies(path: &Path, text: &AsciiText) -> Option<Fault> {
    let mut count = 0;
    // Line, type and kind of the first such body.
    let mut first = None;
    // Whether the next line that is no comment has the type of a body.
    let mut begins_body = false;
    for line in text.lines() {
        let foreign = FOREIGN_BODIES.iter().find(|(word, _)| begins_body && line.keyword() == *word);
        if let Some((word, kind)) = foreign {
            count += 1;
            first.get_or_insert((line.number, word, kind));
        }
        begins_body = line.keyword() == "bdyty" || (begins_body && line.text().trim_start().starts_with(['!', '#']));
    }
    let (line, word, kind) = first?;
    let found = format!("{} of type {word}: {kind}", count_text(count, "body"));
    Some(Fault::new(path, Some(line), "file", found, "expected RBDY3 only: rigid bodies in 3D are computed"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_fault_for_all_bodies() {
        let text =
            AsciiText::new(b"$bdyty\n! RBDY2\n RBDY2      1\n$$$$$$\n$bdyty\n RBDY2      2\n$bdyty\n RBDY3      3\n");
        let fault = foreign_bodies(Path::new("B"), &text).unwrap().to_string();
        assert_eq!(
            fault,
            "B:3: file: 2 bodies of type RBDY2: 2D; expected RBDY3 only: rigid bodies in 3D are computed"
        );
        assert_eq!(foreign_bodies(Path::new("B"), &AsciiText::new(b"$bdyty\n RBDY3\n RBDY2\n")), None);
    }
}
