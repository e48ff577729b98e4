//! A site of `export-web` in headless Chromium: the player draws what the program draws.
//!
//! `WM_WEB_PLAYER` names the folder of the built player (`tools/web-player`); with
//! `WM_REQUIRE_PLAYER=1` its lack is a failure.

use crate::common::{BYTE_STEP, Workshop, psnr};
use crate::viewer::page::click;
use crate::viewer::webdriver::Browser;
use crate::viewer::yard_scene;
use base64::prelude::{BASE64_STANDARD, Engine};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::time::Duration;
use weather_magician::{Patience, PlaceOptions, PreparedPlace, Renderer, Weather};
use wm_image::color::Dither;
use wm_scene::Scene;
use wm_scene::formats::{ReadOptions, read_scene};
use wm_viewer::View;
use wm_viewer::catalog::Catalog;
use wm_viewer::link;
use wm_viewer::paint::{PaintOptions, ViewPainter};
use wm_viewer::site::SiteFile;
use wm_viewer::state::{ViewState, weather_to_json};

/// Longest wait for a picture: a GPU in software makes its programs first.
const MAX_PICTURE_TIME: Duration = Duration::from_secs(400);
/// Least agreement of the pictures of the page with those of the program.
const MIN_PSNR_DB: f64 = 60.0;

/// The folder of the player; `None`, and says so, without one.
fn player() -> Option<PathBuf> {
    let folder = std::env::var_os("WM_WEB_PLAYER").map(PathBuf::from);
    if folder.is_none() {
        assert!(
            std::env::var_os("WM_REQUIRE_PLAYER").is_none_or(|v| v != "1"),
            "WM_WEB_PLAYER does not name the folder of the player: build it with tools/web-player"
        );
        println!(
            "skipped: WM_WEB_PLAYER does not name the folder of the player (tools/web-player builds it)"
        );
    }
    folder
}

/// The yard as a site, in a folder.
fn exported(player: &Path, options: &str) -> (Workshop, PathBuf) {
    let (workshop, _) = yard_scene();
    let words =
        format!("export-web yard.ply --device cpu --no-video --no-thumbnails --out site {options} --player");
    let made = workshop.command(&words).arg(player).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let folder = workshop.path("site");
    (workshop, folder)
}

/// Serves the files of a folder, as static hosts do; returns its address.
fn host(folder: PathBuf) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        for stream in listener.incoming().map_while(Result::ok) {
            let folder = folder.clone();
            std::thread::spawn(move || drop(answer(stream, &folder)));
        }
    });
    address
}

