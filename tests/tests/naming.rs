//! Names and comments of the code as CONTRIBUTING.md requires: counted over all crates, some of them also in tests.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

const CRATES: [&str; 4] = ["formats", "pre", "solver", "post"];

/// Largest share of type names of one word: terms of the field that stand alone, as `Contact` or `Scene`.
const ONE_WORD_TYPES: f64 = 0.25;

/// Largest share of function names of one word: `new`, `parse`, `write` and operators are a fifth.
const ONE_WORD_FUNCTIONS: f64 = 0.30;

/// Prepositions, adverbs, participles and adjectives that do not name the value of a function or closure.
const NAMELESS_WORDS: &str = "\
    about above across added after again against all along alone apart around at before behind below beside between \
    beyond borne bounded broken by centred chosen closing concatenated covering crossed current down due equal every \
    evaluated far farther farthest finer finite first fitted for found from held idle imposed in innermost inside \
    joined known last listed lower lowest made measured moved moving named near next numbered of on other others out \
    outward over own preconditioned present radial reduced refused renamed replaced reversed riding rotated said \
    scaled selected shifted sorted stored swapped through to toward towards turned unaccounted unproven unquoted \
    unscaled until weighted whole with within";

/// Words of these that name arguments and fields well, in a pair or a range: `own` and `other`, `from` and `to`, `whole` and
/// `part`, `hidden` and `covering`.
const ARGUMENT_WORDS: &str = "\
    covering current every first found from last lower next other others out outward own present radial to whole";

/// Words of these by which functions of tests, and methods of iterators and of random numbers in them, are named.
const TEST_WORDS: &str = "at below between equal last near next";

/// Words that CONTRIBUTING.md retires and that have no other use here; `place`, `way` and `quench` have.
const RETIRED_WORDS: [&str; 18] = [
    "tell",
    "tells",
    "told",
    "looked at",
    "ask for",
    "asks for",
    "asked for",
    "stands in",
    "go on",
    "goes on",
    "beside",
    "knot",
    "knots",
    "room",
    "refuse",
    "refuses",
    "refused",
    "refusal",
];

/// Beginnings of doc comments that do not name their item.
const HEADLESS_WORDS: [&str; 9] = ["What ", "Of ", "By how ", "So ", "Nor ", "Whatever ", "Asked ", "Only ", "Its "];

/// Source files of a crate, without those of tests.
fn source_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            source_files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Source files of all crates, with their texts.
fn sources() -> Vec<(PathBuf, String)> {
    CRATES.iter().flat_map(|name| crate_sources(name)).collect()
}

/// Source files of a crate, with their texts.
fn crate_sources(name: &str) -> Vec<(PathBuf, String)> {
    let files = folder_sources(&format!("{name}/src"));
    assert!(files.len() > 20);
    files
}

/// Source files of the tests, benchmarks and examples of all crates, with their texts, without this file.
fn test_sources() -> Vec<(PathBuf, String)> {
    let folders = CRATES.iter().flat_map(|name| ["tests", "benches", "examples"].map(|part| format!("{name}/{part}")));
    let shared = ["tests/src", "tests/tests", "tests/examples"].map(String::from);
    let files = folders.chain(shared).flat_map(|folder| folder_sources(&folder));
    files.filter(|(file, _)| !file.ends_with("naming.rs")).collect()
}

/// Source files in a folder of the repository, with their texts; none if there is no such folder.
fn folder_sources(folder: &str) -> Vec<(PathBuf, String)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder);
    let mut files = Vec::new();
    if folder.is_dir() {
        source_files(&folder, &mut files);
    }
    files.into_iter().map(|file| (file.clone(), fs::read_to_string(file).unwrap())).collect()
}

/// Lines of code and comments of all crates before their tests.
fn lines() -> Vec<String> {
    CRATES.iter().flat_map(|name| crate_lines(name)).collect()
}

/// Lines of a crate before its tests.
fn crate_lines(name: &str) -> Vec<String> {
    let code = |(_, text): (PathBuf, String)| text.split("#[cfg(test)]").next().unwrap().to_string();
    crate_sources(name)
        .into_iter()
        .map(code)
        .flat_map(|code| code.lines().map(str::to_string).collect::<Vec<_>>())
        .collect()
}

