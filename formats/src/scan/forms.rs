//! Deviations from the file formats that are accepted, as LMGC90 accepts them, with a notice each.

use std::collections::BTreeMap;

use crate::names::count_text;

/// Accepted deviation, whose meaning is unambiguous.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum AcceptedDeviation {
    /// Line outside of all records.
    OutsideLine,
    /// Comment whose `!` or `#` is not in column 1.
    IndentedComment,
    /// Comment behind the values of a line.
    TrailingComment,
    /// Number of the step or time not in its columns.
    ShiftedHead,
    /// Body whose number is not its position.
    BodyNumber,
    /// Body without a whole number after RBDY3.
    BodyWithoutNumber,
    /// POLYF, a POLYR in patches.
    PatchedSurface,
    /// Vertex of a POLYR at the position of another.
    JoinedVertex,
    /// Vertex of a POLYR that is no corner of a triangle.
    UnusedVertex,
    /// Row of the visibility table for bodies or contactors that are deformable or of 2D.
    ForeignRow,
    /// Material of springs, which no rigid body has.
    SpringMaterial,
    /// Material of a law other than `RIGID`.
    OtherMaterialLaw,
    /// Axes t and s of a contact that are not orthogonal.
    SkewAxes,
    /// Axes of a contact on a plate that are left-handed.
    LeftHandedAxes,
    /// Component whose table has times that do not increase.
    UnsortedTable,
}

impl AcceptedDeviation {
    /// Sentence about `count` occurrences of the form.
    fn sentence(self, count: usize) -> String {
        let one = count == 1;
        let are = if one { "is" } else { "are" };
        match self {
            AcceptedDeviation::OutsideLine => {
                format!("{} outside of the records {are} skipped", count_text(count, "line"))
            }
            AcceptedDeviation::IndentedComment => {
                format!(
                    "{} that {} with ! or # {are} skipped",
                    count_text(count, "line"),
                    if one { "begins" } else { "begin" }
                )
            }
            AcceptedDeviation::TrailingComment => {
                format!("{} behind a blank and ! {are} skipped", count_text(count, "comment"))
            }
            AcceptedDeviation::UnsortedTable => format!(
                "{} {} a table whose times do not increase; its lines are taken by increasing time, in LMGC90 in their order",
                count_text(count, "component"),
                if one { "has" } else { "have" }
            ),
            AcceptedDeviation::ShiftedHead => "step number and time are read next to $steps and time=".into(),
            AcceptedDeviation::BodyNumber => format!(
                "{} {} a number other than the position; bodies are counted by position",
                count_text(count, "body"),
                if one { "has" } else { "have" }
            ),
            AcceptedDeviation::BodyWithoutNumber => format!(
                "{} {} no whole number after RBDY3; bodies are counted by position",
                count_text(count, "body"),
                if one { "has" } else { "have" }
            ),
            AcceptedDeviation::PatchedSurface => {
                format!("{count} POLYF {are} read as POLYR, with the patches joined at their common vertices")
            }
            AcceptedDeviation::JoinedVertex => format!(
                "{} of POLYR {are} joined to another at the same position, up to the digits of the file",
                count_text(count, "vertex")
            ),
            AcceptedDeviation::UnusedVertex => format!(
                "{} of POLYR that no triangle has as a corner {are} dropped: {} inside of the body",
                count_text(count, "vertex"),
                if one { "it is" } else { "they are" }
            ),
            AcceptedDeviation::SpringMaterial => {
                format!("{} of law DISCRETE {are} skipped", count_text(count, "material"))
            }
            AcceptedDeviation::OtherMaterialLaw => format!(
                "{} {} a law other than RIGID, of which only the density is used",
                count_text(count, "material"),
                if one { "has" } else { "have" }
            ),
            AcceptedDeviation::SkewAxes => format!(
                "the axes t and s of {} of spheres are not orthogonal; they are turned about n",
                count_text(count, "contact")
            ),
            AcceptedDeviation::LeftHandedAxes => {
                format!("the axes n, t, s of {} on plates are left-handed; s is reversed", count_text(count, "contact"))
            }
            AcceptedDeviation::ForeignRow => {
                format!("{} for 2D or deformable bodies {are} skipped", count_text(count, "visibility row"))
            }
        }
    }
}

/// Occurrences of a deviation in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct DeviationOccurrences {
    count: usize,
    /// Line of the first, from 1.
    first_line: usize,
}

/// Deviations found in a file, by form.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct AcceptedDeviations(BTreeMap<AcceptedDeviation, DeviationOccurrences>);

impl AcceptedDeviations {
    /// Counts an occurrence in `line`.
    pub fn add(&mut self, form: AcceptedDeviation, line: usize) {
        self.add_occurrences(form, DeviationOccurrences { count: 1, first_line: line });
    }

    /// Adds the occurrences in a later part of the same file.
    pub(super) fn append(&mut self, later: AcceptedDeviations) {
        later.0.into_iter().for_each(|(form, occurrences)| self.add_occurrences(form, occurrences));
    }

    fn add_occurrences(
        &mut self,
        form: AcceptedDeviation,
        DeviationOccurrences { count, first_line }: DeviationOccurrences,
    ) {
        self.0.entry(form).or_insert(DeviationOccurrences { count: 0, first_line }).count += count;
    }

    /// Notices for the user about the file `name`, one for each kind: `BODIES.DAT:12: 2 bodies have a number ...`.
    pub fn notices(&self, name: &str) -> Vec<String> {
        let notice =
            |(form, DeviationOccurrences { count, first_line }): (&AcceptedDeviation, &DeviationOccurrences)| {
                format!("{name}:{first_line}: {}", form.sentence(*count))
            };
        self.0.iter().map(notice).collect()
    }
}
