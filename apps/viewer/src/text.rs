//! Texts of others in messages.

/// Longest part of a text that is shown, characters.
const MAX_CHARACTERS: usize = 300;

/// Returns a text on one line, without control characters, and shortened.
pub fn one_line(text: &str) -> String {
    let mut line = String::new();
    for (count, c) in text.trim().chars().enumerate() {
        if count == MAX_CHARACTERS {
            line.push('…');
            break;
        }
        if c == '\n' {
            line.push(' ');
        } else if c.is_control()
            || ('\u{2028}'..='\u{202e}').contains(&c)
            || ('\u{2066}'..='\u{2069}').contains(&c)
        {
            line.extend(c.escape_default());
        } else {
            line.push(c);
        }
    }
    line
}

/// Returns the beginning of a text that is not understood, as [`one_line`].
pub(crate) fn shown(text: &str) -> String {
    one_line(&text.chars().take(40).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_one_short_line() {
        assert_eq!(one_line("a\nb\u{1b}[0m\u{202e}"), r"a b\u{1b}[0m\u{202e}");
        assert_eq!(one_line(&"ä".repeat(999)).chars().count(), MAX_CHARACTERS + 1);
    }
}
