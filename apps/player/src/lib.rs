//! The player of exported pages: what the program's server and render worker do for the viewer's
//! page, in the page's own worker.
//!
//! A module of WebAssembly with one class, [`Player`]. It fetches the files of a site through a
//! function of the page, draws views as the program does, and answers what the page asks: catalog,
//! links, files to save.
#![cfg(target_arch = "wasm32")]
#![allow(clippy::await_holding_refcell_ref)] // The engine is one call's at a time: `Player::engine` refuses a second one.

mod engine;
mod files;
mod page;

use engine::Engine;
use files::SiteFiles;
use page::{Page, failure};
use serde_json::{Value, json};
use std::cell::{Cell, RefCell, RefMut};
use std::sync::Arc;
use wasm_bindgen::prelude::*;
use wm_render::Device;
use wm_viewer::catalog::Catalog;
use wm_viewer::files::FileNames;
use wm_viewer::link;
use wm_viewer::site::SiteFile;
use wm_viewer::{View, ViewState};

/// Renders the scene of a site. What draws, [`Self::render`], [`Self::prepare`], [`Self::pick`] and
/// pictures of [`Self::file`], is called one after the other; the rest answers at any time.
#[wasm_bindgen]
pub struct Player {
    catalog: Arc<Catalog>,
    start: ViewState,
    device: String,
    /// The state of the last frame that was asked for: what a message leaves out keeps its value.
    last: RefCell<ViewState>,
    engine: RefCell<Engine>,
}

/// A frame: RGBA bytes and what is known of it.
#[wasm_bindgen]
pub struct PlayerFrame {
    head: String,
    width: u32,
    height: u32,
    pixels: Cell<Vec<u8>>,
    more: bool,
}

#[wasm_bindgen]
impl PlayerFrame {
    /// The header of a frame of the viewer, JSON.
    #[wasm_bindgen(getter)]
    pub fn head(&self) -> String {
        self.head.clone()
    }

    /// Width, px.
    #[wasm_bindgen(getter)]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height, px.
    #[wasm_bindgen(getter)]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The pixels, RGBA, row after row from the top. They can be taken once.
    #[wasm_bindgen(getter)]
    pub fn pixels(&self) -> Vec<u8> {
        self.pixels.take()
    }

    /// True if something is missing that [`Player::prepare`] makes or fetches.
    #[wasm_bindgen(getter)]
    pub fn more(&self) -> bool {
        self.more
    }
}

/// A file to save.
#[wasm_bindgen]
pub struct SavedFile {
    name: String,
    kind: String,
    bytes: Cell<Vec<u8>>,
}

#[wasm_bindgen]
impl SavedFile {
    /// The name of the file.
    #[wasm_bindgen(getter)]
    pub fn name(&self) -> String {
        self.name.clone()
    }

    /// The content type.
    #[wasm_bindgen(getter)]
    pub fn kind(&self) -> String {
        self.kind.clone()
    }

    /// The content. It can be taken once.
    #[wasm_bindgen(getter)]
    pub fn bytes(&self) -> Vec<u8> {
        self.bytes.take()
    }
}

#[wasm_bindgen]
impl Player {
    /// Opens the site: `fetch(name)` gives a promise of the bytes of a file below `place/`,
    /// `say(json)` takes messages of the viewer such as its status, `device` is `auto`, `gpu` or
    /// `cpu`.
    pub async fn open(
        fetch: js_sys::Function,
        say: js_sys::Function,
        device: String,
    ) -> Result<Player, JsValue> {
        let page = Page::new(say);
        page.report_panics();
        let device: Device = device.parse().map_err(failure)?;
        let files = SiteFiles::new(fetch);
        let text = files.fetch("place.json").await.map_err(failure)?;
        let text = String::from_utf8(text).map_err(|_| failure("place.json: is not UTF-8"))?;
        let site = SiteFile::parse(&text).map_err(failure)?;
        let engine = Engine::open(page, files.of_site(&site), &site, &device).await.map_err(failure)?;
        let survey = engine.survey().clone();
        let catalog = Arc::new(site.catalog(survey, engine.describe()).map_err(failure)?);
        let (start, device) = (site.start, engine.describe());
        Ok(Self { catalog, last: RefCell::new(start.clone()), start, device, engine: RefCell::new(engine) })
    }

