//! The page of a training: its curves, and a rendered picture every few seconds while the page is
//! open.

use super::locked::locked;
use super::server::{self, ServerArgs, refusal};
use anyhow::Result;
use axum::Router;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, put};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};
use weather_magician::PictureSize;
use wm_image::color::{Dither, quantize_rgb8};
use wm_render::Frame;
use wm_viewer::encode::jpeg;
use wm_viewer::page::PageKind;

/// Time between pictures.
const PICTURE_EVERY: Duration = Duration::from_secs(3);
/// Time after its last request when a page counts as closed.
const CLOSED_AFTER: Duration = Duration::from_secs(4);
/// JPEG quality.
const QUALITY: u8 = 88;

/// Camera of the training's pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum TrainingCamera {
    /// The camera of a photo.
    #[default]
    Photo,
    /// A camera that swings around that of the photo.
    Orbit,
}

/// The state of the training, as the page reads it.
#[derive(Debug, Default, Serialize)]
struct TrainingStatus {
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
    camera: TrainingCamera,
    /// The step of the picture.
    picture: Option<u32>,
    /// The result of the training, once it has ended.
    end: Option<String>,
}

#[derive(Default)]
struct BoardState {
    status: TrainingStatus,
    picture: Option<Bytes>,
    drawn: Option<Instant>,
    asked: Option<Instant>,
}

/// The state of a training and the requests of its page, shared by both.
#[derive(Clone, Default)]
pub(crate) struct TrainingBoard(Arc<Mutex<BoardState>>);

impl TrainingBoard {
    /// Serves the page of a training with this number of steps, and prints its address.
    ///
    /// # Errors
    /// No port is free.
    pub(crate) fn serve(args: &ServerArgs, dataset: String, photo: String, steps: u32) -> Result<Self> {
        let status = TrainingStatus {
            program: wm_viewer::PROGRAM,
            dataset,
            photo,
            steps,
            ..TrainingStatus::default()
        };
        let board = Self(Arc::new(Mutex::new(BoardState { status, ..BoardState::default() })));
        let router = Router::new()
            .route("/training", get(status_json))
            .route("/training/picture", get(picture))
            .route("/training/camera", put(set_camera))
            .with_state(board.clone());
        println!("the training is shown at {}", server::serve(args, PageKind::Training, router)?);
        Ok(board)
    }

    fn lock(&self) -> MutexGuard<'_, BoardState> {
        // No critical section leaves the state half changed when it panics.
        locked(&self.0)
    }

    /// Sets the number of completed steps.
    pub(crate) fn set_step(&self, step: u32, splats: usize, seconds: f64) {
        let status = &mut self.lock().status;
        (status.step, status.splats, status.seconds) = (step, splats, seconds);
    }

    /// Adds a point to the curve of the mean loss.
    pub(crate) fn push_loss(&self, step: u32, loss: f64) {
        self.lock().status.loss.push((step, loss));
    }

    /// Adds a point to the curve of the held-out photos' PSNR, dB.
    pub(crate) fn push_held_out(&self, step: u32, psnr: f64) {
        self.lock().status.held_out.push((step, psnr));
    }

    /// Returns the camera of the next picture if one is due and the page is open.
    pub(crate) fn due_picture(&self) -> Option<TrainingCamera> {
        let state = self.lock();
        let is_watched = state.asked.is_some_and(|asked| asked.elapsed() < CLOSED_AFTER);
        let is_due = state.drawn.is_none_or(|drawn| drawn.elapsed() > PICTURE_EVERY);
        (is_watched && is_due).then_some(state.status.camera)
    }

    /// Sets the picture, with its PSNR if it shows a photo's view.
    ///
    /// # Errors
    /// The picture is too large for a JPEG.
    pub(crate) fn set_picture(&self, step: u32, frame: &Frame, psnr: Option<f64>) -> Result<()> {
        let size = (frame.width, frame.height);
        let bytes = quantize_rgb8(&frame.rgb, PictureSize::new(size.0, size.1), Dither::Ordered);
        let bytes = jpeg(&bytes, size, QUALITY)?;
        let mut state = self.lock();
        (state.picture, state.drawn) = (Some(bytes.into()), Some(Instant::now()));
        state.status.picture = Some(step);
        state.status.shown.extend(psnr.map(|psnr| (step, psnr)));
        Ok(())
    }

    /// Reports the end of the training to open pages.
    pub(crate) fn finish(&self, text: String) {
        let is_watched = {
            let mut state = self.lock();
            state.status.end = Some(text);
            state.asked.is_some_and(|asked| asked.elapsed() < CLOSED_AFTER)
        };
        if is_watched {
            // Pages poll once a second.
            std::thread::sleep(Duration::from_millis(2200));
        }
    }
}

async fn status_json(State(board): State<TrainingBoard>) -> Response {
    let text = {
        let mut state = board.lock();
        state.asked = Some(Instant::now());
        serde_json::to_string(&state.status).unwrap_or_default()
    };
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}

async fn picture(State(board): State<TrainingBoard>) -> Response {
    match board.lock().picture.clone() {
        Some(bytes) => ([(header::CONTENT_TYPE, "image/jpeg")], bytes).into_response(),
        None => refusal(StatusCode::NOT_FOUND, "there is no picture yet"),
    }
}

async fn set_camera(State(board): State<TrainingBoard>, body: Bytes) -> Response {
    match serde_json::from_slice(&body) {
        Ok(camera) => {
            let mut state = board.lock();
            (state.status.camera, state.drawn) = (camera, None);
            refusal(StatusCode::OK, "changed")
        }
        Err(error) => {
            refusal(StatusCode::BAD_REQUEST, format!("camera: {error}; it is \"photo\" or \"orbit\""))
        }
    }
}
