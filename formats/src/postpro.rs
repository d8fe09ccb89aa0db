//! `DATBOX/POSTPRO.DAT`: commands of LMGC90 that request files with a row every few steps, which cd-solve writes.

use std::path::Path;

use crate::error::Faults;
use crate::ron_text::known_names;
use crate::scan::{AsciiText, LineScanner, TextLine};

/// Commands of a file, and notices about those that are left out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Postpro {
    pub commands: Vec<PostproCommand>,
    pub notices: Vec<String>,
}

/// Request of one file.
#[derive(Debug, Clone, PartialEq)]
pub struct PostproCommand {
    /// Line of the command, 1-based.
    pub line: usize,
    /// Steps between two rows; 0 requests a file without rows.
    pub period: u64,
    pub kind: PostproKind,
}

/// Contents of a request. Bodies are counted from 0 (from 1 in the file).
#[derive(Debug, Clone, PartialEq)]
pub enum PostproKind {
    SolverInformations,
    ViolationEvolution,
    KineticEnergy,
    DissipatedEnergy,
    CoordinationNumber,
    BodyTracking(Vec<usize>),
    TorqueEvolution(Vec<usize>),
    NewRigidSets(Vec<Vec<usize>>),
}

/// Command of LMGC90 that is computed; [`PostproKind`] has its data.
#[derive(Debug, Clone, Copy)]
enum ComputedCommand {
    SolverInformations,
    ViolationEvolution,
    KineticEnergy,
    DissipatedEnergy,
    CoordinationNumber,
    BodyTracking,
    TorqueEvolution,
    NewRigidSets,
}

/// Names of the commands that are computed.
const COMPUTED_COMMANDS: [(&str, ComputedCommand); 8] = [
    ("SOLVER INFORMATIONS", ComputedCommand::SolverInformations),
    ("VIOLATION EVOLUTION", ComputedCommand::ViolationEvolution),
    ("KINETIC ENERGY", ComputedCommand::KineticEnergy),
    ("DISSIPATED ENERGY", ComputedCommand::DissipatedEnergy),
    ("COORDINATION NUMBER", ComputedCommand::CoordinationNumber),
    ("BODY TRACKING", ComputedCommand::BodyTracking),
    ("TORQUE EVOLUTION", ComputedCommand::TorqueEvolution),
    ("NEW RIGID SETS", ComputedCommand::NewRigidSets),
];

/// Commands of LMGC90 that are left out.
const OMITTED_COMMANDS: [&str; 28] = [
    "AVERAGE VELOCITY EVOLUTION",
    "SPECIES KINETIC ENERGY",
    "SNAPSHOT SAMPLE",
    "MP SNAPSHOT SAMPLE",
    "NORMAL CONTACT DISTRIBUTION",
    "CONTACT FORCE DISTRIBUTION",
    "MP VALUE TRACKING",
    "TRIAXIAL COMPACITY",
    "DOUBLET INTERACTIONS",
    "QUASI SLIDING CONTACT",
    "NEW MECAx SETS",
    "Fint EVOLUTION",
    "Dep EVOLUTION",
    "NEW DIST SETS",
    "MAILx DIST",
    "NEW BOUNDED SETS",
    "DRY CONTACT NATURE",
    "WET CONTACT NATURE",
    "INTER ANALYSIS",
    "THERMAL EVOLUTION",
    "NETWORK EVOLUTION",
    "ELECTRO EVOLUTION",
    "CLOUD ANALYSIS",
    "DISPLAY TENSORS",
    "HEAT BOUND PROFILE",
    "VISIBILITY STATE",
    "PRxxx DETECTION",
    "DOUBLETS TORQUE EVOLUTION",
];

/// First and last column of the name of a command.
const NAME_COLUMNS: (usize, usize) = (1, 30);
/// First and last column of the period, behind `STEP`.
const PERIOD_COLUMNS: (usize, usize) = (5, 30);
/// Number of columns of a count or of the number of a body.
const NUMBER_WIDTH: usize = 7;

