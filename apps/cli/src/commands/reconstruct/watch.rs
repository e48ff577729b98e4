//! `--view`: shows the training in a browser, in builds with the viewer.

#[cfg(feature = "viewer")]
mod with_viewer {
    use crate::viewer::server::ServerArgs;
    use crate::viewer::training::{TrainingBoard, TrainingCamera};
    use anyhow::Result;
    use clap::Args;
    use glam::{DMat3, DVec3};
    use std::time::Instant;
    use wm_render::Frame;
    use wm_scene::Camera;

    /// Options of the training's page.
    #[derive(Args, Clone, Debug)]
    pub(crate) struct WatchArgs {
        /// Show the training in a browser: loss, PSNR and a picture every few seconds
        #[arg(long, help_heading = "Server")]
        view: bool,
        #[command(flatten)]
        server: ServerArgs,
    }

    impl WatchArgs {
        /// Checks the options before the work.
        pub(crate) fn check(&self) -> Result<()> {
            self.server.guard().map(drop)
        }

        /// Returns true if the training is to be shown.
        pub(crate) fn is_asked(&self) -> bool {
            self.view
        }
    }

    /// A training that is shown in a browser.
    pub(crate) struct TrainingView {
        board: Option<TrainingBoard>,
        started: Instant,
        /// The distance to the point about which the camera swings, scene units.
        reach: f64,
    }

    /// Period of a swing, seconds, and its amplitude, radians.
    const SWING: f64 = 60.0;
    const WIDTH: f64 = 0.35;

    impl TrainingView {
        /// Starts to serve the page of a training.
        pub(crate) fn new(
            args: &WatchArgs,
            dataset: String,
            photo: &str,
            steps: u32,
            reach: f64,
        ) -> Result<Self> {
            let serve = || TrainingBoard::serve(&args.server, dataset, photo.to_owned(), steps);
            let board = args.view.then(serve).transpose()?;
            Ok(Self { board, started: Instant::now(), reach })
        }

        /// Reports a completed step.
        pub(crate) fn step(&self, step: u32, splats: usize) {
            if let Some(board) = &self.board {
                board.set_step(step, splats, self.started.elapsed().as_secs_f64());
            }
        }

        /// Reports the mean loss at a step.
        pub(crate) fn loss(&self, step: u32, loss: f64) {
            self.board.iter().for_each(|board| board.push_loss(step, loss));
        }

        /// Reports the PSNR of the held-out photos, dB.
        pub(crate) fn held_out(&self, step: u32, psnr: f64) {
            self.board.iter().for_each(|board| board.push_held_out(step, psnr));
        }

        /// Returns the camera of the next picture if one is due; `photo` is the camera of the
        /// photo.
        pub(crate) fn due_picture(&self, photo: &Camera) -> Option<Camera> {
            match self.board.as_ref()?.due_picture()? {
                TrainingCamera::Photo => Some(*photo),
                TrainingCamera::Orbit => {
                    let phase = self.started.elapsed().as_secs_f64() / SWING * std::f64::consts::TAU;
                    Some(swing_camera(photo, self.reach, WIDTH * phase.sin()))
                }
            }
        }

        /// Reports a picture, with its PSNR if it shows the photo's view.
        pub(crate) fn picture(&self, step: u32, frame: &Frame, psnr: Option<f64>) -> Result<()> {
            self.board.as_ref().map_or(Ok(()), |board| board.set_picture(step, frame, psnr))
        }

        /// Reports the end of the training.
        pub(crate) fn end(&self, text: String) {
            self.board.iter().for_each(|board| board.finish(text.clone()));
        }
    }

    /// Rotates a camera by an angle, radians, about its own up direction around the point `reach`
    /// ahead of it.
    fn swing_camera(camera: &Camera, reach: f64, angle: f64) -> Camera {
        let pivot = camera.center() + camera.forward() * reach;
        let turn = DMat3::from_axis_angle(camera.up(), angle);
        let eye: DVec3 = pivot + turn * (camera.center() - pivot);
        let rotation = camera.rotation() * turn.transpose();
        Camera { viewmat: wm_scene::camera::viewmat_of(rotation, -(rotation * eye)), ..*camera }
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn a_swing_keeps_its_pivot_in_place() {
            let camera =
                Camera::looking((60, 40), 50.0, DVec3::new(1.0, -4.0, 2.0), DVec3::Z, DVec3::Z).unwrap();
            let pivot = camera.center() + camera.forward() * 3.0;
            let other = swing_camera(&camera, 3.0, 0.4);
            let [a, b] = [&camera, &other].map(|camera| camera.project(pivot).unwrap());
            assert!((a.0 - b.0).abs() < 1e-9 && (a.1 - b.1).abs() < 1e-9 && (a.2 - b.2).abs() < 1e-9);
            assert!((other.center().distance(camera.center()) - 6.0 * (0.2f64).sin()).abs() < 1e-9);
            assert_eq!(other.check(), Ok(()));
        }
    }
}

#[cfg(not(feature = "viewer"))]
mod without_viewer {
    use anyhow::Result;
    use clap::Args;
    use wm_render::Frame;
    use wm_scene::Camera;

    /// No options: this program has no viewer.
    #[derive(Args, Clone, Debug)]
    pub(crate) struct WatchArgs {}

    impl WatchArgs {
        pub(crate) fn check(&self) -> Result<()> {
            Ok(())
        }

        pub(crate) fn is_asked(&self) -> bool {
            false
        }
    }

    /// Does nothing: this program has no viewer.
    pub(crate) struct TrainingView;

    impl TrainingView {
        pub(crate) fn new(_: &WatchArgs, _: String, _: &str, _: u32, _: f64) -> Result<Self> {
            Ok(Self)
        }

        pub(crate) fn step(&self, _: u32, _: usize) {}

        pub(crate) fn loss(&self, _: u32, _: f64) {}

        pub(crate) fn held_out(&self, _: u32, _: f64) {}

        pub(crate) fn due_picture(&self, _: &Camera) -> Option<Camera> {
            None
        }

        pub(crate) fn picture(&self, _: u32, _: &Frame, _: Option<f64>) -> Result<()> {
            Ok(())
        }

        pub(crate) fn end(&self, _: String) {}
    }
}

#[cfg(feature = "viewer")]
pub(crate) use with_viewer::{TrainingView, WatchArgs};
#[cfg(not(feature = "viewer"))]
pub(crate) use without_viewer::{TrainingView, WatchArgs};
