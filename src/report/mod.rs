//! HTML reports: one file without scripts or external resources.

pub mod picture;
pub mod plot;

/// The style sheet that all reports share.
pub const STYLE: &str = include_str!("page.css");

/// Returns the beginning of a page, up to its title; `style` is added to the shared style sheet.
pub fn head(title: &str, style: &str) -> String {
    let title = escaped(title);
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}</title>\n<style>\n{STYLE}{style}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"
    )
}

/// Returns the end of a page.
pub fn foot() -> String {
    let version = env!("CARGO_PKG_VERSION");
    format!("<h2>About</h2>\n<p>Written by weather-magician {version}.</p>\n</body>\n</html>\n")
}

/// Escapes text for HTML.
pub fn escaped(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut out, c| {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
        out
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_no_markup() {
        assert_eq!(escaped("<b>\"a\" & b"), "&lt;b&gt;&quot;a&quot; &amp; b");
    }
}
