//! The page of a training: its curves, and a rendered picture every few seconds while the page is
//! open.

use super::locked::locked;
use super::server::{self, ServerArgs, refusal};
use crate::training_page::TrainingPage;
use anyhow::Result;
use axum::Router;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, put};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};
use weather_magician::Camera;
use weather_magician::train::session::{
    HeldOutScores, ImageMoment, ObserverError, StepProgress, StepSummary, TrainImage, TrainObserver,
    TrainStart,
};
use wm_viewer::encode::frame_jpeg;
use wm_viewer::page::PageKind;

/// Time between pictures.
const PICTURE_EVERY: Duration = Duration::from_secs(3);
/// Time after its last request when a page counts as closed.
const CLOSED_AFTER: Duration = Duration::from_secs(4);
const JPEG_QUALITY: u8 = 88;
const SWING_PERIOD_S: f64 = 60.0;
const SWING_AMPLITUDE_RAD: f64 = 0.35;

/// Camera of the training's pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum TrainingCamera {
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
struct TrainingBoard(Arc<Mutex<BoardState>>);

impl TrainingBoard {
    fn lock(&self) -> MutexGuard<'_, BoardState> {
        // No critical section leaves the state half changed when it panics.
        locked(&self.0)
    }
}

impl BoardState {
    /// Returns true if the page is open.
    fn is_watched(&self) -> bool {
        self.asked.is_some_and(|asked| asked.elapsed() < CLOSED_AFTER)
    }
}

/// A training whose page is served.
pub(crate) struct ServedTraining {
    board: TrainingBoard,
    started: Instant,
    /// The distance to the point about which the camera swings, scene units.
    reach: f64,
}

impl ServedTraining {
    /// Serves the page of a training, and prints its address.
    ///
    /// # Errors
    /// No port is free.
    pub(crate) fn serve(args: &ServerArgs, dataset: String, start: &TrainStart<'_>) -> Result<Self> {
        let status = TrainingStatus {
            program: wm_viewer::PROGRAM,
            dataset,
            photo: start.photo.to_owned(),
            steps: start.steps,
            ..TrainingStatus::default()
        };
        let board = TrainingBoard(Arc::new(Mutex::new(BoardState { status, ..BoardState::default() })));
        let router = Router::new()
            .route("/training", get(status_json))
            .route("/training/picture", get(picture))
            .route("/training/camera", put(set_camera))
            .with_state(board.clone());
        println!("the training is shown at {}", server::serve(args, PageKind::Training, router)?);
        Ok(Self { board, started: Instant::now(), reach: start.extent })
    }
}

impl TrainObserver for ServedTraining {
    fn on_step(&mut self, progress: &StepProgress) {
        let status = &mut self.board.lock().status;
        (status.step, status.splats) = (progress.step, progress.splats);
        status.seconds = self.started.elapsed().as_secs_f64();
    }

    fn on_summary(&mut self, summary: &StepSummary) {
        self.board.lock().status.loss.push((summary.step, summary.loss));
    }

    fn on_evaluation(&mut self, scores: &HeldOutScores) {
        self.board.lock().status.held_out.extend(scores.mean().map(|mean| (scores.step, mean.psnr)));
    }

    /// Wants a picture if one is due and the page is open.
    fn wants_image(&mut self, _: ImageMoment, photo: &Camera) -> Option<Camera> {
        let state = self.board.lock();
        let is_due = state.drawn.is_none_or(|drawn| drawn.elapsed() > PICTURE_EVERY);
        (state.is_watched() && is_due).then(|| match state.status.camera {
            TrainingCamera::Photo => *photo,
            TrainingCamera::Orbit => {
                let phase = self.started.elapsed().as_secs_f64() / SWING_PERIOD_S * std::f64::consts::TAU;
                swing_camera(photo, self.reach, SWING_AMPLITUDE_RAD * phase.sin())
            }
        })
    }

    fn on_image(&mut self, image: &TrainImage<'_>) -> Result<(), ObserverError> {
        let TrainImage { step, frame, psnr, .. } = *image;
        let bytes = frame_jpeg(frame, JPEG_QUALITY)?;
        let mut state = self.board.lock();
        (state.picture, state.drawn) = (Some(bytes.into()), Some(Instant::now()));
        state.status.picture = Some(step);
        state.status.shown.extend(psnr.map(|psnr| (step, psnr)));
        Ok(())
    }
}

impl TrainingPage for ServedTraining {
    fn end(&self, text: String) {
        let mut state = self.board.lock();
        state.status.end = Some(text);
        let is_watched = state.is_watched();
        drop(state);
        if is_watched {
            // Pages poll once a second.
            std::thread::sleep(Duration::from_millis(2200));
        }
    }
}

/// Rotates a camera by an angle, radians, about its own up direction around the point `reach` ahead
/// of it.
fn swing_camera(camera: &Camera, reach: f64, angle: f64) -> Camera {
    let pivot = camera.center() + camera.forward() * reach;
    let turn = DMat3::from_axis_angle(camera.up(), angle);
    let eye: DVec3 = pivot + turn * (camera.center() - pivot);
    let rotation = camera.rotation() * turn.transpose();
    Camera { viewmat: wm_scene::camera::viewmat_of(rotation, -(rotation * eye)), ..*camera }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swing_keeps_its_pivot_in_place() {
        let camera = Camera::looking((60, 40), 50.0, DVec3::new(1.0, -4.0, 2.0), DVec3::Z, DVec3::Z).unwrap();
        let pivot = camera.center() + camera.forward() * 3.0;
        let other = swing_camera(&camera, 3.0, 0.4);
        let [a, b] = [&camera, &other].map(|camera| camera.project(pivot).unwrap());
        assert!((a.0 - b.0).abs() < 1e-9 && (a.1 - b.1).abs() < 1e-9 && (a.2 - b.2).abs() < 1e-9);
        assert!((other.center().distance(camera.center()) - 6.0 * (0.2f64).sin()).abs() < 1e-9);
        assert_eq!(other.check(), Ok(()));
    }
}
