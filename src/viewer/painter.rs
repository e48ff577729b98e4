//! The thread that draws: it alone has the scene, and does one thing after the other.
//!
//! What takes seconds to be made (what snow lies on, what roofs keep dry) is made on a thread beside it, while pictures go on without.

use super::Room;
use super::desk::{Drawn, Form, Order, Task, Turn};
use super::encode::{beside, jpeg, shown};
use super::state::{Output, View, ViewState};
use super::videos::{Video, Writer};
use crate::commands::render::camera::Shot;
use crate::interrupt;
use anyhow::{Context, Result, anyhow, bail};
use axum::body::Bytes;
use serde_json::json;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};
use weather_magician::assets::{Assets, MissingAssets};
use weather_magician::output::{ExtraPicture, PictureFormat, PictureLayer, PictureStyle, outputs};
use weather_magician::{
    FrameOptions, MovingCamera, Patience, Picture, PreparedPlace, Renderer, picture_tags,
};
use wm_media::color::Dither;
use wm_media::{PictureSize, video};
use wm_render::{Frame, Stats};
use wm_scene::Camera;
use wm_weather::{EffectRole, PreparedWeather, Weather};

/// How long it waits for a task before it looks whether it should end, or whether something is made.
const LOOK: Duration = Duration::from_millis(100);
/// A video gets a frame at least this often, whoever else wants something.
const FILM_EVERY: Duration = Duration::from_millis(500);
/// JPEG quality of pictures that move.
const DRAFT_QUALITY: u8 = 72;
/// Width and quality of the pictures of presets.
const THUMBNAIL: (u32, u8) = (224, 80);
/// Depth that has the middle colour, scene radii.
const HALF_DEPTH: f64 = 0.3;

/// See above.
pub struct Painter {
    room: Arc<Room>,
    renderer: Renderer,
    place: PreparedPlace,
    making: Option<Making>,
    /// Orders until what they take is made.
    waiting: Vec<Order>,
    film: Option<Film>,
    picture: Picture,
    clear: Frame,
}

/// What is missing, while it is made.
struct Making {
    receive: Receiver<Result<Assets, weather_magician::Error>>,
    /// The page that wants it, if one does.
    client: Option<u64>,
}

/// A video that is being rendered.
struct Film {
    view: Arc<View>,
    shot: Shot,
    video: Arc<Video>,
    writer: Writer,
    next: u32,
    last: Instant,
}

impl Output {
    /// As `--also` names it; the colour is there anyway.
    fn also(self) -> Option<ExtraPicture> {
        let kind = match self {
            Self::Rgb => return None,
            Self::Depth => PictureLayer::Depth,
            Self::Normal => PictureLayer::Normal,
            Self::Alpha => PictureLayer::Alpha,
        };
        Some(ExtraPicture { kind, format: None })
    }
}

impl Painter {
    /// A worker that draws a place.
    pub fn new(room: Arc<Room>, renderer: Renderer, place: PreparedPlace) -> Self {
        Self {
            room,
            renderer,
            place,
            making: None,
            waiting: Vec::new(),
            film: None,
            picture: Picture::default(),
            clear: Frame::default(),
        }
    }

    /// Draws until Ctrl-C.
    ///
    /// # Errors
    /// What leaves nothing to draw with.
    pub fn work(&mut self) -> Result<()> {
        while !interrupt::asked() {
            self.take_made()?;
            let is_due = self.film.as_ref().is_some_and(|film| film.last.elapsed() > FILM_EVERY);
            if is_due {
                self.film_on();
                continue;
            }
            let patience = if self.film.is_some() && self.making.is_none() { Duration::ZERO } else { LOOK };
            match self.room.desk.next(patience) {
                Some(Task::Turn(turn)) => self.serve(turn)?,
                Some(Task::Order(order)) => self.fill(order)?,
                None => self.film_on(),
            }
        }
        Ok(())
    }

    /// Takes what was made meanwhile.
    fn take_made(&mut self) -> Result<()> {
        let Some(making) = &self.making else { return Ok(()) };
        match making.receive.try_recv() {
            Err(TryRecvError::Empty) => return Ok(()),
            Err(TryRecvError::Disconnected) => {
                bail!("what the weather needs to know of the place could not be found")
            }
            Ok(made) => self.renderer.insert_assets(&mut self.place, made?)?,
        }
        let client = self.making.take().and_then(|making| making.client);
        self.room.desk.tell_all(&json!({ "type": "status", "text": "" }).to_string());
        self.room.desk.go_on(client);
        for order in std::mem::take(&mut self.waiting) {
            self.fill(order)?;
        }
        Ok(())
    }

