//! One HTML file with a whole site in it: modules and data are base64 in elements of their own,
//! which `single.js` gives to the page.

use super::output::{SiteFolder, at, megabytes, write as write_file};
use anyhow::{Context, Result, bail};
use base64::prelude::{BASE64_STANDARD, Engine};
use sha2::{Digest, Sha256};
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// Largest page: browsers read larger ones slowly, and mail and chat refuse them.
const MAX_FILE_BYTES: u64 = 40_000_000;
/// Files that are in the page itself.
const IN_PAGE: [&str; 4] = ["index.html", "style.css", "icon.svg", STARTER];
/// The script that gives the files to the page.
pub(crate) const STARTER: &str = "single.js";
/// The content policy: only what is inside of the page is loaded, and the one script that starts
/// it.
const POLICY: &str = "default-src 'none'; script-src 'sha256-STARTER' blob: 'wasm-unsafe-eval'; worker-src blob:; \
                      style-src 'unsafe-inline'; img-src blob: data:; media-src blob:; connect-src blob: data:; \
                      base-uri 'none'; form-action 'none'";

/// Writes a site as the HTML file `out`; returns its size, bytes.
pub(crate) fn write(folder: &SiteFolder, out: &Path) -> Result<u64> {
    let mut names = Vec::new();
    list(folder.path(), "", &mut names)?;
    names.sort();
    let read = |name: &str| {
        let path = folder.path().join(name);
        at(fs::read(&path), &path)
    };
    let mut files = Vec::new();
    for name in names.iter().filter(|name| !IN_PAGE.contains(&name.as_str())) {
        files.push((name.as_str(), read(name)?));
    }
    check_size(files.iter().map(|(name, bytes)| (*name, bytes.len() as u64)))?;
    let [index, style, icon, starter] = IN_PAGE.map(|name| -> Result<String> {
        String::from_utf8(read(name)?).with_context(|| format!("{name}: is no text"))
    });
    let html = page(&index?, &style?, &icon?, &starter?, &files)?;
    write_file(out, html.as_bytes())?;
    Ok(html.len() as u64)
}

/// Adds the names of all files below a folder, with slashes.
fn list(folder: &Path, prefix: &str, names: &mut Vec<String>) -> Result<()> {
    for entry in at(fs::read_dir(folder), folder)?.flatten() {
        let (path, name) = (entry.path(), format!("{prefix}{}", entry.file_name().to_string_lossy()));
        if path.is_dir() {
            list(&path, &format!("{name}/"), names)?;
        } else {
            names.push(name);
        }
    }
    Ok(())
}

/// Fails if files make a page that is too large.
fn check_size<'a>(files: impl Iterator<Item = (&'a str, u64)>) -> Result<()> {
    let (mut all, mut scene, mut prepared) = (0, 0, 0);
    for (name, bytes) in files {
        let bytes = bytes.div_ceil(3) * 4;
        all += bytes;
        scene += if name == "place/scene.sog" { bytes } else { 0 };
        prepared += if name.starts_with("place/assets/") { bytes } else { 0 };
    }
    if all > MAX_FILE_BYTES {
        bail!(
            "--single-file: the page would have {}, {} of them the scene and {} prepared data, and {} are the most: leave out \
             --single-file, prepare less with --asset-megabytes, or reduce the scene with `weather-magician convert --max-splats`",
            megabytes(all),
            megabytes(scene),
            megabytes(prepared),
            megabytes(MAX_FILE_BYTES)
        );
    }
    Ok(())
}

/// Returns the page with its style, its icon and all files in it.
fn page(index: &str, style: &str, icon: &str, starter: &str, files: &[(&str, Vec<u8>)]) -> Result<String> {
    let hash = BASE64_STANDARD.encode(Sha256::digest(starter.as_bytes()));
    let html = with_policy(index, &POLICY.replace("STARTER", &hash))?;
    let style = format!("<style>\n{style}</style>");
    let html = replaced(&html, "<link rel=\"stylesheet\" href=\"./style.css\">", &style)?;
    let html = replaced(&html, "<script type=\"module\" src=\"./main.js\"></script>\n", "")?;
    let icon = format!("\"data:image/svg+xml;base64,{}\"", BASE64_STANDARD.encode(icon));
    let html = replaced(&html, "\"./icon.svg\"", &icon)?;
    let mut inside = String::new();
    for (name, bytes) in files {
        let text = BASE64_STANDARD.encode(bytes);
        let _ = writeln!(
            inside,
            "<script type=\"application/octet-stream;base64\" data-name=\"{name}\">{text}</script>"
        );
    }
    let _ = writeln!(inside, "<script>{starter}</script>");
    replaced(&html, "</body>", &(inside + "</body>"))
}

/// Sets the policy of a page, which its head states.
pub(crate) fn with_policy(html: &str, policy: &str) -> Result<String> {
    let is_policy = |line: &&str| !line.contains("http-equiv=\"Content-Security-Policy\"");
    let html: String = html.split_inclusive('\n').filter(is_policy).collect();
    let charset = "<meta charset=\"utf-8\">\n";
    let policy = format!("{charset}<meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">\n");
    replaced(&html, charset, &policy)
}

/// Replaces all places of a text that must be there.
fn replaced(html: &str, from: &str, to: &str) -> Result<String> {
    if !html.contains(from) {
        bail!("the page of this program lacks `{}`", from.trim_end());
    }
    Ok(html.replace(from, to))
}

#[cfg(test)]
mod tests {
    use super::*;

    const INDEX: &str = "<!doctype html>\n<head>\n<meta charset=\"utf-8\">\n\
        <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'self'\">\n\
        <link rel=\"icon\" href=\"./icon.svg\">\n<link rel=\"stylesheet\" href=\"./style.css\">\n\
        <script type=\"module\" src=\"./main.js\"></script>\n</head>\n<body><img src=\"./icon.svg\"></body>\n";

    #[test]
    fn everything_is_inside_of_the_page() {
        let files = [("main.js", b"go()".to_vec()), ("place/scene.sog", vec![0, 255])];
        let html = page(INDEX, "a { color: red }\n", "<svg/>", "start();", &files).unwrap();
        for (part, count) in [
            ("data-name=\"main.js\">Z28oKQ==</script>", 1),
            ("data-name=\"place/scene.sog\">AP8=</script>", 1),
            ("<style>\na { color: red }\n</style>", 1),
            ("<script>start();</script>\n</body>", 1),
            ("\"data:image/svg+xml;base64,PHN2Zy8+\"", 2),
            ("Content-Security-Policy", 1),
            // `printf 'start();' | openssl dgst -sha256 -binary | base64`
            ("'sha256-E6jQvrT2ZivWG9GJ4AAEZf4MhI7l3QkLroW4hgvUT4c='", 1),
            ("\"./", 0),
        ] {
            assert_eq!(html.matches(part).count(), count, "{part}: {html}");
        }
        assert!(page("<html></html>", "", "", "", &[]).is_err());
    }

    #[test]
    fn large_pages_are_refused() {
        check_size([("place/scene.sog", 29_000_000)].into_iter()).unwrap();
        let files = [("place/scene.sog", 9_000_000), ("place/assets/wet.wmasset", 24_000_000)];
        let said = check_size(files.into_iter()).unwrap_err().to_string();
        let expected = "would have 44.0 MB, 12.0 MB of them the scene and 32.0 MB prepared data, and 40.0 MB are the most: ";
        assert!(said.contains(expected), "{said}");
    }
}
