//! Command lines of the programs: their reading, and messages about mistakes in their arguments and in the folders of cases
//! that they name.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{ArgMatches, Command, Parser};

use crate::atomic;
use crate::error::Fault;
use crate::messages::{print_error, print_usage};
use crate::ron_text::nearest_name;

/// Folder of a case that a program reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CaseFolder {
    /// DATBOX, the input of cd-solve.
    Datbox,
    /// OUTBOX, the results of cd-solve.
    Outbox,
    /// Any folder.
    Any,
}

impl CaseFolder {
    fn name(self) -> &'static str {
        match self {
            CaseFolder::Datbox => "DATBOX",
            CaseFolder::Outbox => "OUTBOX",
            CaseFolder::Any => "",
        }
    }
}

/// Fault of a path that is not a case with the folder `part`; `None` if it is one. `program` is the program that reads it.
pub fn case_fault(path: &Path, part: CaseFolder, program: &str) -> Option<Fault> {
    let own_part = part_name(path);
    if path.join(part.name()).is_dir() && (part != CaseFolder::Any || own_part.is_none()) {
        return None;
    }
    if path.is_file() {
        return Some(file_fault(path, part, program));
    }
    // "scene.ron/" is no file, but means one.
    let without_slash: PathBuf = path.components().collect();
    if without_slash.is_file() {
        return case_fault(&without_slash, part, program);
    }
    let scene = path.join("scene.ron");
    let fault = |object: &str, found: String, expected: String| Some(Fault::new(path, None, object, found, expected));
    if !path.exists() {
        return fault("folder", "there is no such folder".into(), expected_case(part));
    }
    if let Some(name) = own_part {
        let article = if name == "OUTBOX" { "an" } else { "a" };
        return fault("folder", format!("is {article} {name}"), "expected the folder that it is in".into());
    }
    match part {
        CaseFolder::Datbox if scene.is_file() => {
            fault("folder", "has a scene but no DATBOX".into(), format!("run cd-pre {} first", scene.display()))
        }
        CaseFolder::Datbox => {
            fault("folder", "has no DATBOX".into(), "expected the files of cd-pre or LMGC90 in it".into())
        }
        _ if path.join("DATBOX").is_dir() => {
            fault("folder", "has no OUTBOX".into(), format!("run cd-solve {} first", path.display()))
        }
        _ if scene.is_file() => {
            let run = format!("run cd-pre {} and cd-solve {} first", scene.display(), path.display());
            fault("folder", "has a scene but no OUTBOX".into(), run)
        }
        _ => {
            let expected = "expected snapshot-*.npz, the results of cd-solve";
            Some(Fault::new(&path.join("OUTBOX"), None, "folder", "is missing", expected))
        }
    }
}

/// Fault of a file in place of a case with the folder `part`.
fn file_fault(path: &Path, part: CaseFolder, program: &str) -> Fault {
    let parent_text = |path: &Path| match path.parent() {
        Some(parent) if parent != Path::new("") => parent.display().to_string(),
        _ => ".".into(),
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let folder = parent_text(path);
    let (found, expected) = if name.ends_with(".ron") {
        let expected = match part {
            CaseFolder::Datbox => format!("run cd-pre {} first, then {program} {folder}", path.display()),
            _ if Path::new(&folder).join("OUTBOX").is_dir() => format!("did you mean {folder}?"),
            _ if Path::new(&folder).join("DATBOX").is_dir() => format!("run cd-solve {folder} first"),
            _ => format!("run cd-pre {} and cd-solve {folder} first", path.display()),
        };
        ("is a scene, not a case", expected)
    } else if name.starts_with("snapshot-") && name.ends_with(".npz") {
        let folder = Path::new(&folder);
        let is_outbox = folder.file_name().is_some_and(|name| name == "OUTBOX");
        let expected = if is_outbox { format!("did you mean {}?", parent_text(folder)) } else { expected_case(part) };
        ("is a snapshot, not a case", expected)
    } else {
        ("is not a folder", expected_case(part))
    };
    Fault::new(path, None, "file", found, expected)
}

/// Expectation of a case with the folder `part`, in words.
fn expected_case(part: CaseFolder) -> String {
    match part {
        CaseFolder::Any => "expected the folder of a case".into(),
        part => format!("expected the folder of a case, with {} in it", part.name()),
    }
}

/// Name of the part of a case that the folder itself is; `None` if it is none.
fn part_name(path: &Path) -> Option<&'static str> {
    let holds_snapshots = || {
        let entries = atomic::folder_entries(path).unwrap_or_default();
        let names = entries.iter().filter_map(|entry| entry.file_name()?.to_str());
        names.into_iter().any(|name| name.starts_with("snapshot-") && name.ends_with(".npz"))
    };
    let is_folder_named = |name: &str| path.file_name().is_some_and(|own| own == name) && path.is_dir();
    if path.join("BODIES.DAT").is_file() {
        Some("DATBOX")
    } else if is_folder_named("OUTBOX") || holds_snapshots() {
        Some("OUTBOX")
    } else {
        ["POSTPRO", "DISPLAY"].into_iter().find(|name| is_folder_named(name))
    }
}

