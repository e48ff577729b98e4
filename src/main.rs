//! Weather-Magician: real weather on real places.
//!
//! The binary is thin: a command reads its options, calls the library and writes the results. See ARCHITECTURE.md.

// First, for its macros; tests use those of std, whose output is captured.
#[cfg(not(test))]
#[macro_use]
mod say;

mod choices;
mod commands;
mod dataset;
mod interrupt;
mod names;
mod overwrite;
mod progress;
// The page is of the program as it is built by default.
#[cfg(all(test, feature = "gpu", feature = "h264", feature = "viewer", not(feature = "nets")))]
mod reference_page;
mod report;
mod scene;
#[cfg(feature = "viewer")]
mod viewer;
mod weather;
mod weights;

use clap::Parser;
use clap::error::ErrorKind;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = match commands::Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    match commands::run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if interrupt::is_stop(&error) => {
            eprintln!("{error}");
            ExitCode::from(130)
        }
        Err(error) => {
            eprintln!("error: {}", one_line(&format!("{error:#}")));
            ExitCode::FAILURE
        }
    }
}

/// Prints help in full, and errors of the options in one line.
fn usage(error: &clap::Error) -> ExitCode {
    match error.kind() {
        ErrorKind::DisplayHelp
        | ErrorKind::DisplayVersion
        | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            // Nothing can be done if the terminal is gone.
            let _ = error.print();
            let asked = error.kind() != ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand;
            if asked { ExitCode::SUCCESS } else { ExitCode::from(2) }
        }
        _ => {
            // The error comes first, then a similar name, then usage.
            let text = error.to_string();
            let mut parts =
                text.split("\n\n").map(|part| part.split_whitespace().collect::<Vec<_>>().join(" "));
            let what = parts.next().unwrap_or_default();
            let meant = parts
                .find(|part| part.starts_with("tip: a similar ") || part.starts_with("tip: some similar "))
                .map(|tip| tip.replacen("tip: ", "; ", 1));
            eprintln!("{} (--help lists the options)", one_line(&(what + &meant.unwrap_or_default())));
            ExitCode::from(2)
        }
    }
}

/// Escapes control characters, so that a message stays on one line: file names may contain any character.
fn one_line(message: &str) -> String {
    let escaped = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    message.chars().map(escaped).collect()
}
