//! Writes the manual pages and completions of the three programs, made from the definitions of their command lines.
//!
//! `cd-manual FOLDER` writes `FOLDER/man/NAME.1` for each program and each of its commands, and
//! `FOLDER/completions/SHELL/FILE` for bash, fish and zsh, with the names under which the shells look for them.

use std::path::PathBuf;

use clap::Command;
use clap_complete::Shell;

/// Shells for which completions are made.
const SHELLS: [Shell; 3] = [Shell::Bash, Shell::Fish, Shell::Zsh];

fn main() {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("cd-manual: command line: no folder; expected cd-manual FOLDER");
        std::process::exit(2);
    };
    for (path, text) in manual_files() {
        if let Err(faults) = cd_formats::atomic::write(&folder.join(path), &text) {
            eprintln!("{}", faults.format_report("cd-manual").trim_end());
            std::process::exit(2);
        }
    }
}

/// Paths below the folder, and contents.
fn manual_files() -> Vec<(String, Vec<u8>)> {
    let programs = [cd_pre::command(), cd_solve::command(), cd_post::command()];
    programs.into_iter().flat_map(|program| [completions(&program), manual_pages(program)].concat()).collect()
}

/// Completions of a program, for each shell.
fn completions(program: &Command) -> Vec<(String, Vec<u8>)> {
    let name = program.get_name();
    let completion = |shell: Shell| {
        let mut text = Vec::new();
        clap_complete::generate(shell, &mut program.clone(), name, &mut text);
        let file = match shell {
            Shell::Fish => format!("{name}.fish"),
            Shell::Zsh => format!("_{name}"),
            _ => name.to_string(),
        };
        (format!("completions/{shell}/{file}"), text)
    };
    SHELLS.map(completion).to_vec()
}

/// Page of a program, and of each of its commands: `cd-pre.1`, `cd-pre-study.1`.
fn manual_pages(program: Command) -> Vec<(String, Vec<u8>)> {
    let source = format!("CD toolchain {}", program.get_version().unwrap_or_default());
    let mut program = program.disable_help_subcommand(true);
    program.build();
    let commands: Vec<Command> = program.get_subcommands().cloned().collect();
    let page = |command: Command| {
        let name = command.get_display_name().unwrap_or(command.get_name()).to_string();
        let mut text = Vec::new();
        let page = clap_mangen::Man::new(command).title(name.to_uppercase()).source(&source).manual("CD toolchain");
        page.render(&mut text).expect("written to memory");
        (format!("man/{name}.1"), text)
    };
    std::iter::once(program).chain(commands).map(page).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text_of(files: &[(String, Vec<u8>)], path: &str) -> String {
        let (_, text) = files.iter().find(|(name, _)| name == path).unwrap_or_else(|| panic!("{path}: not written"));
        String::from_utf8(text.clone()).unwrap()
    }

    #[test]
    fn pages_describe_every_option_of_every_command() {
        let files = manual_files();
        for mut program in [cd_pre::command(), cd_solve::command(), cd_post::command()] {
            program.build();
            let name = program.get_name().to_string();
            let commands = program.get_subcommands().filter(|command| command.get_name() != "help");
            let mut options = 0;
            for command in std::iter::once(&program).chain(commands) {
                let page = match command.get_name() {
                    own if own == name => format!("man/{name}.1"),
                    other => format!("man/{name}-{other}.1"),
                };
                let text = text_of(&files, &page);
                // An entry is a line in bold, such as "\fB\-o\fR, \fB\-\-output\fR \fI<DIR>\fR".
                let entries = text.lines().filter(|line| line.starts_with("\\fB\\-")).collect::<Vec<_>>();
                let shown = command.get_arguments().filter(|argument| !argument.is_hide_set());
                for option in shown.filter_map(|argument| argument.get_long()) {
                    let entry = format!("\\fB\\-\\-{}\\fR", option.replace('-', "\\-"));
                    assert!(entries.iter().any(|line| line.contains(&entry)), "{page}: no --{option}");
                    options += 1;
                }
            }
            assert!(options > 5, "{name}: {options} options");
        }
    }

    #[test]
    fn completions_know_options_and_commands_in_each_shell() {
        let files = manual_files();
        for (program, words) in [
            ("cd-pre", &["from-outbox", "pour", "study", "output"][..]),
            ("cd-solve", &["resume", "dump-problem", "threads"]),
            ("cd-post", &["compare", "report", "no-vtk"]),
        ] {
            for path in [format!("bash/{program}"), format!("fish/{program}.fish"), format!("zsh/_{program}")] {
                let text = text_of(&files, &format!("completions/{path}"));
                words.iter().for_each(|word| assert!(text.contains(word), "{path}: no {word}"));
            }
        }
    }
}
