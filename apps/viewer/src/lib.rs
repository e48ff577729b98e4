//! The viewer without its server: everything about a picture in the browser that needs neither
//! sockets nor threads.
//!
//! The program serves the page and renders for it (`apps/cli/src/viewer/`); on a static page the same
//! code runs inside of the browser.
//!
//! - [`page::files_of`]: the files of a page.
//! - [`Catalog`]: the scene's facts, and the names that a page may use.
//! - [`ViewState`]: everything except the scene that a picture depends on, as JSON. [`View`] is one
//!   that was checked.
//! - [`ViewPainter`]: draws a view as bytes.
//! - [`link`]: a view as the fragment of an address, and back.
//! - [`SiteFile`]: the scene of a static page.
//!
//! Errors are values of one line.

pub mod catalog;
pub mod encode;
pub mod files;
mod lidar;
pub mod link;
pub mod pace;
pub mod page;
pub mod paint;
pub mod site;
pub mod state;
pub mod sweeps;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
mod text;
pub mod thumbnail;
mod view;

pub use catalog::Catalog;
pub use files::FileNames;
pub use paint::ViewPainter;
pub use site::SiteFile;
pub use state::ViewState;
pub use view::View;

/// The name of the program and its version.
pub const PROGRAM: &str = concat!("weather-magician ", env!("CARGO_PKG_VERSION"));
