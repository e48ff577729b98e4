//! The files of the pages, as they are served.
//!
//! A page consists of plain JavaScript modules, which are built into the program. The panels of the
//! page are made from the tables of the effects.

/// A page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PageKind {
    /// The page of a scene that the program serves.
    Server,
    /// The page of a scene that renders in the browser, without a server.
    Static,
    /// The page of a training that the program serves.
    Training,
}

/// A file of a page.
#[derive(Clone, Copy, Debug)]
pub struct PageFile {
    /// The path below the page's address. `index.html` is the page itself.
    pub path: &'static str,
    /// The content type.
    pub kind: &'static str,
    /// The content.
    pub text: &'static str,
    /// The pages that it belongs to.
    pages: &'static [PageKind],
}

/// The page that the program serves alone.
const SERVER: &[PageKind] = &[PageKind::Server];
/// The static page alone.
const STATIC: &[PageKind] = &[PageKind::Static];
/// The pages that the program serves.
const SERVED: &[PageKind] = &[PageKind::Server, PageKind::Training];
/// Both pages of a scene.
const SCENE: &[PageKind] = &[PageKind::Server, PageKind::Static];
/// The page of a training alone.
const TRAINING: &[PageKind] = &[PageKind::Training];
/// Every page.
const EVERY: &[PageKind] = &[PageKind::Server, PageKind::Static, PageKind::Training];

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css";
const JS: &str = "text/javascript";
const SVG: &str = "image/svg+xml";

/// A file of the folder `page/`: its path, and its name there if that is another.
macro_rules! file {
    ($path:literal, $kind:expr, $pages:expr) => {
        file!($path = $path, $kind, $pages)
    };
    ($path:literal = $name:literal, $kind:expr, $pages:expr) => {
        PageFile { path: $path, kind: $kind, text: include_str!(concat!("page/", $name)), pages: $pages }
    };
}

/// The files of all pages. A path may be there more than once, each time for other pages.
const FILES: &[PageFile] = &[
    file!("index.html", HTML, SCENE),
    file!("index.html" = "training.html", HTML, TRAINING),
    file!("style.css", CSS, EVERY),
    file!("icon.svg", SVG, EVERY),
    file!("dom.js", JS, EVERY),
    file!("dial.js", JS, SCENE),
    file!("backend.js" = "backend-server.js", JS, SERVER),
    file!("backend.js" = "backend-static.js", JS, STATIC),
    file!("worker.js", JS, STATIC),
    file!("align.js", JS, SCENE),
    file!("align.css", CSS, SCENE),
    file!("login.js", JS, SERVED),
    file!("main.js", JS, SCENE),
    file!("camera.js", JS, SCENE),
    file!("controls.js", JS, SCENE),
    file!("connection.js", JS, SCENE),
    file!("files.js", JS, SCENE),
    file!("lidar.js", JS, SCENE),
    file!("panels.js", JS, SCENE),
    file!("share.js", JS, SCENE),
    file!("single.js", JS, STATIC),
    file!("store.js", JS, SCENE),
    file!("tabs.js", JS, SCENE),
    file!("timeline.js", JS, SCENE),
    file!("tracks.js", JS, SCENE),
    file!("training.js", JS, TRAINING),
];

/// Returns the files of a page.
pub fn files_of(page: PageKind) -> impl Iterator<Item = &'static PageFile> {
    FILES.iter().filter(move |file| file.pages.contains(&page))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_are_whole_and_have_every_file_once() {
        for page in [PageKind::Server, PageKind::Static, PageKind::Training] {
            let mut paths: Vec<&str> = files_of(page).map(|file| file.path).collect();
            let count = paths.len();
            paths.sort_unstable();
            paths.dedup();
            assert!(count == paths.len() && paths.contains(&"index.html"), "{page:?}: {paths:?}");
            // Modules import files that the page has.
            for file in files_of(page) {
                let imports = file.text.split(" from \"./").skip(1).filter_map(|rest| rest.split('"').next());
                for import in imports {
                    assert!(paths.contains(&import), "{page:?}: {} imports {import}", file.path);
                }
            }
        }
    }
}
