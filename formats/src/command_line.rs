//! Command lines of the programs: their reading, and messages about mistakes in their arguments.

use std::ffi::OsString;
use std::path::Path;
use std::sync::OnceLock;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{ArgMatches, Command, Parser};

use crate::messages::{print_error, print_usage};
use crate::ron_text::nearest_name;

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
            .or_else(|| missing_argument_message(&program, &error, args));
        match mistake.filter(|_| error.use_stderr()) {
            Some(mistake) => {
                print_error(format_args!("{}: {mistake}", program.get_name()));
                error.exit_code()
            }
            None => print_usage(program.get_name(), &title_in_use(&program, args), &error),
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
    let command = command_in_use(program, args).unwrap_or(program);
    let own_advice = question(command).map(|question| format!("{question}?"));
    let other_advice = || {
        let others = std::iter::once(program).chain(program.get_subcommands());
        others.filter_map(|other| Some(format!("{} of {}?", question(other)?, command_title(program, other)))).next()
    };
    let title = command_title(program, command);
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

/// Words with which a command begins, as `cd-post movie`: the program, and the command unless it is the program itself.
fn command_title(program: &Command, command: &Command) -> String {
    let name = program.get_name();
    if command.get_name() == name { name.to_string() } else { format!("{name} {}", command.get_name()) }
}

/// Title of the command of a command line, whose `--help` lists its options.
fn title_in_use(program: &Command, args: &[OsString]) -> String {
    command_title(program, command_in_use(program, args).unwrap_or(program))
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
fn missing_argument_message(program: &Command, error: &clap::Error, args: &[OsString]) -> Option<String> {
    let Some(ContextValue::Strings(missing)) = error.get(ContextKind::InvalidArg) else { return None };
    if error.kind() != ErrorKind::MissingRequiredArgument {
        return None;
    }
    let Some(ContextValue::StyledStr(usage)) = error.get(ContextKind::Usage) else { return None };
    let usage = usage.to_string();
    let usage = usage.trim().trim_start_matches("Usage:").trim();
    Some(format!("no {}; expected {usage} (see {} --help)", missing.join(" "), title_in_use(program, args)))
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
    use clap::Arg;

    use super::*;

    #[test]
    fn words_out_of_order_and_without_dashes_are_recognised() {
        let state = Command::new("state").arg(Arg::new("snapshot").long("snapshot"));
        let program = Command::new("cd-x").subcommand(state).arg(Arg::new("resume").long("resume"));
        let messages = |line: &str| {
            let args: Vec<OsString> = format!("cd-x {line}").split(' ').map(OsString::from).collect();
            misplaced_word_message(&program, &args).unwrap_or_default()
        };
        assert_eq!(messages("here state there"), "state: a command comes first; did you mean cd-x state here there?");
        assert_eq!(messages(". resume"), "resume: is not expected here; did you mean --resume?");
        assert_eq!(messages(". -resume"), "-resume: is not expected here; did you mean --resume?");
        assert_eq!(messages("state . snapshot 3"), "snapshot: is not expected here; did you mean --snapshot?");
        assert_eq!(messages(". other"), "");
        // A word too many.
        let one = program.clone().arg(Arg::new("dir").value_name("DIR")).args_conflicts_with_subcommands(true);
        let error = one.clone().try_get_matches_from(["cd-x", "a", "b"]).unwrap_err();
        let expected = "b: is not expected here; expected one DIR, or before it a command: state";
        let message = surplus_word_message(&one, &error, &["cd-x", "a", "b"].map(OsString::from));
        assert_eq!(message.as_deref(), Some(expected));
        // A missing argument of a command.
        let needs_body =
            Command::new("cd-x").subcommand(Command::new("track").arg(Arg::new("body").long("body").required(true)));
        let error = needs_body.clone().try_get_matches_from(["cd-x", "track"]).unwrap_err();
        let message = missing_argument_message(&needs_body, &error, &["cd-x", "track"].map(OsString::from)).unwrap();
        assert!(message.ends_with("(see cd-x track --help)"), "{message}");
        let output = Arg::new("output").short('o').long("output").value_name("DIR");
        let study = Command::new("study").args([Arg::new("study"), output.clone(), Arg::new("set").long("set")]);
        let program = Command::new("cd-x").args([Arg::new("scene"), output]).subcommand(study);
        let messages = |line: &str| {
            let args: Vec<OsString> = format!("cd-x {line}").split(' ').map(OsString::from).collect();
            misplaced_word_message(&program, &args).unwrap_or_default()
        };
        let expected = "to: is not expected here; the folder is given by -o to";
        assert_eq!(["a.ron to", "study a.ron --set x=1 to"].map(messages), [expected; 2]);
        assert_eq!(["a.ron to -o there", "a.ron to there", "a.ron"].map(messages), [""; 3]);
    }
}