/// Version with the commit, which only the program itself is compiled with.
static VERSION: OnceLock<&'static str> = OnceLock::new();

/// Sets the text that `--version` prints after the name of the program; by default the version of the package alone. To be
/// called once, at the start of a program. Files that the program writes do not contain it.
pub fn set_version(version: &'static str) {
    VERSION.set(version).expect("called once");
}

/// Reads the command line of a program, its name first.
///
/// Errors: the exit code of a command line that is not accepted, or requests help or the version; the message is printed.
pub fn parse_arguments<T: Parser>(args: &[OsString]) -> Result<T, i32> {
    let program = match VERSION.get() {
        Some(version) => T::command().version(*version),
        None => T::command(),
    };
    let read = |matches: ArgMatches| T::from_arg_matches(&matches).map_err(|error| error.format(&mut program.clone()));
    program.clone().try_get_matches_from(args).and_then(read).map_err(|error| {
        let mistake = unknown_option_message(&program, &error, args, "--")
            .or_else(|| misplaced_word_message(&program, args))
            .or_else(|| unknown_option_message(&program, &error, args, "-"))
            .or_else(|| surplus_word_message(&program, &error, args))
            .or_else(|| missing_argument_message(&program, &error));
        match mistake.filter(|_| error.use_stderr()) {
            Some(mistake) => {
                print_error(format_args!("{}: {mistake}", program.get_name()));
                error.exit_code()
            }
            None => print_usage(program.get_name(), &error),
        }
    })
}

/// Message about an option that the command does not have, if it begins with `dashes`. It suggests the nearest option of the
/// command, or else one of another command of the program.
fn unknown_option_message(program: &Command, error: &clap::Error, args: &[OsString], dashes: &str) -> Option<String> {
    let word = unknown_word(error).filter(|word| word.starts_with(dashes))?;
    let bare = word.trim_start_matches('-');
    let question = |command: &Command| {
        let options: Vec<&str> = command.get_arguments().filter_map(|option| option.get_long()).collect();
        nearest_name(bare, &options).filter(|_| bare.len() > 1).map(|near| format!("did you mean --{near}"))
    };
    let name = program.get_name();
    let title = |command: &Command| {
        if command.get_name() == name { name.to_string() } else { format!("{name} {}", command.get_name()) }
    };
    let command = command_in_use(program, args).unwrap_or(program);
    let own_advice = question(command).map(|question| format!("{question}?"));
    let other_advice = || {
        let others = std::iter::once(program).chain(program.get_subcommands());
        others.filter_map(|other| Some(format!("{} of {}?", question(other)?, title(other)))).next()
    };
    let title = title(command);
    let advice =
        own_advice.or_else(other_advice).unwrap_or_else(|| format!("expected one of those that {title} --help lists"));
    Some(format!("{word}: is no option of {title}; {advice}"))
}

/// Word of a command line that clap does not know.
fn unknown_word(error: &clap::Error) -> Option<&str> {
    match error.get(ContextKind::InvalidArg) {
        Some(ContextValue::String(word)) if error.kind() == ErrorKind::UnknownArgument => Some(word),
        _ => None,
    }
}

/// Command of the program that a command line names first.
fn command_in_use<'a>(program: &'a Command, args: &[OsString]) -> Option<&'a Command> {
    let first = args.get(1)?.to_str()?;
    program.get_subcommands().find(|command| command.get_name() == first)
}

/// Name of an argument in the help.
fn argument_name(argument: &clap::Arg) -> &str {
    argument.get_value_names().and_then(|names| names.first()).map_or("argument", |name| name.as_str())
}

/// Message about a word beyond the arguments of a program, which clap takes for a command if there are any.
fn surplus_word_message(program: &Command, error: &clap::Error, args: &[OsString]) -> Option<String> {
    let word = match error.get(ContextKind::InvalidSubcommand) {
        Some(ContextValue::String(word)) => word,
        _ => unknown_word(error)?,
    };
    if let Some(option) = option_before(program, args, word) {
        return Some(format!("{word}: is not expected here; did you mean --{option}={word}?"));
    }
    if let Some(command) = command_in_use(program, args) {
        let names: Vec<&str> = command.get_positionals().map(argument_name).collect();
        return Some(format!("{word}: is not expected here; expected {} {}", command.get_name(), names.join(" ")));
    }
    let name = argument_name(program.get_positionals().next()?);
    let commands: Vec<&str> = program.get_subcommands().map(Command::get_name).filter(|name| *name != "help").collect();
    let or_command =
        if commands.is_empty() { String::new() } else { format!(", or before it a command: {}", commands.join(", ")) };
    Some(format!("{word}: is not expected here; expected one {name}{or_command}"))
}