impl Postpro {
    /// Reads the file; reports all its faults at once. `body_count`: number of bodies of the scene.
    ///
    /// A command of LMGC90 that is not computed is left out with a notice; any other name is a fault. A file with lines
    /// but without `END` is read to its end, with a notice.
    pub fn read(path: &Path, body_count: usize) -> Result<Self, Faults> {
        Self::parse(path, &AsciiText::read_file(path)?, body_count)
    }

    /// Reads the text of a file; `path` is for messages. Errors: all faults of the text.
    pub fn parse(path: &Path, text: &AsciiText, body_count: usize) -> Result<Self, Faults> {
        let scan = &mut LineScanner::new(path, text);
        let mut postpro = Postpro::default();
        let mut ended = scan.peek_line().is_none();
        while let Some(line) = scan.next_line() {
            let name = command_name(line);
            scan.set_object(format!("command '{name}'"));
            if name.starts_with("END") {
                ended = true;
                break;
            }
            if let Some(command) = computed_command(name) {
                let command = read_command(scan, line, command, body_count);
                if command.is_none() {
                    skip_data(scan);
                }
                postpro.commands.extend(command);
            } else {
                if OMITTED_COMMANDS.contains(&name) {
                    let (file, number) = (path.display(), line.number);
                    postpro.notices.push(format!("{file}:{number}: command '{name}' is not computed: it is left out"));
                } else {
                    let expected = format!(
                        "{}, or another of LMGC90",
                        known_names(name, &COMPUTED_COMMANDS.map(|(known, _)| known))
                    );
                    scan.add_fault(line.number, "is not a command of LMGC90", expected);
                }
                skip_data(scan);
            }
        }
        if !ended {
            postpro.notices.push(format!("{}: no END: the file is read to its last line", path.display()));
        }
        scan.finish(postpro)
    }
}

/// Name of the command in a line, without the blanks after it.
fn command_name(line: TextLine<'_>) -> &str {
    line.columns(NAME_COLUMNS.0, NAME_COLUMNS.1).trim_end()
}

/// Command of this name, if it is one that is computed.
fn computed_command(name: &str) -> Option<ComputedCommand> {
    COMPUTED_COMMANDS.into_iter().find(|(known, _)| *known == name).map(|(_, command)| command)
}

/// Skips the period and the data of a command.
fn skip_data(scan: &mut LineScanner) {
    let is_command = |line: TextLine| {
        let name = command_name(line);
        name.starts_with("END") || computed_command(name).is_some() || OMITTED_COMMANDS.contains(&name)
    };
    while scan.next_line_if(|line| !is_command(line)).is_some() {}
}

/// Reads the lines after the name of a command; `None` after a fault.
fn read_command(
    scan: &mut LineScanner,
    line: TextLine,
    command: ComputedCommand,
    body_count: usize,
) -> Option<PostproCommand> {
    let step = scan.expect_line("expected STEP and a number of steps", |line| line.text().starts_with("STEP"))?;
    let period = step.columns(PERIOD_COLUMNS.0, PERIOD_COLUMNS.1).trim();
    let Ok(period) = period.parse() else {
        scan.add_fault(step.number, format!("the period is '{period}'"), "expected a number of steps");
        return None;
    };
    let kind = match command {
        ComputedCommand::SolverInformations => PostproKind::SolverInformations,
        ComputedCommand::ViolationEvolution => PostproKind::ViolationEvolution,
        ComputedCommand::KineticEnergy => PostproKind::KineticEnergy,
        ComputedCommand::DissipatedEnergy => PostproKind::DissipatedEnergy,
        ComputedCommand::CoordinationNumber => PostproKind::CoordinationNumber,
        ComputedCommand::BodyTracking => PostproKind::BodyTracking(read_bodies(scan, body_count)?),
        ComputedCommand::TorqueEvolution => PostproKind::TorqueEvolution(read_bodies(scan, body_count)?),
        ComputedCommand::NewRigidSets => {
            let count = read_number(scan, "number of sets")?;
            PostproKind::NewRigidSets((0..count).map(|_| read_bodies(scan, body_count)).collect::<Option<_>>()?)
        }
    };
    Some(PostproCommand { line: line.number, period, kind })
}

/// Reads a count and as many numbers of bodies; `None` after a fault.
fn read_bodies(scan: &mut LineScanner, body_count: usize) -> Option<Vec<usize>> {
    let count = read_number(scan, "number of bodies")?;
    (0..count).map(|_| read_body(scan, body_count)).collect()
}