/// Comments of a line and its strings of several words, without quoted code and placeholders.
fn prose(line: &str) -> Vec<String> {
    let (code, comment) = match line.find("//") {
        Some(at) if at == 0 || line[..at].ends_with(' ') => (&line[..at], Some(&line[at..])),
        _ => (line, None),
    };
    let strings = code.split('"').skip(1).step_by(2).filter(|text| text.contains(' '));
    let without_code = |text: &str| {
        let outside = text.split('`').step_by(2).collect::<Vec<_>>().join("`");
        let pieces = outside.split(['[', '{']).enumerate();
        pieces
            .map(|(k, piece)| piece.split_once([']', '}']).filter(|_| k > 0).map_or(piece, |(_, rest)| rest))
            .collect()
    };
    comment.into_iter().chain(strings).map(without_code).collect()
}

/// Whether a text has the name of a variable where a word belongs, as renaming tools leave it: `sweeps in new_text of`, or
/// one of the variables of its file, `variables`, between two words.
fn has_name_as_word(text: &str, variables: &BTreeSet<&str>) -> bool {
    let words: Vec<&str> = text.split_whitespace().collect();
    // Symbols with an index, as x_i, have parts of one letter.
    let is_part = |part: &str| part.len() > 1 && part.bytes().all(|b| b.is_ascii_lowercase());
    let is_name = |word: &str| word.contains('_') && word.split('_').all(is_part);
    let is_word = |word: &str| word.bytes().all(|b| b.is_ascii_alphabetic());
    let precedes_word = |name: &str, next: &str| {
        ["of", "at", "the", "all", "most"].contains(&next) || variables.contains(name) && is_word(next)
    };
    words.windows(3).any(|three| is_word(three[0]) && is_name(three[1]) && precedes_word(three[1], three[2]))
}

/// Names that a text of code binds by `let`, alone or in a tuple.
fn variable_names(code: &str) -> BTreeSet<&str> {
    let bound = code.lines().filter_map(|line| line.trim_start().strip_prefix("let ")?.split_once(" ="));
    let names = bound.flat_map(|(names, _)| names.split(|c: char| !c.is_alphanumeric() && c != '_'));
    names.filter(|name| name.contains('_')).collect()
}

/// Names of the closures of all crates.
fn closure_names() -> Vec<String> {
    // The value of a long one begins on the next line.
    let name = |[line, next]: [&str; 2]| {
        let rest = line.trim_start().strip_prefix("let ")?;
        let (name, value) = rest.trim_start_matches("mut ").split_once(" =")?;
        let value = if value.is_empty() { next.trim_start() } else { value.trim_start() };
        value.trim_start_matches("move ").starts_with('|').then(|| name.to_string())
    };
    let lines = lines();
    lines.windows(2).filter_map(|pair| name([&pair[0], &pair[1]])).collect()
}

/// First of the retired words in a text.
fn retired_word(text: &str) -> Option<&'static str> {
    let words =
        text.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ");
    let words = format!(" {} ", words.to_lowercase());
    RETIRED_WORDS.into_iter().find(|word| words.contains(&format!(" {word} ")))
}

/// Names that follow one of the keywords, sorted; each as often as it is defined.
fn defined_names(lines: &[String], keywords: &[&str]) -> Vec<String> {
    let name = |line: &String| {
        let code = line.trim_start();
        if code.starts_with("//") {
            return None;
        }
        let after = |keyword: &&str| {
            let at = code.find(&format!("{keyword} "))?;
            let begins = at == 0 || code[..at].ends_with([' ', '(']);
            let name: String =
                code[at + keyword.len() + 1..].chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            (begins && !name.is_empty()).then_some(name)
        };
        keywords.iter().find_map(after)
    };
    lines.iter().filter_map(name).collect()
}

/// Text between the brackets that open at the start of `text`, which begins with one.
fn bracketed(text: &str) -> &str {
    let mut depth = 0;
    for (at, letter) in text.char_indices() {
        match letter {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return &text[1..at];
        }
    }
    text
}

/// Names that stand before a type in a list of fields or arguments, without its comments.
fn names_with_types(list: &str) -> impl Iterator<Item = String> {
    let (mut depth, mut parts) = (0, vec![String::new()]);
    for letter in list.lines().filter(|line| !line.trim_start().starts_with(['/', '#'])).flat_map(str::chars) {
        match letter {
            '(' | '[' | '{' | '<' => depth += 1,
            ')' | ']' | '}' | '>' => depth -= 1,
            ',' if depth == 0 => parts.push(String::new()),
            _ => {}
        }
        parts.last_mut().unwrap().push(letter);
    }
    let is_name = |name: &String| name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_') && !name.is_empty();
    let name =
        |part: String| Some(part.trim_start_matches(',').split_once(": ")?.0.split_whitespace().last()?.to_string());
    parts.into_iter().filter_map(name).filter(is_name)
}

