//! Texts of RON that are full of mistakes, or cut off, are rejected at once.

use std::path::Path;
use std::time::{Duration, Instant};

use cd_formats::compute::{Compute, from_ron};

/// Texts of 1 MB with a mistake every few bytes; each took up to minutes once.
#[test]
fn texts_full_of_mistakes_are_rejected_at_once() {
    for (start, item) in [
        ("(dt: 1.0, events: [", "(a: 1, b: e) "),
        ("(dt: 1.0, events: [", "(time: 1.0, q: 2),"),
        ("(dt: 1.0, events: [", "(time: 1.0, 2),"),
        ("(dt: 1.0, events: [", "\"a\" "),
        ("(dt: 1.0, probes: [", "(name: 1),\n"),
        ("", "(a: [{1; "),
        ("(", "a = 1.0 m,"),
        ("(dt: 1.0, events: [", ".5 "),
        ("(dt: 1.0, events: [", "'a',"),
        ("(dt: 1.0, events: [", ","),
        ("(dt: 1.0, events: [(", "(1), "),
        ("(dt: ", "bum"),
    ] {
        let text = format!("{start}{}])", item.repeat(1_000_000 / item.len()));
        let begin = Instant::now();
        let faults = from_ron::<Compute>(Path::new("COMPUTE.RON"), &text, "options").unwrap_err();
        assert!(!faults.format_report("program").is_empty());
        // Half a second each where nothing else runs.
        assert!(begin.elapsed() < Duration::from_secs(30), "{item}: {:?}", begin.elapsed());
    }
}

/// `["é` was a panic: the name before a missing quote ended within a letter.
#[test]
fn texts_that_are_cut_off_are_rejected() {
    let text =
        r#"(dt: 1.0, /* é */ probes: [(name: "é", "quantité": Force(on: Colour("é"))), ("é", 'é', r"é")], é: "\é")"#;
    for end in (0..text.len()).filter(|&end| text.is_char_boundary(end)) {
        for start in [0, 1, 27].into_iter().filter(|&start| start < end) {
            assert!(from_ron::<Compute>(Path::new("COMPUTE.RON"), &text[start..end], "options").is_err());
        }
    }
}

/// The word behind the missing comma was a panic where it is longer than what messages show: its end was taken from the message.
#[test]
fn a_long_word_behind_a_missing_comma_is_rejected() {
    let text = format!("(dt: 1.0, events: [1 2{}:])", "é".repeat(200));
    let faults = from_ron::<Compute>(Path::new("COMPUTE.RON"), &text, "options").unwrap_err();
    assert!(faults.format_report("program").contains("no ',' before"), "{}", faults.format_report("program"));
}
