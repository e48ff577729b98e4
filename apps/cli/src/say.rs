//! Printing to a pipe that may be closed, as in `inspect SCENE | head -1`, of texts that may come
//! from files of others: control characters that a terminal would act on are escaped.
//!
//! The macros replace those of std, which panic then, in every module of the program.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use wm_base::error::printable;

macro_rules! println {
    () => { $crate::say::line(format_args!("")) };
    ($($what:tt)*) => { $crate::say::line(format_args!($($what)*)) };
}

macro_rules! print {
    ($($what:tt)*) => { $crate::say::text(format_args!($($what)*)) };
}

macro_rules! eprintln {
    () => { $crate::say::aside(format_args!("")) };
    ($($what:tt)*) => { $crate::say::aside(format_args!($($what)*)) };
}

/// Prints a line. Ignores a closed pipe; a full disk ends the program.
pub(crate) fn line(line: Arguments<'_>) {
    text(format_args!("{line}\n"));
}

/// Prints a text, and adds no end of line. Ignores a closed pipe; a full disk ends the program.
pub(crate) fn text(text: Arguments<'_>) {
    if let Err(error) = write!(io::stdout(), "{}", printable(&text.to_string()))
        && error.kind() != ErrorKind::BrokenPipe
    {
        aside(format_args!("error: cannot print: {error}; send the output elsewhere"));
        wm_base::files::abandon_temporaries();
        std::process::exit(1);
    }
}

/// Prints a line on the error stream. Ignores errors: they cannot be reported.
pub(crate) fn aside(text: Arguments<'_>) {
    let _ = writeln!(io::stderr(), "{}", printable(&text.to_string()));
}