/// Names of the arguments of functions and of the fields of structs, without the keys of files and options, which users read.
fn argument_and_field_names(code: &str) -> Vec<String> {
    let mut names = Vec::new();
    for (at, _) in code.match_indices("fn ") {
        let rest = &code[at..];
        let is_function = rest[3..].starts_with(|c: char| c.is_ascii_lowercase());
        if let Some(open) =
            rest.find('(').filter(|_| is_function && !code[..at].ends_with(|c: char| c.is_alphanumeric()))
        {
            names.extend(names_with_types(bracketed(&rest[open..])));
        }
    }
    for (at, _) in code.match_indices("struct ") {
        let attributes = code[..at].rsplit("\n\n").next().unwrap();
        let are_keys = ["Deserialize", "Parser", "Args"].iter().any(|trait_name| attributes.contains(trait_name));
        let rest = &code[at..];
        let open = rest.find(['{', ';', '(', '\n']).filter(|open| rest[*open..].starts_with('{'));
        if let Some(open) = open.filter(|_| !are_keys) {
            names.extend(names_with_types(bracketed(&rest[open..])));
        }
    }
    names
}

/// Text of a line of a doc comment.
fn doc_text(line: &str) -> Option<&str> {
    ["///", "//!"].into_iter().find_map(|mark| line.trim_start().strip_prefix(mark))
}

/// Number of doc comments in a text of code, and those with a headless beginning: number and text of their first line.
fn headless_comments(code: &str) -> (usize, Vec<(usize, &str)>) {
    let is_headless = |text: &str| HEADLESS_WORDS.iter().any(|word| text.starts_with(word));
    let lines = [""].into_iter().chain(code.lines());
    let pairs = (1..).zip(lines.zip(code.lines()));
    let comments = pairs.filter_map(|(number, (before, line))| {
        let text = doc_text(line).filter(|_| doc_text(before).is_none())?;
        Some((number, text.trim_start()))
    });
    let comments: Vec<(usize, &str)> = comments.collect();
    (comments.len(), comments.into_iter().filter(|(_, text)| is_headless(text)).collect())
}

/// Share of names for which `holds`.
fn share(names: &[String], holds: impl Fn(&str) -> bool) -> f64 {
    names.iter().filter(|name| holds(name)).count() as f64 / names.len() as f64
}

#[test]
fn types_have_two_words_unless_they_are_terms_of_the_field() {
    let mut names = defined_names(&lines(), &["struct", "enum", "trait"]);
    names.retain(|name| name.starts_with(char::is_uppercase));
    names.sort();
    names.dedup();
    let one_word = |name: &str| name.chars().filter(|c| c.is_uppercase()).count() <= 1;
    let found = share(&names, one_word);
    assert!(names.len() > 300 && found <= ONE_WORD_TYPES, "{:.0} % of {} types", 100.0 * found, names.len());
}

#[test]
fn a_name_is_that_of_one_type_in_its_crate() {
    for name in CRATES {
        let lines = crate_lines(name);
        let mut names = defined_names(&lines, &["struct", "enum", "trait"]);
        names.retain(|name| name.starts_with(char::is_uppercase));
        names.sort();
        let repeated: Vec<&str> = names.windows(2).filter(|two| two[0] == two[1]).map(|two| two[0].as_str()).collect();
        assert!(repeated.is_empty(), "{name}: {repeated:?}");
    }
}

#[test]
fn functions_have_two_words_unless_they_are_verbs_of_rust() {
    let names = defined_names(&lines(), &["fn"]);
    let found = share(&names, |name| !name.contains('_'));
    assert!(names.len() > 1500 && found <= ONE_WORD_FUNCTIONS, "{:.0} % of {} functions", 100.0 * found, names.len());
}

