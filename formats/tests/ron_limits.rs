//! Time to reject texts full of mistakes.

use std::path::Path;
use std::time::{Duration, Instant};

use cd_formats::compute::{Compute, from_ron};

/// Texts of 100 to 200 kB with a mistake every few bytes; each took up to minutes once.
#[test]
fn texts_full_of_mistakes_are_rejected_at_once() {
    let number = 10_000;
    for (start, item) in [
        ("(dt: 1.0, events: [", "(a: 1, b: e) "),
        ("(dt: 1.0, events: [", "(time: 1.0, q: 2),"),
        ("(dt: 1.0, events: [", "(time: 1.0, 2),"),
        ("(dt: 1.0, events: [", "\"a\" "),
        ("(dt: 1.0, probes: [", "(name: 1),\n"),
        ("", "(a: [{1; "),
        ("(", "a = 1.0 m,"),
    ] {
        let text = format!("{start}{}])", item.repeat(number));
        let begin = Instant::now();
        let faults = from_ron::<Compute>(Path::new("COMPUTE.RON"), &text, "options").unwrap_err();
        assert!(!faults.format_report("program").is_empty());
        // A tenth of a second each where nothing else runs.
        assert!(begin.elapsed() < Duration::from_secs(30), "{item}: {:?}", begin.elapsed());
    }
}
