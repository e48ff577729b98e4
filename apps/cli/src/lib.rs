//! Weather-Magician: real weather on real places.
//!
//! The program as one function, [`run`]: the binary calls it, and so does the Python package, in
//! its own process. A command reads its options, calls the library and writes the results. See
//! ARCHITECTURE.md.
//!
//! The program is a package of its own, and so is the library, `weather-magician`. One package with
//! a feature would give every user of the library the dependencies of the program, such as clap,
//! axum and tokio, unless they knew a feature to turn off.

// Macros of std for printing panic when a pipe is closed; those of `say` replace them.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

// First, for its macros; tests use those of std, whose output is captured.
#[cfg(not(test))]
#[macro_use]
mod say;

mod choices;
mod commands;
mod dataset;
mod interrupt;
mod level_args;
mod memory;
mod names;
mod output;
mod overwrite;
mod progress;
// The page is of the program as it is built by default.
#[cfg(all(test, feature = "gpu", feature = "h264", feature = "viewer", not(feature = "nets")))]
mod reference_page;
mod report;
mod scene;
mod training_page;
#[cfg(feature = "viewer")]
mod viewer;
mod weather;
mod weights;

use clap::Parser;
use clap::error::ErrorKind;
use std::ffi::OsString;
use std::io::Write;
use wm_base::error::escaped;

/// Runs the program; `args` are its name and its options. Returns its exit status: 0 for success, 1
/// for an error, 2 for wrong options, 130 if it was stopped by Ctrl-C, 143 by SIGTERM, 129 by
/// SIGHUP.
///
/// Results, progress and errors are printed. Ctrl-C ends the process unless the current work stops
/// by itself; the process's own handler of it, if there was one, is gone from then on.
pub fn run(args: impl IntoIterator<Item = OsString>) -> u8 {
    let status = match commands::Cli::try_parse_from(args) {
        Ok(cli) => match commands::run(cli) {
            Ok(()) => 0,
            Err(error) if interrupt::is_stop(&error) => {
                eprintln!("{error}");
                interrupt::status()
            }
            Err(error) => {
                eprintln!("error: {}", escaped(&format!("{error:#}")));
                1
            }
        },
        Err(error) => usage(&error),
    };
    // The end of a Rust program does this; that of another process does not. A closed pipe is no
    // error.
    let _ = std::io::stdout().flush();
    status
}

/// Prints help in full, and errors of the options in one line. Returns the exit status.
fn usage(error: &clap::Error) -> u8 {
    match error.kind() {
        ErrorKind::DisplayHelp
        | ErrorKind::DisplayVersion
        | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            // Nothing can be done if the terminal is gone.
            let _ = error.print();
            let asked = error.kind() != ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand;
            if asked { 0 } else { 2 }
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
            eprintln!("{} (--help lists the options)", escaped(&(what + &meant.unwrap_or_default())));
            2
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_usage_names_the_program_whatever_started_it() {
        let words = ["/usr/lib/python3/weather_magician/__main__.py", "weather", "--help"];
        let help = commands::Cli::try_parse_from(words).unwrap_err().to_string();
        assert!(help.contains("Usage: weather-magician weather "), "{help}");
    }

    #[test]
    fn the_status_tells_what_happened() {
        let run = |words: &[&str]| run(words.iter().map(OsString::from));
        assert_eq!(run(&["weather-magician", "--version"]), 0);
        assert_eq!(run(&["weather-magician", "inspect", "/no/such/scene.ply"]), 1);
        assert_eq!(run(&["weather-magician", "inspect", "--no-such-option"]), 2);
    }
}
