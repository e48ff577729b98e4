//! Words and numbers of a text.

use crate::error::{ReportError, quoted};

/// A word or a number, and its place in characters from 1.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Token {
    /// In small letters.
    pub(crate) text: String,
    /// As it is written.
    pub(crate) raw: String,
    pub(crate) number: Option<f64>,
    at: usize,
}

pub(super) fn fault(token: &Token, problem: impl std::fmt::Display) -> ReportError {
    ReportError::Text {
        kind: "words",
        position: token.at,
        problem: format!("{} {problem}", quoted(&token.raw)),
    }
}

/// Splits a text into clauses of tokens.
pub(super) fn clauses(text: &str) -> Vec<Vec<Token>> {
    let chars: Vec<char> = text.chars().collect();
    let mut clauses = vec![Vec::new()];
    let mut index = 0;
    let digit = |index: usize| chars.get(index).is_some_and(char::is_ascii_digit);
    while index < chars.len() {
        let c = chars[index];
        let at = index + 1;
        let is_minus = |c: char| matches!(c, '-' | '\u{2212}');
        let follows_space = index == 0 || !chars[index - 1].is_alphanumeric();
        if digit(index) || ((is_minus(c) || matches!(c, '+' | '.')) && digit(index + 1) && follows_space) {
            let start = index;
            index += 1;
            while digit(index) || (chars.get(index) == Some(&'.') && digit(index + 1)) {
                index += 1;
            }
            let text: String =
                chars[start..index].iter().map(|c| if is_minus(*c) { '-' } else { *c }).collect();
            let number = text.parse().ok();
            push(&mut clauses, Token { raw: text.clone(), text, number, at });
        } else if c.is_alphabetic() || matches!(c, '\u{b0}' | '%') {
            let start = index;
            index += 1;
            let is_part = |c: &char| c.is_alphabetic() || matches!(c, '/' | '\u{b0}' | '\'');
            while c != '%' && chars.get(index).is_some_and(is_part) {
                index += 1;
            }
            let raw: String = chars[start..index].iter().collect();
            let text = raw.to_lowercase();
            if matches!(&text[..], "and" | "with" | "but" | "then") {
                clauses.push(Vec::new());
            } else {
                push(&mut clauses, Token { text, raw, number: None, at });
            }
        } else {
            if matches!(c, ',' | ';' | '.' | '\n') {
                clauses.push(Vec::new());
            } else if !c.is_whitespace() && !matches!(c, '-' | '(' | ')' | ':' | '!' | '/') {
                push(&mut clauses, Token { text: c.into(), raw: c.into(), number: None, at });
            }
            index += 1;
        }
    }
    clauses.retain(|clause| !clause.is_empty());
    clauses
}

fn push(clauses: &mut [Vec<Token>], token: Token) {
    if let Some(last) = clauses.last_mut() {
        last.push(token);
    }
}
