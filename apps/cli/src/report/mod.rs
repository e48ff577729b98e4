//! HTML reports: one file without scripts or external resources.

pub(crate) mod picture;

pub(crate) use weather_magician::measure::plot::{self, escaped};

/// Returns cells as the line of a CSV file (RFC 4180), quoted where they have to be.
pub(crate) fn csv_line<T: AsRef<str>>(cells: &[T]) -> String {
    let quoted = |cell: &T| match cell.as_ref() {
        plain if !plain.contains([',', '"', '\n', '\r']) => plain.to_owned(),
        other => format!("\"{}\"", other.replace('"', "\"\"")),
    };
    cells.iter().map(quoted).collect::<Vec<_>>().join(",")
}

/// The style sheet that all reports share.
pub(crate) const STYLE: &str = include_str!("page.css");

/// Returns the beginning of a page, up to its title; `style` is added to the shared style sheet.
pub(crate) fn head(title: &str, style: &str) -> String {
    let title = escaped(title);
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; \
         img-src data:\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}</title>\n<style>\n{STYLE}{style}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"
    )
}

/// Returns the end of a page.
pub(crate) fn foot() -> String {
    let version = env!("CARGO_PKG_VERSION");
    format!("<h2>About</h2>\n<p>Written by weather-magician {version}.</p>\n</body>\n</html>\n")
}
