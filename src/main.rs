//! Weather-Magician: real weather on real places.
//!
//! The binary is thin: a command reads its options, puts the crates of the corridor together and
//! writes what comes out. See ARCHITECTURE.md.

mod commands;
mod interrupt;
mod media;
mod names;
mod output;
mod pipeline;
mod progress;
mod scene;
mod studio;
mod view;

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
        Err(error) if error.is::<interrupt::Interrupted>() => {
            eprintln!("{error}");
            ExitCode::from(130)
        }
        Err(error) => {
            let line = format!("{error:#}").split_whitespace().collect::<Vec<_>>().join(" ");
            eprintln!("error: {line}");
            ExitCode::FAILURE
        }
    }
}

/// Prints help in full, and what is wrong with the options in one line.
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
            let text = error.to_string();
            let lines = text.split("\n\n").next().unwrap_or_default().split_whitespace();
            eprintln!("{} (--help lists the options)", lines.collect::<Vec<_>>().join(" "));
            ExitCode::from(2)
        }
    }
}