/// Reads the number of a body; returns it counted from 0, or `None` after a fault.
fn read_body(scan: &mut LineScanner, body_count: usize) -> Option<usize> {
    let line_number = scan.peek_line().map(|line| line.number);
    let body = read_number(scan, "body")?;
    if !(1..=body_count as u64).contains(&body) {
        let expected = format!("expected 1 to {body_count}");
        scan.add_fault(line_number.unwrap_or_default(), format!("body {body} does not exist"), expected);
        return None;
    }
    Some(body as usize - 1)
}

/// Reads a line with one integer of 0 or more, which faults call `quantity`; `None` after a fault.
fn read_number(scan: &mut LineScanner, quantity: &str) -> Option<u64> {
    let begins_with_digit = |line: TextLine| line.text().trim_start().starts_with(|c: char| c.is_ascii_digit());
    let line = scan.expect_line(&format!("expected the {quantity}"), begins_with_digit)?;
    // Text behind the columns that LMGC90 reads, such as a colon, is a comment.
    let (columns, rest) = line.text().split_at_checked(NUMBER_WIDTH).unwrap_or((line.text(), ""));
    let text = columns.trim();
    if rest.starts_with(|c: char| c.is_ascii_digit()) || text.is_empty() {
        let found = format!("the {quantity} '{}' ends beyond column {NUMBER_WIDTH}", line.text().trim());
        scan.add_fault(line.number, found, "expected it in columns 1 to 7, which LMGC90 reads");
        return None;
    }
    let number = text.parse().ok();
    if number.is_none() {
        scan.add_fault(line.number, format!("the {quantity} is '{text}'"), "expected an integer");
    }
    number
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Postpro, Faults> {
        Postpro::parse("POSTPRO.DAT".as_ref(), &AsciiText::new(text.as_bytes()), 3)
    }

    #[test]
    fn commands_with_their_data() {
        let text = "# a comment\nSOLVER INFORMATIONS           \nSTEP 1\nBODY TRACKING\nSTEP         10\n      2\n      3\n      1\n\
                    DISPLAY TENSORS\nSTEP 5\nNEW RIGID SETS\nSTEP 0\n      1\n      2\n      1\n      2\nEND\n";
        let postpro = parse(text).unwrap();
        let expected = [
            (2, 1, PostproKind::SolverInformations),
            (4, 10, PostproKind::BodyTracking(vec![2, 0])),
            (11, 0, PostproKind::NewRigidSets(vec![vec![0, 1]])),
        ];
        let expected: Vec<_> =
            expected.into_iter().map(|(line, period, kind)| PostproCommand { line, period, kind }).collect();
        assert_eq!(postpro.commands, expected);
        assert_eq!(postpro.notices, ["POSTPRO.DAT:9: command 'DISPLAY TENSORS' is not computed: it is left out"]);
        assert_eq!(parse("KINETIC ENERGY\nSTEP 1\n").unwrap().notices.len(), 1);
        assert_eq!(parse("").unwrap(), Postpro::default());
        // LMGC90 reads seven columns of a number and thirty of a command.
        let text = "BODY TRACKING                 :\nSTEP 1                        :\n1                             :\n\
                    3                             : \nEND                           :\n";
        assert_eq!(parse(text).unwrap().commands[0].kind, PostproKind::BodyTracking(vec![2]));
    }

    #[test]
    fn mistakes_have_their_lines() {
        let text = "KINETIC ENERGIE\nSTEP 1\nBODY TRACKING\nSTEP 1\n      1\n      4\nTORQUE EVOLUTION\n      1\n      1\n\
                    KINETIC ENERGY\nSTEP x\nBODY TRACKING\nSTEP 1\n         1\n      1\nEND\n";
        let faults = parse(text).unwrap_err();
        let lines: Vec<_> = faults.0.iter().map(|fault| fault.line).collect();
        assert_eq!(lines, [1, 6, 8, 11, 14].map(Some), "{faults}");
        let text = faults.to_string();
        assert!(text.contains("KINETIC ENERGY") && text.contains("body 4 does not exist; expected 1 to 3"), "{text}");
    }
}
