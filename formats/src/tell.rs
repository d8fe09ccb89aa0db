//! Messages to people.

use std::fmt::Display;
use std::io::Write;

/// Prints a message and a line's end on stdout. That nobody listens any more, as behind `| head`, is no fault: the work
/// goes on.
pub fn tell(message: impl Display) {
    let _ = writeln!(std::io::stdout(), "{message}");
}

/// The same on stderr, for what went wrong: a message that nobody can receive ends no run.
pub fn complain(message: impl Display) {
    let _ = writeln!(std::io::stderr(), "{message}");
}
