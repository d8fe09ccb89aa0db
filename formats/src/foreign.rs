//! Folders of LMGC90 with bodies other than rigid ones in 3D.

use std::path::Path;

use crate::error::Fault;
use crate::names::count_text;
use crate::scan::AsciiText;

/// Types of bodies of BODIES.DAT that are not rigid bodies in 3D, and names of their kind.
const FOREIGN_BODIES: [(&str, &str); 4] =
    [("RBDY2", "2D"), ("MAILx", "deformable bodies"), ("MBS2D", "multibody systems"), ("MBS3D", "multibody systems")];

/// Contactors of 2D and of deformable bodies, for which a row of TACT_BEHAV.DAT has no contact here.
const FOREIGN_CONTACTORS: [&str; 23] = [
    "DISKx", "DISKb", "xKSID", "JONCx", "POLYG", "PT2Dx", "DISKL", "ALpxx", "CLxxx", "CLpxx", "PT2DL", "PT2TL",
    "ASpxx", "ASpx1", "ASpx3", "ASpx4", "ASpx6", "CSxxx", "CSpxx", "CSpx1", "CSpx3", "CSpx4", "CSpx6",
];

/// Fault of a BODIES.DAT with 2D or deformable bodies, one for all of them; `path` is for the message.
pub fn foreign_bodies(path: &Path, text: &AsciiText) -> Option<Fault> {
    let mut found: Option<(usize, usize, &str, &str)> = None;
    let mut is_begun = false;
    for line in text.lines() {
        let kind = FOREIGN_BODIES.iter().find(|(word, _)| is_begun && line.keyword() == *word);
        if let Some((word, kind)) = kind {
            found.get_or_insert((line.number, 0, word, kind)).1 += 1;
        }
        is_begun = line.keyword() == "bdyty" || (is_begun && line.text().trim_start().starts_with(['!', '#']));
    }
    let (line, count, word, kind) = found?;
    let found = format!("{} of type {word}: {kind}", count_text(count, "body"));
    Some(Fault::new(path, Some(line), "file", found, "expected RBDY3 only: rigid bodies in 3D are computed"))
}

/// Whether a body or a contactor of a row of TACT_BEHAV.DAT is one of 2D or of deformable bodies.
pub fn is_foreign_name(name: &str) -> bool {
    FOREIGN_BODIES.iter().any(|(word, _)| *word == name) || FOREIGN_CONTACTORS.contains(&name)
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
