//! Messages to people.

use std::fmt::Display;
use std::io::Write;

/// Prints a message and a line's end on stdout. That nobody listens any more, as behind `| head`, is no fault: the work
/// goes on.
pub fn tell(message: impl Display) {
    let _ = writeln!(std::io::stdout(), "{message}");
}