    /// Whether all is there for an instant of a weather; else it is made from now on, and said.
    fn is_ready(&mut self, weather: &Weather, time: f64, client: Option<u64>) -> Result<bool> {
        let missing = self.place.missing_assets(weather, time);
        let is_ready = missing.is_empty();
        if !is_ready && self.making.is_none() {
            self.make(missing, client)?;
        }
        Ok(is_ready)
    }

    /// Makes what is missing, and says so.
    fn make(&mut self, missing: MissingAssets, client: Option<u64>) -> Result<()> {
        self.room.desk.tell_all(&json!({ "type": "status", "text": missing.description() }).to_string());
        self.make_silently(missing, client)
    }

    fn make_silently(&mut self, mut missing: MissingAssets, client: Option<u64>) -> Result<()> {
        let source = self.renderer.asset_source(&mut self.place, &mut missing)?;
        let (send, receive) = channel();
        let room = Arc::clone(&self.room);
        std::thread::Builder::new().name("prepare".into()).spawn(move || {
            // The painter may be gone.
            let _ = send.send(missing.make(source, &mut ()));
            room.desk.wake();
        })?;
        self.making = Some(Making { receive, client });
        Ok(())
    }

    /// Draws what a client wants.
    fn serve(&mut self, turn: Turn) -> Result<()> {
        let Turn { client, wish, outbox, small } = turn;
        let (view, started) = (&wish.view, Instant::now());
        let (weather, time) = (&view.weather, view.state.time);
        let is_ready = if wish.is_moving {
            // What is made quickly follows what moves, a little later.
            let missing = self.place.missing_assets(weather, time);
            if missing.is_quick() && self.making.is_none() {
                self.make(missing, None)?;
            }
            false
        } else {
            self.is_ready(weather, time, Some(client))?
        };
        let full = (view.state.size[0], view.state.size[1]);
        let (size, patience, quality, dither) = match (wish.is_moving, is_ready) {
            (true, _) => (small, Patience::Draft, DRAFT_QUALITY, Dither::Off),
            (false, false) => (full, Patience::Draft, view.state.quality, Dither::Ordered),
            (false, true) => (full, Patience::Whole, view.state.quality, Dither::Ordered),
        };
        let drawn = self.draw(view, size, patience, dither);
        let message = drawn.and_then(|(rgb, stats)| {
            let drew = started.elapsed().as_secs_f64();
            let jpeg = jpeg(&rgb, size, quality)?;
            let took = started.elapsed().as_secs_f64();
            let head = self.head(&wish.view, wish.seq, size, is_ready, &stats, [drew, took - drew]);
            Ok(framed(&head, &jpeg))
        });
        match message {
            Ok(message) => outbox.picture(message),
            Err(error) => outbox.note(json!({ "type": "error", "text": format!("{error:#}") }).to_string()),
        }
        let outcome = match (wish.is_moving, is_ready) {
            (true, _) => Drawn::Moving(started.elapsed().as_secs_f64()),
            (false, false) => Drawn::Waiting,
            (false, true) => Drawn::Whole,
        };
        self.room.desk.drawn(client, wish.seq, outcome);
        Ok(())
    }

    /// Draws a view as bytes `[H, W, 3]`, with the part left of its divider clear.
    fn draw(
        &mut self,
        view: &View,
        size: (u32, u32),
        patience: Patience,
        dither: Dither,
    ) -> Result<(Vec<u8>, Stats)> {
        let ViewState { time, output, divider, .. } = view.state;
        self.place.config.outputs = outputs(output.also().as_slice());
        let camera = view.shot_of(size).moving(time, self.place.site().metres_per_unit);
        let options = FrameOptions { patience, ..FrameOptions::new(time, camera) };
        let half = HALF_DEPTH * self.place.survey().radius;
        let Some(share) = divider else {
            let stats = self.render(view, &options)?;
            return Ok((shown(&self.picture.frame, output, half, dither), stats));
        };
        let (camera, cut) = (&camera.camera, (share * f64::from(size.0)).round() as u32);
        let (mut left, mut right, mut stats) = (Vec::new(), Vec::new(), Stats::default());
        if cut > 0 {
            stats += self.renderer.render_clear(&self.place, &columns(camera, 0, cut), &mut self.clear)?;
            left = shown(&self.clear, output, half, dither);
        }
        if cut < size.0 {
            let camera = MovingCamera { camera: columns(camera, cut, size.0 - cut), ..options.camera };
            stats += self.render(view, &FrameOptions { camera, ..options })?;
            right = shown(&self.picture.frame, output, half, dither);
        }
        Ok((beside((&left, cut), (&right, size.0 - cut)), stats))
    }

