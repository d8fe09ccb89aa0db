//! Words of LMGC90's text files: kinds of bodies and contactors.

/// Contactors that can be read.
pub(crate) const CONTACTOR_TYPES: [&str; 9] =
    ["SPHER", "SPHEb", "PLANx", "CYLND", "DNLYC", "CAPSx", "POLYR", "PT3Dx", "MESHx"];

/// Types of bodies of BODIES.DAT that are not rigid bodies in 3D, and names of their kind.
pub(crate) const FOREIGN_BODIES: [(&str, &str); 4] =
    [("RBDY2", "2D"), ("MAILx", "deformable bodies"), ("MBS2D", "multibody systems"), ("MBS3D", "multibody systems")];

/// Contactors of 2D and of deformable bodies.
const FOREIGN_CONTACTORS: [&str; 23] = [
    "DISKx", "DISKb", "xKSID", "JONCx", "POLYG", "PT2Dx", "DISKL", "ALpxx", "CLxxx", "CLpxx", "PT2DL", "PT2TL",
    "POLYD", "ASpxx", "ASpx3", "ASpx4", "ASpx6", "ASpx8", "CSxxx", "CSpxx", "CSpx3", "CSpx4", "CSpx6",
];

/// Whether a row of TACT_BEHAV.DAT, by body and contactor of both sides, is for 2D or deformable bodies: one side is of
/// these, and the other too or a rigid body in 3D.
///
/// A row of which only a part is foreign is not: it may be misspelt.
pub(crate) fn is_foreign_row(sides: [[&str; 2]; 2]) -> bool {
    let is_foreign = |[body, contactor]: &[&str; 2]| {
        FOREIGN_BODIES.iter().any(|(word, _)| word == body) && FOREIGN_CONTACTORS.contains(contactor)
    };
    let is_rigid = |[body, contactor]: &[&str; 2]| *body == "RBDY3" && CONTACTOR_TYPES.contains(contactor);
    sides.iter().any(is_foreign) && sides.iter().all(|side| is_foreign(side) || is_rigid(side))
}

/// Whether a word belongs to a data line, with which a record may be damaged.
pub(crate) fn is_data_word(word: &str) -> bool {
    ["RBDY3", "PLAIN", "NO6xx", "NO3xx", "POLYF", "vlocy", "force", "localframe"].contains(&word)
        || CONTACTOR_TYPES.contains(&word)
        || FOREIGN_BODIES.iter().any(|(body, _)| *body == word)
}
