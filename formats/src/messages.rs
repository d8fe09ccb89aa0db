//! Lines of text that the programs print on stdout and stderr, and the message about a command line with a wrong value.

use std::borrow::Cow;
use std::error::Error;
use std::fmt::Display;
use std::io::Write;
use std::num::{IntErrorKind, ParseFloatError, ParseIntError};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::error::{ContextKind, ContextValue, ErrorKind};

use crate::error::Fault;
use crate::report::is_beyond_range;

/// Whether stdout is used for data, and lines of text go to stderr.
static STDOUT_IS_DATA: AtomicBool = AtomicBool::new(false);

/// Whether messages are dropped.
static IS_SILENT: AtomicBool = AtomicBool::new(false);

/// Drops all further messages of this process, which another process prints.
pub fn silence() {
    IS_SILENT.store(true, Ordering::Relaxed);
}

/// Whether messages are dropped, see [`silence`].
pub fn is_silent() -> bool {
    IS_SILENT.load(Ordering::Relaxed)
}

/// Error of stdout, the first of the process.
static STDOUT_ERROR: OnceLock<std::io::Error> = OnceLock::new();

/// Prints a message and a line end on stdout. The program continues if that fails, see [`exit_code`].
pub fn print_line(message: impl Display) {
    if STDOUT_IS_DATA.load(Ordering::Relaxed) {
        return print_error(message);
    }
    if is_silent() {
        return;
    }
    note_stdout_result(writeln!(std::io::stdout(), "{}", printable_text(&message.to_string())));
}

/// Records the error of a text on stdout.
fn note_stdout_result(result: std::io::Result<()>) {
    if let Err(error) = result {
        let _ = STDOUT_ERROR.set(error);
    }
}

/// Exit code of a program that would end with `code`: 1 in place of 0 if part of its text could not be written to stdout.
/// Prints the reason, unless the reader has closed the output, as `| head` does.
pub fn exit_code(program: &str, code: i32) -> i32 {
    note_stdout_result(std::io::stdout().flush());
    let Some(error) = STDOUT_ERROR.get() else { return code };
    if error.kind() != std::io::ErrorKind::BrokenPipe {
        print_error(format_args!("{program}: {}", Fault::from_io("standard output".as_ref(), "written", error)));
    }
    if code == 0 { 1 } else { code }
}

/// Prints all further lines of [`print_line`] on stderr, so that stdout is free for data.
pub fn reserve_stdout() {
    STDOUT_IS_DATA.store(true, Ordering::Relaxed);
}

/// Prints a message about a problem on stderr. A closed stderr does not end a run.
pub fn print_error(message: impl Display) {
    if is_silent() {
        return;
    }
    let _ = writeln!(std::io::stderr(), "{}", printable_text(&message.to_string()));
}

/// Text in which control characters other than line ends and tabs are escaped: text of a damaged file that a message quotes
/// must not control the terminal.
fn printable_text(text: &str) -> Cow<'_, str> {
    let is_escaped = |letter: char| letter.is_control() && !['\n', '\t'].contains(&letter);
    if !text.contains(is_escaped) {
        return text.into();
    }
    let escape = |letter: char| letter.escape_default().to_string();
    text.chars().map(|letter| if is_escaped(letter) { escape(letter) } else { letter.to_string() }).collect()
}

/// Prints a warning of a program on stderr.
pub fn print_warning(program: &str, message: impl Display) {
    print_error(format_args!("{program}: warning: {message}"));
}

/// Number of a flag that is beyond the range of f64.
#[derive(Debug)]
struct NumberRangeError;

impl Display for NumberRangeError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("expected a number below 1.8e308 in magnitude")
    }
}

impl Error for NumberRangeError {}

/// Reads the number of a flag. Errors: another text, and digits of a number that f64 cannot hold.
pub fn parse_number(text: &str) -> Result<f64, Box<dyn Error + Send + Sync>> {
    let number: f64 = text.parse()?;
    if is_beyond_range(text, number) { Err(NumberRangeError.into()) } else { Ok(number) }
}

/// Prints the error in the arguments of a program, or its help or version, and returns the exit code. `command`: words of the
/// command line whose `--help` lists the options, as `cd-post movie`.
pub fn print_usage(program: &str, command: &str, error: &clap::Error) -> i32 {
    match wrong_number_message(error) {
        Some(message) => print_error(format_args!("{program}: {message}")),
        None if error.use_stderr() => {
            print_error(format_args!("{program}: {}; see {command} --help", first_sentence(error)))
        }
        // Help and version also arrive here; they go to stdout.
        None if is_silent() => {}
        None => note_stdout_result(error.print()),
    }
    error.exit_code()
}