    /// Renders a frame of a view's weather.
    fn render(&mut self, view: &View, options: &FrameOptions<'_>) -> Result<Stats> {
        let Self { renderer, place, picture, .. } = self;
        Ok(renderer.render_into(place, &view.weather, options, picture, &mut ())?)
    }

    /// What is said with a picture.
    fn head(
        &self,
        view: &View,
        seq: u64,
        size: (u32, u32),
        is_whole: bool,
        stats: &Stats,
        [draw, encode]: [f64; 2],
    ) -> String {
        let time = view.state.time;
        let sky: PreparedWeather = view.weather.at(time).prepare(self.place.site());
        let camera = view.shot().camera(time);
        let mor = sky.air.mor_at(camera.center().to_array());
        let rate = |name: &str| -> f64 {
            sky.falling().iter().filter(|fall| fall.kind.name == name).map(|fall| fall.rate).sum()
        };
        let falls: serde_json::Map<String, serde_json::Value> =
            sky.falling().iter().map(|fall| (fall.kind.name.to_owned(), fall.rate.into())).collect();
        json!({
            "seq": seq, "width": size.0, "height": size.1, "whole": is_whole, "time": time,
            "draw_ms": draw * 1e3, "encode_ms": encode * 1e3,
            "splats": stats.visible, "drops": stats.particles,
            "mor": mor.is_finite().then_some(mor), "rain": rate("rain"), "snow": rate("snow"), "falls": falls,
            "camera": super::state::Pose::of(&camera),
        })
        .to_string()
    }

    /// Fills an order, now or when what it takes is there.
    fn fill(&mut self, order: Order) -> Result<()> {
        let waits = match &order {
            Order::Picture { view, .. } => !self.is_ready(&view.weather, view.state.time, None)?,
            Order::Pick { .. } | Order::Video { .. } | Order::Thumbnail(_) => false,
        };
        if waits {
            self.waiting.push(order);
            return Ok(());
        }
        match order {
            Order::Picture { view, form, reply } => {
                let bytes = match form {
                    Form::Png => self.png(&view),
                    Form::Jpeg => self.jpeg(&view),
                };
                // Who asked may be gone.
                let _ = reply.send(bytes.map(Bytes::from).map_err(|error| format!("{error:#}")));
            }
            Order::Pick { view, at, outbox } => {
                let point = self.pick(&view, at)?;
                outbox.note(json!({ "type": "picked", "point": point }).to_string());
            }
            Order::Video { view, job } => {
                if let Err(error) = self.start(&view, &job) {
                    job.end(Err(format!("{error:#}")));
                }
            }
            Order::Thumbnail(name) => self.thumbnail(name)?,
        }
        Ok(())
    }

    fn jpeg(&mut self, view: &View) -> Result<Vec<u8>> {
        let size = (view.state.size[0], view.state.size[1]);
        let (rgb, _) = self.draw(view, size, Patience::Whole, Dither::Ordered)?;
        jpeg(&rgb, size, view.state.quality)
    }

    /// The file that `render` writes.
    fn png(&mut self, view: &View) -> Result<Vec<u8>> {
        let (time, output) = (view.state.time, view.state.output);
        self.place.config.outputs = outputs(output.also().as_slice());
        let shot = view.shot();
        let camera = shot.moving(time, self.place.site().metres_per_unit);
        self.render(view, &FrameOptions::new(time, camera))?;
        let style = self.style(view, &shot, time);
        let folder = tempfile::tempdir().context("no room for a picture")?;
        let path = folder.path().join("picture.png");
        match output.also() {
            None => _ = style.write(&self.picture, &path)?,
            Some(ExtraPicture { kind, .. }) => {
                let size = PictureSize::new(view.state.size[0], view.state.size[1]);
                style.write_one(kind, PictureFormat::Png, &self.picture, size, &path)?;
            }
        }
        Ok(std::fs::read(&path)?)
    }

    fn style(&self, view: &View, shot: &Shot, time: f64) -> PictureStyle {
        let (scene, site) = (&self.room.catalog().words[0], self.place.site());
        let camera = shot.camera(time);
        PictureStyle {
            metres_per_unit: site.metres_per_unit,
            tags: picture_tags(scene, site, self.renderer.backend(), &view.weather, time, &camera),
            ..PictureStyle::default()
        }
    }

