//! A training in a browser: its curves, and a picture every few seconds while somebody looks.

use super::encode::jpeg;
use super::server::{self, ServerArgs, assets, refusal};
use anyhow::Result;
use axum::Router;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, put};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use wm_media::PictureSize;
use wm_media::color::{Dither, quantize_rgb8};
use wm_render::Frame;

/// Time between pictures, and how long after its last question a page counts as gone.
const PICTURE_EVERY: Duration = Duration::from_secs(3);
const GONE: Duration = Duration::from_secs(4);
/// Of JPEG.
const QUALITY: u8 = 88;

/// Through which camera the training is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Camera {
    /// That of a photo.
    #[default]
    Photo,
    /// One that swings to and fro before it.
    Orbit,
}

/// The state of the training, as the page reads it.
#[derive(Debug, Default, Serialize)]
struct Told {
    program: &'static str,
    dataset: String,
    photo: String,
    step: u32,
    steps: u32,
    splats: usize,
    seconds: f64,
    /// Step and mean loss.
    loss: Vec<(u32, f64)>,
    /// Step and PSNR of the held-out photos, dB.
    held_out: Vec<(u32, f64)>,
    /// Step and PSNR of the photo that is shown, dB.
    shown: Vec<(u32, f64)>,
    camera: Camera,
    /// The step of the picture.
    picture: Option<u32>,
    /// The result of the training, once it has ended.
    end: Option<String>,
}

#[derive(Default)]
struct Inside {
    told: Told,
    picture: Option<Bytes>,
    drawn: Option<Instant>,
    asked: Option<Instant>,
}

/// The state of a training and the requests of its page, shared by both.
#[derive(Clone, Default)]
pub struct Board(Arc<Mutex<Inside>>);

impl Board {
    /// Serves the page of a training of so many steps, and says where.
    ///
    /// # Errors
    /// Nothing can be listened on.
    pub fn serve(args: &ServerArgs, dataset: String, photo: String, steps: u32) -> Result<Self> {
        let told = Told {
            program: concat!("weather-magician ", env!("CARGO_PKG_VERSION")),
            dataset,
            photo,
            steps,
            ..Told::default()
        };
        let board = Self(Arc::new(Mutex::new(Inside { told, ..Inside::default() })));
        let router = assets! {
            Router::new(),
            "/" => "training.html", "text/html; charset=utf-8";
            "/style.css" => "style.css", "text/css";
            "/icon.svg" => "icon.svg", "image/svg+xml";
            "/training.js" => "training.js", "text/javascript";
            "/dom.js" => "dom.js", "text/javascript";
        };
        let router = router
            .route("/training", get(told_json))
            .route("/training/picture", get(picture))
            .route("/training/camera", put(set_camera))
            .with_state(board.clone());
        println!("the training is shown at {}", server::serve(args, router)?);
        Ok(board)
    }

    fn inside(&self) -> MutexGuard<'_, Inside> {
        // Nothing that is held here is left half done by a panic.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the number of steps that are done.
    pub fn step(&self, step: u32, splats: usize, seconds: f64) {
        let told = &mut self.inside().told;
        (told.step, told.splats, told.seconds) = (step, splats, seconds);
    }

    /// The mean loss until a step.
    pub fn loss(&self, step: u32, loss: f64) {
        self.inside().told.loss.push((step, loss));
    }

    /// PSNR of the held-out photos.
    pub fn held_out(&self, step: u32, psnr: f64) {
        self.inside().told.held_out.push((step, psnr));
    }

    /// The camera of a picture that is due, if somebody looks.
    pub fn wants(&self) -> Option<Camera> {
        let inside = self.inside();
        let is_watched = inside.asked.is_some_and(|asked| asked.elapsed() < GONE);
        let is_due = inside.drawn.is_none_or(|drawn| drawn.elapsed() > PICTURE_EVERY);
        (is_watched && is_due).then_some(inside.told.camera)
    }

    /// A picture, with its PSNR where it is that of a photo.
    ///
    /// # Errors
    /// It is too large for a JPEG.
    pub fn picture(&self, step: u32, frame: &Frame, psnr: Option<f64>) -> Result<()> {
        let size = (frame.width, frame.height);
        let bytes = quantize_rgb8(&frame.rgb, PictureSize::new(size.0, size.1), Dither::Ordered);
        let bytes = jpeg(&bytes, size, QUALITY)?;
        let mut inside = self.inside();
        (inside.picture, inside.drawn) = (Some(bytes.into()), Some(Instant::now()));
        inside.told.picture = Some(step);
        inside.told.shown.extend(psnr.map(|psnr| (step, psnr)));
        Ok(())
    }

    /// The training is over; who looks is told.
    pub fn end(&self, text: String) {
        let is_watched = {
            let mut inside = self.inside();
            inside.told.end = Some(text);
            inside.asked.is_some_and(|asked| asked.elapsed() < GONE)
        };
        if is_watched {
            // Pages ask once a second.
            std::thread::sleep(Duration::from_millis(2200));
        }
    }
}

async fn told_json(State(board): State<Board>) -> Response {
    let text = {
        let mut inside = board.inside();
        inside.asked = Some(Instant::now());
        serde_json::to_string(&inside.told).unwrap_or_default()
    };
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}

async fn picture(State(board): State<Board>) -> Response {
    match board.inside().picture.clone() {
        Some(bytes) => ([(header::CONTENT_TYPE, "image/jpeg")], bytes).into_response(),
        None => refusal(StatusCode::NOT_FOUND, "there is no picture yet"),
    }
}

async fn set_camera(State(board): State<Board>, body: Bytes) -> Response {
    match serde_json::from_slice(&body) {
        Ok(camera) => {
            let mut inside = board.inside();
            (inside.told.camera, inside.drawn) = (camera, None);
            refusal(StatusCode::OK, "changed")
        }
        Err(error) => {
            refusal(StatusCode::BAD_REQUEST, format!("camera: {error}; it is \"photo\" or \"orbit\""))
        }
    }
}
