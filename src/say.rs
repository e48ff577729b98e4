//! Printing to a pipe that may be closed, as in `inspect SCENE | head -1`, of texts that may come
//! from files of others: control characters that a terminal would act on are escaped.
//!
//! The macros replace those of std, which panic then, in every module of the program.

use std::borrow::Cow;
use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};

macro_rules! println {
    () => { $crate::say::line(format_args!("")) };
    ($($what:tt)*) => { $crate::say::line(format_args!($($what)*)) };
}

macro_rules! eprintln {
    () => { $crate::say::aside(format_args!("")) };
    ($($what:tt)*) => { $crate::say::aside(format_args!($($what)*)) };
}

/// Prints a line. Ignores a closed pipe; a full disk ends the program.
pub fn line(text: Arguments<'_>) {
    if let Err(error) = writeln!(io::stdout(), "{}", harmless(&text.to_string()))
        && error.kind() != ErrorKind::BrokenPipe
    {
        aside(format_args!("error: cannot print: {error}; send the output elsewhere"));
        wm_scene::files::abandon_temporaries();
        std::process::exit(1);
    }
}

/// Prints a line on the error stream. Ignores errors: they cannot be reported.
pub fn aside(text: Arguments<'_>) {
    let _ = writeln!(io::stderr(), "{}", harmless(&text.to_string()));
}

/// A text whose control characters are escaped, but for line breaks and tabs.
pub fn harmless(text: &str) -> Cow<'_, str> {
    let is_kept = |c: char| !c.is_control() || matches!(c, '\n' | '\t');
    if text.chars().all(is_kept) {
        return text.into();
    }
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        if is_kept(c) { escaped.push(c) } else { escaped.extend(c.escape_default()) }
    }
    escaped.into()
}

#[cfg(test)]
mod tests {
    use super::harmless;

    #[test]
    fn a_terminal_is_told_nothing() {
        assert_eq!(harmless("Zürich\t1\n2"), "Zürich\t1\n2");
        assert_eq!(
            harmless("a\u{1b}]0;title\u{7}b\u{9b}2J\u{7f}\r"),
            r"a\u{1b}]0;title\u{7}b\u{9b}2J\u{7f}\r"
        );
    }
}