fn answer(mut stream: TcpStream, folder: &Path) -> std::io::Result<()> {
    let (mut request, mut part) = (Vec::new(), [0; 4096]);
    while !request.ends_with(b"\r\n\r\n") {
        let count = stream.read(&mut part)?;
        if count == 0 {
            return Ok(());
        }
        request.extend_from_slice(&part[..count]);
    }
    let request = String::from_utf8_lossy(&request).into_owned();
    let path = request.split(' ').nth(1).unwrap_or("/").split('?').next().unwrap_or("/");
    let path = if path == "/" { "/index.html" } else { path };
    let kind = match path.rsplit('.').next() {
        Some("html") => "text/html",
        Some("js") => "text/javascript",
        Some("css") => "text/css",
        Some("svg") => "image/svg+xml",
        Some("wasm") => "application/wasm",
        _ => "application/octet-stream",
    };
    let (status, bytes) = match std::fs::read(folder.join(path.trim_start_matches('/'))) {
        Ok(bytes) => ("200 OK", bytes),
        Err(_) => ("404 Not Found", Vec::new()),
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        bytes.len()
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(&bytes)
}

/// The yard as a site, and the place as the program has it.
struct Site {
    file: SiteFile,
    renderer: Renderer,
    place: PreparedPlace,
    painter: ViewPainter,
    catalog: Catalog,
}

impl Site {
    fn new(folder: &Path) -> Self {
        let file = std::fs::read_to_string(folder.join("place/place.json")).unwrap();
        let file = SiteFile::parse(&file).unwrap();
        let mut renderer = Renderer::cpu().unwrap();
        let read = read_scene(&folder.join("place").join(&file.scene), &ReadOptions::default()).unwrap();
        let scene = Scene { metadata: file.metadata.clone(), ..read };
        let place = renderer.load_with(scene, &PlaceOptions::default()).unwrap();
        let catalog = file.catalog(place.survey().clone(), renderer.describe()).unwrap();
        Self { file, renderer, place, painter: ViewPainter::default(), catalog }
    }

    /// The initial state in a preset.
    fn state(&self, preset: &str, time: f64) -> ViewState {
        let weather = weather_to_json(&Weather::preset(preset).unwrap());
        ViewState { weather, time, ..self.file.start.clone() }
    }

    /// The view of a link.
    fn view(&self, fragment: &str) -> View {
        link::open(fragment, &self.catalog, &self.file.start).unwrap()
    }

    /// The picture of the program for a state, of another size, px.
    fn drawn(&mut self, state: &ViewState, size: (u32, u32)) -> Vec<u8> {
        let state = ViewState { size: [size.0, size.1], ..state.clone() };
        let view = View::new(state, &self.catalog, None).unwrap();
        let options = PaintOptions { size, patience: Patience::Whole, dither: Dither::Ordered };
        let Self { renderer, place, painter, .. } = self;
        wm_render::at_once(painter.draw(renderer, place, &view, None, options)).unwrap().0
    }

    /// The likeness of the picture that the page shows for a state to that of the program, dB.
    fn likeness(&mut self, state: &ViewState, shown: &str) -> f64 {
        let png = BASE64_STANDARD.decode(shown.split(',').nth(1).unwrap()).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut shown = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut shown).unwrap();
        assert_eq!(info.color_type, png::ColorType::Rgba);
        let drawn = self.drawn(state, (info.width, info.height));
        let pixels = shown.as_chunks::<4>().0.iter().zip(drawn.as_chunks::<3>().0);
        let bytes = pixels.flat_map(|(shown, drawn)| shown.iter().zip(drawn));
        psnr(bytes.map(|(shown, drawn)| BYTE_STEP * (f64::from(*shown) - f64::from(*drawn))))
    }
}

/// The fragment of the link that the page shares, which is not the one that it was opened with.
fn share(browser: &Browser) -> String {
    browser.script("history.replaceState(null, '', location.pathname + location.search)");
    click(browser, "#share");
    browser.until("location.hash.length > 20");
    browser.script("return location.hash.slice(1)").as_str().unwrap().to_owned()
}

/// Opens a link in the page that is open.
fn follow(browser: &Browser, fragment: &str) -> String {
    browser.script(&format!(
        "document.getElementById('picture').dataset.settled = 'false'; location.hash = '{fragment}'"
    ));
    browser.picture_within(MAX_PICTURE_TIME)
}