    /// The renderer, in words.
    pub fn device(&self) -> String {
        self.device.clone()
    }

    /// The catalog and the initial state, JSON: what the server answers to `GET /parameters`.
    pub fn parameters(&self) -> String {
        self.catalog.json(&self.start).to_string()
    }

    /// Draws the view of a state, JSON, whose missing fields keep their value: a small draft of a
    /// view that is `moving`, else the whole picture, with the assets that there are.
    pub async fn render(&self, seq: f64, moving: bool, state: String) -> Result<PlayerFrame, JsValue> {
        let state = parsed(&state).and_then(|patch| self.last.borrow().patched(patch)).map_err(failure)?;
        let mut engine = self.engine()?;
        let view = engine.view(state, &self.catalog).map_err(failure)?;
        *self.last.borrow_mut() = view.state.clone();
        let drawn = engine.render(&view, seq as u64, moving).await.map_err(failure)?;
        let (width, height) = drawn.size;
        let pixels: Vec<u8> =
            drawn.rgb.as_chunks::<3>().0.iter().flat_map(|[r, g, b]| [*r, *g, *b, 255]).collect();
        let (head, pixels) = (drawn.head.to_string(), Cell::new(pixels));
        Ok(PlayerFrame { head, width, height, pixels, more: drawn.lacks })
    }

    /// Fetches or makes what the last frame lacked.
    pub async fn prepare(&self) -> Result<(), JsValue> {
        self.engine()?.prepare().await.map_err(failure)
    }

    /// The point of the scene at a point of the last picture, 0-1 of its sides, as JSON; `null`
    /// where there is nothing.
    pub async fn pick(&self, x: f64, y: f64) -> Result<String, JsValue> {
        let view = self.last_view()?;
        let point = self.engine()?.pick(&view, [x, y]).await.map_err(failure)?;
        Ok(json!(point).to_string())
    }

    /// A file to save of a state, JSON: `weather`, `camera`, `command`, or `picture`, a PNG file as
    /// `render` writes it.
    pub async fn file(&self, kind: String, state: String) -> Result<SavedFile, JsValue> {
        let view = self.view_of(&state).map_err(failure)?;
        let names = FileNames::of(&self.catalog, &view);
        if kind == "picture" {
            let bytes = self.engine()?.picture(&Arc::new(view)).await.map_err(failure)?;
            let bytes = Cell::new(bytes);
            return Ok(SavedFile { name: names.picture, kind: "image/png".to_owned(), bytes });
        }
        let saved = names.text(&kind, &self.catalog, &view).map_err(failure)?;
        let saved = saved.ok_or_else(|| failure("the files are weather, camera, command and picture"))?;
        let (kind, bytes) = (saved.kind.to_owned(), Cell::new(saved.text.into_bytes()));
        Ok(SavedFile { name: saved.name, kind, bytes })
    }

    /// The weather of a state, JSON, by the text of a weather file.
    pub fn weather(&self, text: &str) -> Result<String, JsValue> {
        Ok(self.catalog.read_weather(text).map_err(failure)?.to_string())
    }

    /// The fragment of a link to a state, JSON.
    pub fn link(&self, state: &str) -> Result<String, JsValue> {
        link::encode(&self.view_of(state).map_err(failure)?.state).map_err(failure)
    }

    /// The state of a link's fragment, JSON.
    pub fn unlink(&self, fragment: &str) -> Result<String, JsValue> {
        let view = link::open(fragment, &self.catalog, &self.start).map_err(failure)?;
        serde_json::to_string(&view.state).map_err(failure)
    }
}

impl Player {
    fn engine(&self) -> Result<RefMut<'_, Engine>, JsValue> {
        self.engine.try_borrow_mut().map_err(|_| failure("the player is drawing: ask when it is done"))
    }

    /// The view of a state, whose missing fields are those of the initial one.
    fn view_of(&self, state: &str) -> Result<View, String> {
        View::new(self.start.patched(parsed(state)?)?, &self.catalog, None)
    }

    fn last_view(&self) -> Result<View, JsValue> {
        View::new(self.last.borrow().clone(), &self.catalog, None).map_err(failure)
    }
}

fn parsed(text: &str) -> Result<Value, String> {
    serde_json::from_str(text).map_err(|error| format!("state: {error}"))
}