/// Name of the option in front of a word whose value has to follow behind `=`.
fn option_before(program: &Command, args: &[OsString], word: &str) -> Option<String> {
    let position = args.iter().position(|arg| arg == word)?;
    let name = args[position.checked_sub(1)?].to_str()?.strip_prefix("--")?;
    let command = command_in_use(program, args).unwrap_or(program);
    let option = command.get_arguments().find(|option| option.get_long() == Some(name))?;
    option.is_require_equals_set().then(|| name.to_string())
}

/// Message about arguments that a command line lacks.
fn missing_argument_message(program: &Command, error: &clap::Error) -> Option<String> {
    let Some(ContextValue::Strings(missing)) = error.get(ContextKind::InvalidArg) else { return None };
    if error.kind() != ErrorKind::MissingRequiredArgument {
        return None;
    }
    let Some(ContextValue::StyledStr(usage)) = error.get(ContextKind::Usage) else { return None };
    let usage = usage.to_string();
    let usage = usage.trim().trim_start_matches("Usage:").trim();
    let name = program.get_name();
    Some(format!("no {}; expected {usage} (see {name} --help)", missing.join(" ")))
}

/// Message about the likely mistake in a command line that `program` has rejected: a command after its arguments, an option
/// without its two dashes, or a folder without `-o`; `None` if none is found. `args` begin with the program's name.
fn misplaced_word_message(program: &Command, args: &[OsString]) -> Option<String> {
    let words: Vec<&str> = args.iter().skip(1).map(|arg| arg.to_str()).collect::<Option<_>>()?;
    let commands: Vec<&str> = program.get_subcommands().map(Command::get_name).collect();
    let name = program.get_name();
    let first = words.first()?;
    if !first.starts_with('-')
        && !commands.contains(first)
        && let Some(position) = words.iter().position(|word| commands.contains(word))
    {
        let command = words[position];
        let others = [&words[..position], &words[position + 1..]].concat().join(" ");
        return Some(format!("{command}: a command comes first; did you mean {name} {command} {others}?"));
    }
    let command = program.get_subcommands().find(|command| command.get_name() == *first);
    let options = command.unwrap_or(program).get_arguments().filter_map(|option| option.get_long());
    let options: Vec<&str> = options.collect();
    let option_without_dashes = |word: &&str| {
        let bare = word.strip_prefix('-').unwrap_or(word);
        let known = nearest_name(bare, &options).filter(|_| bare.len() > 2 && !bare.starts_with('-'))?;
        (word.starts_with('-') || !Path::new(word).exists()).then_some(known)
    };
    let further_words = words.iter().skip(if command.is_some() { 2 } else { 1 });
    if let Some((word, option)) = further_words.filter_map(|word| Some((word, option_without_dashes(word)?))).next() {
        return Some(format!("{word}: is not expected here; did you mean --{option}?"));
    }
    let folder = folder_without_option(command.unwrap_or(program), &words[usize::from(command.is_some())..])?;
    Some(format!("{folder}: is not expected here; the folder is given by -o {folder}"))
}

