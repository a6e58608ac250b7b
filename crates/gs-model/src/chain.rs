//! What people are told: errors with their causes, and names out of files.

use std::error::Error;

/// An error and its causes, outermost first: `a: b: c`, always one line, as [`printable`] shows it.
///
/// No error of this project repeats its cause in its own text.
#[must_use]
pub fn chain(error: &(dyn Error + 'static)) -> String {
    let causes = std::iter::successors(Some(error), |&e| e.source());
    let texts: Vec<String> = causes.map(ToString::to_string).collect();
    printable(&texts.join(": ").replace(['\n', '\r'], " "))
}

/// A text that moves no cursor and changes no colour: names of files, properties and views may hold anything. Control
/// characters but line feeds, and those that turn the direction of text, become escapes such as `\u{1b}`.
#[must_use]
pub fn printable(text: &str) -> String {
    let turns = |c| matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            c if (c.is_control() && c != '\n') || turns(c) => shown.extend(c.escape_default()),
            c => shown.push(c),
        }
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_steer_a_terminal() {
        assert_eq!(
            printable("a\x1b[31mb\r\x07\u{9b}\u{202e}c\nü"),
            "a\\u{1b}[31mb\\r\\u{7}\\u{9b}\\u{202e}c\nü"
        );
        let error = std::io::Error::other("x\x1b[2J\ny");
        assert_eq!(chain(&error), "x\\u{1b}[2J y");
    }
}