#[test]
fn functions_and_closures_are_named_by_their_values() {
    // Functions of traits of Rust, and the half of an error that says what was found.
    const OTHER_NAMES: [&str; 2] = ["from", "found"];
    let is_nameless = |name: &&String| NAMELESS_WORDS.split_whitespace().any(|word| word == *name);
    let closures = closure_names();
    let nameless: Vec<&String> = closures.iter().filter(is_nameless).collect();
    assert!(closures.len() > 1000 && nameless.is_empty(), "{nameless:?} of {} closures", closures.len());
    let functions = defined_names(&lines(), &["fn"]);
    let is_other = |name: &String| OTHER_NAMES.contains(&name.as_str());
    let nameless: Vec<&String> = functions.iter().filter(|name| is_nameless(name) && !is_other(name)).collect();
    assert!(nameless.is_empty(), "{nameless:?} of {} functions", functions.len());
    // Functions of tests, also of those within the sources.
    let is_test_word = |name: &String| TEST_WORDS.split_whitespace().any(|word| word == name);
    for (file, text) in sources().into_iter().chain(test_sources()) {
        let lines: Vec<String> = text.lines().map(str::to_string).collect();
        let functions = defined_names(&lines, &["fn"]);
        let is_fault = |name: &&String| is_nameless(name) && !is_other(name) && !is_test_word(name);
        let nameless: Vec<&String> = functions.iter().filter(is_fault).collect();
        assert!(nameless.is_empty(), "{}: {nameless:?}", file.display());
    }
}

#[test]
fn arguments_and_fields_are_named_by_their_values() {
    let code = "/// A row.\nstruct Row<T> {\n    /// Its far end: m.\n    pub near: Vec<(u32, T)>,\n    size: f64,\n}\n\n\
                #[derive(Deserialize)]\nstruct Key {\n    until: f64,\n}\n\nfn f(mut far: &[u8; 3], [a, b]: [f64; 2]) {}";
    assert_eq!(argument_and_field_names(code), ["far", "near", "size"]);
    let is_in = |list: &str, name: &str| list.split_whitespace().any(|word| word == name);
    let mut count = 0;
    let mut nameless = Vec::new();
    for (file, text) in sources() {
        let names = argument_and_field_names(text.split("#[cfg(test)]").next().unwrap());
        count += names.len();
        let found = names.into_iter().filter(|name| is_in(NAMELESS_WORDS, name) && !is_in(ARGUMENT_WORDS, name));
        nameless.extend(found.map(|name| format!("{}: {name}", file.display())));
    }
    assert!(count > 5000 && nameless.is_empty(), "of {count}:\n{}", nameless.join("\n"));
}

#[test]
fn comments_and_messages_have_no_retired_words() {
    assert_eq!(retired_word("/// Reads the files beside the scene"), Some("beside"));
    assert_eq!(retired_word("/// Goes on, asked-for values"), Some("asked for"));
    assert_eq!(retired_word("/// Memory besides the bond; a roommate"), None);
    for (file, text) in sources().into_iter().chain(test_sources()) {
        for (number, line) in (1..).zip(text.lines()) {
            let word = prose(line).iter().find_map(|text| retired_word(text));
            assert!(word.is_none(), "{}:{number}: {word:?}: {line}", file.display());
        }
    }
}

#[test]
fn comments_and_messages_have_words_not_names_of_variables() {
    let variables = variable_names("    let (mean_changes, size) = sizes();");
    let is_left = |line: &str| has_name_as_word(&prose(line)[0], &variables);
    assert!(is_left("    // Every subset from_frame at most four"));
    assert!(is_left("    // The edge is where d mean_changes beyond that value"));
    assert!(is_left(r#"    format!("sweeps in contact_text of {solver}")"#));
    assert!(!is_left("/// Value of `output_every` of the run"));
    for (file, text) in sources().into_iter().chain(test_sources()) {
        // Messages name options, which are variables, too.
        let (variables, none) = (variable_names(&text), BTreeSet::new());
        for (number, line) in (1..).zip(text.lines()) {
            let known = if line.trim_start().starts_with("//") { &variables } else { &none };
            let is_left = prose(line).iter().any(|text| has_name_as_word(text, known));
            assert!(!is_left, "{}:{number}: {line}", file.display());
        }
    }
}

#[test]
fn comments_begin_with_the_name_of_their_item() {
    let code = "//! Of all.\n//! Its end\n\n/// What is\n/// So\nfn f() {}\n    /// Number\n    /// Of\n";
    assert_eq!(headless_comments(code), (3, vec![(1, "Of all."), (4, "What is")]));
    let mut count = 0;
    let mut headless = Vec::new();
    for (file, text) in sources().into_iter().chain(test_sources()) {
        let (number, found) = headless_comments(&text);
        count += number;
        headless.extend(found.iter().map(|(line, text)| format!("{}:{line}: {text}", file.display())));
    }
    assert!(count > 8000 && headless.is_empty(), "of {count}:\n{}", headless.join("\n"));
}