/// Largest number of characters of a value that a message about a command line shows.
const MAX_SHOWN_CHARS: usize = 200;

/// Text of an error in one line, without the usage of the program and the end of long values.
fn first_sentence(error: &clap::Error) -> String {
    let mut text = error.to_string();
    if let Some(ContextValue::String(value)) = error.get(ContextKind::InvalidValue)
        && let Some((end, _)) = value.char_indices().nth(MAX_SHOWN_CHARS)
    {
        text = text.replacen(value, &format!("{}...", &value[..end]), 1);
    }
    let lines = text.trim_start_matches("error: ").lines().map(str::trim).take_while(|line| !line.is_empty());
    lines.collect::<Vec<_>>().join(" ")
}

/// Message such as `--dt: abc; expected a number (s)`, for an option whose value is not a number of its kind.
fn wrong_number_message(error: &clap::Error) -> Option<String> {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.as_str()),
        _ => None,
    };
    if error.kind() != ErrorKind::ValueValidation {
        return None;
    }
    let (argument, found) = (text(ContextKind::InvalidArg)?, text(ContextKind::InvalidValue)?);
    let source = error.source()?;
    let expected = if source.is::<ParseFloatError>() {
        "a number"
    } else if source.is::<NumberRangeError>() {
        "a number below 1.8e308 in magnitude"
    } else {
        match source.downcast_ref::<ParseIntError>()?.kind() {
            IntErrorKind::PosOverflow => "a smaller integer",
            _ if found.starts_with('-') => "an integer of 0 or more",
            _ => "an integer",
        }
    };
    // The help shows an option with a placeholder of its value, as `--dt <S>`: S for seconds, M for metres.
    let (name, placeholder) = argument.split_once(' ').unwrap_or((argument, ""));
    let unit = match placeholder.trim_matches(['<', '>', '[', ']', '=']) {
        "S" => " (s)",
        "M" => " (m)",
        _ => "",
    };
    let name = name.split(['[', '=']).next().unwrap_or(name);
    let unit = if expected.contains("magnitude") { "" } else { unit };
    let found = if found.is_empty() { "no value" } else { found };
    Some(format!("{name}: {found}; expected {expected}{unit}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quoted_text_does_not_control_the_terminal() {
        assert_eq!(printable_text("a\u{e9}\tb\nc"), "a\u{e9}\tb\nc");
        assert_eq!(printable_text("'\u{1b}[2J\u{9b}31m\r\u{7}'\n"), "'\\u{1b}[2J\\u{9b}31m\\r\\u{7}'\n");
    }
    use crate::compute::ComputeFlags;
    use clap::{Args, Command};

    #[test]
    fn values_that_are_no_numbers() {
        let messages = |flag: &str| {
            let command = ComputeFlags::augment_args(Command::new("program"));
            let error = command.try_get_matches_from(["program", flag]).unwrap_err();
            wrong_number_message(&error).unwrap_or_else(|| error.to_string())
        };
        assert_eq!(messages("--tol=1e400"), "--tol: 1e400; expected a number below 1.8e308 in magnitude");
        assert_eq!(messages("--dt=abc"), "--dt: abc; expected a number (s)");
        assert_eq!(messages("--alert=1,5"), "--alert: 1,5; expected a number (m)");
        assert_eq!(messages("--quench=much"), "--quench: much; expected a number");
        assert_eq!(messages("--dt="), "--dt: no value; expected a number (s)");
        assert_eq!(messages("--threads=-1"), "--threads: -1; expected an integer of 0 or more");
        assert_eq!(messages("--steps=1.5"), "--steps: 1.5; expected an integer");
        assert_eq!(
            messages("--steps=99999999999999999999"),
            "--steps: 99999999999999999999; expected a smaller integer"
        );
        assert!(messages("--accuracy=high").contains("possible values"));
    }

    #[test]
    fn long_values_are_shortened() {
        let command = ComputeFlags::augment_args(Command::new("program"));
        let value = "é".repeat(100_000);
        let error = command.try_get_matches_from(["program", &format!("--events={value}")]).unwrap_err();
        let text = first_sentence(&error);
        assert!(text.contains(&format!("'{}...'", "é".repeat(MAX_SHOWN_CHARS))) && text.len() < 1000, "{text}");
    }
}