    /// The point of the scene that is seen at a place of the picture; `None` where there is nothing.
    fn pick(&mut self, view: &View, [x, y]: [f64; 2]) -> Result<Option<[f64; 3]>> {
        let [width, height] = view.state.size.map(|side| (side / 4).max(1));
        let camera = view.shot_of((width, height)).camera(view.state.time);
        self.place.config.outputs = outputs(Output::Depth.also().as_slice());
        self.renderer.render_clear(&self.place, &camera, &mut self.clear)?;
        let [column, row] =
            [(x, width), (y, height)].map(|(share, side)| ((share * f64::from(side)) as u32).min(side - 1));
        let depth = self.clear.depth[self.clear.index(column, row)];
        let ray = camera.ray(f64::from(column) + 0.5, f64::from(row) + 0.5);
        let reach = f64::from(depth) / ray.dot(camera.forward());
        Ok((depth > 0.0).then(|| (camera.center() + ray * reach).to_array()))
    }

    fn thumbnail(&mut self, name: String) -> Result<()> {
        let Ok(mut weather) = Weather::preset(&name) else { return Ok(()) };
        if weather.has(EffectRole::Lies) {
            // What lies in still air serves them all.
            weather.set_text("wind=off").context("wind is an effect")?;
        }
        let breaks = weather.effects().flat_map(|(_, tracks)| tracks).flat_map(wm_weather::Track::breaks);
        // Where most of it has happened.
        let time = 0.8 * breaks.fold(0.0, f64::max);
        let missing = self.place.missing_assets(&weather, time);
        let is_whole = missing.is_empty();
        if !is_whole && !self.place.has_similar(&missing) {
            if self.making.is_none() {
                self.make_silently(missing, None)?;
            }
            self.waiting.push(Order::Thumbnail(name));
            return Ok(());
        }
        let state = self.room.start();
        let [width, height] = state.size;
        let height = (f64::from(THUMBNAIL.0 * height) / f64::from(width)).round().clamp(1.0, 1024.0) as u32;
        let weather_json = super::state::weather_to_json(&weather);
        let state = ViewState { weather: weather_json, time, divider: None, ..state };
        let view = View::new(state, self.room.catalog(), None).map_err(|error| anyhow!(error))?;
        let size = (THUMBNAIL.0, height);
        let patience = if is_whole { Patience::Whole } else { Patience::Draft };
        let (rgb, _) = self.draw(&view, size, patience, Dither::Ordered)?;
        let bytes = jpeg(&rgb, size, THUMBNAIL.1)?;
        self.room.keep_thumbnail(name.clone(), bytes.into());
        self.room.desk.tell_all(&json!({ "type": "thumbnail", "name": name }).to_string());
        Ok(())
    }

    fn start(&mut self, view: &Arc<View>, video: &Arc<Video>) -> Result<()> {
        let shot = view.shot();
        let [width, height] = view.state.size;
        let mut settings = video::VideoSettings::new(PictureSize::new(width, height), video.rate);
        settings.tags = self.style(view, &shot, 0.0).tags;
        let writer = Writer::new(video::create_video(&video.path(), settings)?, video);
        let (view, video) = (Arc::clone(view), Arc::clone(video));
        self.film = Some(Film { view, shot, video, writer, next: 0, last: Instant::now() });
        Ok(())
    }

    /// Renders the next frame of the video, if there is one.
    fn film_on(&mut self) {
        let Some(mut film) = self.film.take() else { return };
        film.last = Instant::now();
        if !film.video.is_stopped() && film.next < film.video.frames {
            match self.film_frame(&mut film) {
                Ok(true) => return self.film = Some(film),
                // The writer ended, and says why.
                Ok(false) => {}
                Err(error) => return film.video.end(Err(format!("{error:#}"))),
            }
        }
        film.video.end(film.writer.finish());
    }

    /// Whether the video goes on.
    fn film_frame(&mut self, film: &mut Film) -> Result<bool> {
        let time = film.video.rate.seconds(u64::from(film.next));
        if !self.is_ready(&film.view.weather, time, None)? {
            return Ok(true);
        }
        self.place.config.outputs = outputs(Output::Rgb.also().as_slice());
        let mut picture = film.writer.blank();
        let camera = film.shot.moving(time, self.place.site().metres_per_unit);
        let options = FrameOptions::new(time, camera);
        let Self { renderer, place, .. } = self;
        renderer.render_into(place, &film.view.weather, &options, &mut picture, &mut ())?;
        film.next += 1;
        Ok(film.writer.add(picture))
    }
}

/// The part of a camera's picture from a column on.
fn columns(camera: &Camera, first: u32, width: u32) -> Camera {
    Camera { width, cx: camera.cx - f64::from(first), ..*camera }
}

/// A message: the length of its head, the head, the picture.
fn framed(head: &str, jpeg: &[u8]) -> Bytes {
    let length = u32::try_from(head.len()).unwrap_or(0).to_le_bytes();
    Bytes::from([&length, head.as_bytes(), jpeg].concat())
}
