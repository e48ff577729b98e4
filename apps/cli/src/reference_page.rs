//! `docs/reference/command-line.md`, generated from the options themselves.

use crate::commands::Cli;
use clap::builder::StyledStr;
use clap::{Arg, Command, CommandFactory};
use std::fmt::Write;

/// The page: a section a command, a row an option.
fn markdown() -> String {
    let mut page =
        "# Command line\n\nGenerated from the program's options; `weather-magician COMMAND --help` \
                    prints the same with more words.\n"
            .to_owned();
    let mut program = Cli::command();
    program.build();
    for command in program.get_subcommands().filter(|command| command.get_name() != "help") {
        // A command of commands has a section for each.
        if command.has_subcommands() {
            for inner in command.get_subcommands().filter(|inner| inner.get_name() != "help") {
                section(inner, &format!("{} {}", command.get_name(), inner.get_name()), &mut page);
            }
        } else {
            section(command, command.get_name(), &mut page);
        }
    }
    page
}

fn section(command: &Command, name_of: &str, page: &mut String) {
    let about = one_line(command.get_about());
    let usage = command.clone().render_usage().to_string();
    let usage = usage.trim_start_matches("Usage: ");
    writeln!(page, "\n## {name_of}\n\n{about}.\n\n```sh\n{usage}\n```\n").unwrap();
    page.push_str("| option | value | default | what it does |\n|---|---|---|---|\n");
    let args = command.get_arguments().filter(|arg| !arg.is_hide_set() && arg.get_id() != "help");
    for arg in args {
        let default: Vec<_> = arg.get_default_values().iter().map(|value| value.to_string_lossy()).collect();
        let default = if is_flag(arg) { String::new() } else { default.join(" ") };
        let [name, value, default] = [name(arg), value(arg), default].map(|text| code(&text));
        let help = one_line(arg.get_help()).replace('|', "\\|");
        writeln!(page, "| {name} | {value} | {default} | {help} |").unwrap();
    }
}

fn is_flag(arg: &Arg) -> bool {
    !arg.get_action().takes_values()
}

fn name(arg: &Arg) -> String {
    match (arg.get_long(), arg.get_short()) {
        (Some(long), Some(short)) => format!("-{short}, --{long}"),
        (Some(long), None) => format!("--{long}"),
        _ => arg.get_value_names().map_or_else(String::new, |names| names.join(" ")),
    }
}

/// Returns the values that an option takes: the words it knows, or the name of its value.
fn value(arg: &Arg) -> String {
    if is_flag(arg) || arg.is_positional() {
        return String::new();
    }
    let words: Vec<String> =
        arg.get_possible_values().iter().map(|word| word.get_name().to_owned()).collect();
    if !words.is_empty() && words.len() <= 8 {
        return words.join(", ");
    }
    arg.get_value_names().map_or_else(String::new, |names| names.join(" "))
}

fn code(text: &str) -> String {
    if text.is_empty() { String::new() } else { format!("`{}`", text.replace('|', "\\|")) }
}

fn one_line(text: Option<&StyledStr>) -> String {
    let text = text.map(ToString::to_string).unwrap_or_default();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// With `WM_UPDATE_DOCS=1` in the environment, writes the page.
#[test]
fn the_page_in_docs_is_this_one() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/reference/command-line.md");
    if std::env::var("WM_UPDATE_DOCS").is_ok_and(|v| v == "1") {
        std::fs::write(path, markdown()).unwrap();
    }
    let page = std::fs::read_to_string(path).unwrap_or_default();
    let stale =
        "docs/reference/command-line.md is stale: run WM_UPDATE_DOCS=1 cargo test --lib reference_page";
    assert!(page == markdown(), "{stale}");
}