/// The word beyond the arguments of a command that has an option `-o DIR`, which is not given.
fn folder_without_option<'a>(command: &Command, words: &[&'a str]) -> Option<&'a str> {
    let options: Vec<&clap::Arg> = command.get_arguments().filter(|option| !option.is_positional()).collect();
    let takes_folder = |option: &&clap::Arg| {
        let is_dir = option.get_value_names().is_some_and(|names| names.iter().any(|name| name.as_str() == "DIR"));
        option.get_short() == Some('o') && is_dir
    };
    if !options.iter().any(takes_folder) {
        return None;
    }
    if command.get_positionals().any(|words| matches!(words.get_action(), clap::ArgAction::Append)) {
        return None; // it takes any number
    }
    let mut positional_words = Vec::new();
    let mut words = words.iter();
    while let Some(&word) = words.next() {
        if word.starts_with("-o") || word.starts_with("--output") {
            return None;
        }
        let long = word.strip_prefix("--");
        match options.iter().find(|option| long.is_some() && long == option.get_long()) {
            Some(option) if option.get_action().takes_values() => drop(words.next()),
            _ if word.starts_with('-') => {}
            _ => positional_words.push(word),
        }
    }
    match positional_words[command.get_positionals().count().min(positional_words.len())..] {
        [folder] => Some(folder),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use clap::Arg;

    use super::*;

    #[test]
    fn what_is_no_case_says_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let case = folder.path();
        let said = |name: &str, part: CaseFolder| {
            let text = case_fault(&case.join(name), part, "cd-x").map_or(String::new(), |fault| fault.to_string());
            text.replace(&case.display().to_string(), "CASE")
        };
        let outbox = |name: &str| said(name, CaseFolder::Outbox);
        assert_eq!(outbox(""), "CASE/OUTBOX: folder: is missing; expected snapshot-*.npz, the results of cd-solve");
        let absent = "CASE/absent: folder: there is no such folder; expected the folder of a case, with OUTBOX in it";
        assert_eq!(outbox("absent"), absent);
        fs::write(case.join("scene.ron"), "()").unwrap();
        let steps = "run cd-pre CASE/scene.ron and cd-solve CASE first";
        assert_eq!(outbox("scene.ron"), format!("CASE/scene.ron: file: is a scene, not a case; {steps}"));
        fs::create_dir(case.join("DATBOX")).unwrap();
        fs::write(case.join("DATBOX/BODIES.DAT"), "").unwrap();
        assert_eq!(outbox("scene.ron"), "CASE/scene.ron: file: is a scene, not a case; run cd-solve CASE first");
        assert_eq!(outbox("DATBOX"), "CASE/DATBOX: folder: is a DATBOX; expected the folder that it is in");
        fs::create_dir(case.join("OUTBOX")).unwrap();
        assert_eq!(outbox("OUTBOX"), "CASE/OUTBOX: folder: is an OUTBOX; expected the folder that it is in");
        fs::write(case.join("OUTBOX/snapshot-000001.npz"), "").unwrap();
        assert_eq!(outbox("scene.ron"), "CASE/scene.ron: file: is a scene, not a case; did you mean CASE?");
        let snapshot = "CASE/OUTBOX/snapshot-000001.npz: file: is a snapshot, not a case; did you mean CASE?";
        assert_eq!(outbox("OUTBOX/snapshot-000001.npz"), snapshot);
        for part in [CaseFolder::Datbox, CaseFolder::Outbox, CaseFolder::Any] {
            assert_eq!(case_fault(case, part, "cd-x"), None);
            assert!(said("OUTBOX", part).contains("is an OUTBOX") && said("DATBOX", part).contains("is a DATBOX"));
        }
    }

    #[test]
    fn words_out_of_order_and_without_dashes_are_recognised() {
        let state = Command::new("state").arg(Arg::new("snapshot").long("snapshot"));
        let program = Command::new("cd-x").subcommand(state).arg(Arg::new("resume").long("resume"));
        let said = |line: &str| {
            let args: Vec<OsString> = format!("cd-x {line}").split(' ').map(OsString::from).collect();
            misplaced_word_message(&program, &args).unwrap_or_default()
        };
        assert_eq!(said("here state there"), "state: a command comes first; did you mean cd-x state here there?");
        assert_eq!(said(". resume"), "resume: is not expected here; did you mean --resume?");
        assert_eq!(said(". -resume"), "-resume: is not expected here; did you mean --resume?");
        assert_eq!(said("state . snapshot 3"), "snapshot: is not expected here; did you mean --snapshot?");
        assert_eq!(said(". other"), "");
        // A word too many.
        let one = program.clone().arg(Arg::new("dir").value_name("DIR")).args_conflicts_with_subcommands(true);
        let error = one.clone().try_get_matches_from(["cd-x", "a", "b"]).unwrap_err();
        let expected = "b: is not expected here; expected one DIR, or before it a command: state";
        let message = surplus_word_message(&one, &error, &["cd-x", "a", "b"].map(OsString::from));
        assert_eq!(message.as_deref(), Some(expected));
        let output = Arg::new("output").short('o').long("output").value_name("DIR");
        let study = Command::new("study").args([Arg::new("study"), output.clone(), Arg::new("set").long("set")]);
        let program = Command::new("cd-x").args([Arg::new("scene"), output]).subcommand(study);
        let said = |line: &str| {
            let args: Vec<OsString> = format!("cd-x {line}").split(' ').map(OsString::from).collect();
            misplaced_word_message(&program, &args).unwrap_or_default()
        };
        let expected = "to: is not expected here; the folder is given by -o to";
        assert_eq!(["a.ron to", "study a.ron --set x=1 to"].map(said), [expected; 2]);
        assert_eq!(["a.ron to -o there", "a.ron to there", "a.ron"].map(said), [""; 3]);
    }
}