#[test]
fn a_site_draws_what_the_program_draws() {
    let Some(player) = player() else { return };
    let (workshop, folder) = exported(&player, "--weather fog --size 96x64 --prepare snow-covered");
    let Some(browser) = Browser::with_webgpu(&workshop.path("")) else { return };
    let address = host(folder.clone());
    let mut site = Site::new(&folder);
    let weathers =
        [("fog", 0.0), ("moderate-rain", 1.5), ("snow", 2.0), ("snow-covered", 0.0), ("sunny", 0.0)];

    for (device, words) in [("gpu", "on GPU"), ("cpu", "on CPU")] {
        browser.open_at(&address, &format!("?device={device}"));
        let fog = browser.picture_within(MAX_PICTURE_TIME);
        let stats = browser.text("stats");
        assert!(stats.contains(words), "{stats}");
        let mut shown = Vec::new();
        for (preset, time) in weathers {
            let state = site.state(preset, time);
            let fragment = link::encode(&state).unwrap();
            let seen = follow(&browser, &fragment);
            let likeness = site.likeness(&state, &seen);
            println!("{device}, {preset}: {likeness:.1} dB");
            assert!(likeness > MIN_PSNR_DB, "{device}, {preset}: {likeness:.1} dB");
            shown.push((fragment, seen));
        }
        assert!(shown[0].1 == fog && shown[1].1 != fog, "{device}: the weather of a link is another");
        // A frame alone is that of before, and the link that is shared of it opens the same state
        // in another page.
        let (fragment, rain) = &shown[1];
        let mut shared = fragment.clone();
        for round in 0..2 {
            browser.open_at(&address, &format!("?device={device}&{round}#{shared}"));
            assert!(browser.picture_within(MAX_PICTURE_TIME) == *rain, "{device}: a frame alone is another");
            let before = std::mem::replace(&mut shared, share(&browser));
            // JavaScript writes 5.0 as 5, so the first one, which is no page's, may have other
            // digits.
            assert!(round == 0 || shared == before, "{device}: {shared} is not {before}");
        }
        let [shared, asked] = [&shared, fragment].map(|link| site.view(link));
        assert_eq!((shared.weather, shared.state.camera), (asked.weather, asked.state.camera), "{device}");
        assert_eq!(shared.state.time, asked.state.time, "{device}");
    }
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

#[test]
fn a_damaged_site_says_what_is_wrong_in_a_line() {
    let Some(player) = player() else { return };
    let (workshop, folder) = exported(&player, "--weather clear --size 48x32 --prepare none");
    let Some(browser) = Browser::with_webgpu(&workshop.path("")) else { return };
    let address = host(folder.clone());
    let [scene, place] = ["scene.sog", "place.json"].map(|name| folder.join("place").join(name));
    let whole = std::fs::read(&scene).unwrap();
    let cut = whole[..whole.len() / 2].to_vec();
    let mut flipped = whole.clone();
    flipped[whole.len() / 3..][..64].iter_mut().for_each(|byte| *byte ^= 0x5a);
    for (number, (path, bytes, says)) in [
        (&scene, Some(cut), "scene.sog"),
        (&scene, Some(flipped), "scene.sog"),
        (&scene, None, "scene.sog"),
        (&place, Some(b"{".to_vec()), "place.json"),
    ]
    .into_iter()
    .enumerate()
    {
        let before = std::fs::read(path).unwrap();
        match bytes {
            Some(bytes) => std::fs::write(path, bytes).unwrap(),
            None => std::fs::remove_file(path).unwrap(),
        }
        browser.open_at(&address, &format!("?device=cpu&{number}"));
        browser.until("document.body.dataset.failed");
        let text = browser.text("veil-text");
        assert!(text.contains(says) && !text.contains('\n') && text.len() < 400, "{text}");
        std::fs::write(path, before).unwrap();
    }
}

/// Browsers read WGSL more strictly than naga does.
#[test]
#[cfg(feature = "gpu")]
fn every_program_of_the_gpu_compiles_in_a_browser() {
    let folder = tempfile::tempdir().unwrap();
    let Some(browser) = Browser::with_webgpu(folder.path()) else { return };
    std::fs::write(folder.path().join("index.html"), "<!doctype html>").unwrap();
    let address = host(folder.path().to_owned());
    browser.open_at(&address, "");
    let texts: Vec<String> = wm_render::testing::program_texts()
        .into_iter()
        // In browsers subgroups are not used.
        .filter(|text| !text.contains("subgroupAny("))
        .collect();
    assert!(texts.len() > 30);
    for texts in texts.chunks(16) {
        let faults = browser.script(&format!(
            "const texts = {}; \
             return (async () => {{ \
               const adapter = await navigator.gpu.requestAdapter(); \
               const device = await adapter.requestDevice(); \
               const faults = []; \
               for (const code of texts) {{ \
                 const info = await device.createShaderModule({{ code }}).getCompilationInfo(); \
                 for (const m of info.messages) if (m.type === 'error') \
                   faults.push(m.message + ': ' + code.split('\\n').slice(m.lineNum - 1, m.lineNum + 1).join(' ')); \
               }} \
               return faults; }})()",
            serde_json::to_string(texts).unwrap()
        ));
        assert_eq!(faults, serde_json::json!([]));
    }
}
