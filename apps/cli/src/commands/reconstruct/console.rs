//! The observer of `reconstruct`: draws progress, prints, writes previews and feeds the page in a
//! browser.

use super::watch::WatchArgs;
use crate::interrupt;
use crate::progress;
use crate::training_page::TrainingPage;
use indicatif::ProgressBar;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use weather_magician::train::StepTimes;
use weather_magician::train::colmap;
use weather_magician::train::session::{
    HeldOutScores, ImageMoment, MOVERS_FILE, MoverOutcome, ObserverError, Preparation, StepProgress,
    StepSummary, TrainImage, TrainNotice, TrainObserver, TrainReport, TrainStart, TrainWarning,
};
use weather_magician::train::video::VideoProgress;
use weather_magician::{Camera, PictureSize};
use wm_image::{color::Dither, png};

/// Shows a training on the terminal, in the run folder and in a browser.
pub(crate) struct TrainingConsole<'a> {
    dataset: &'a Path,
    watch_args: &'a WatchArgs,
    folder: PathBuf,
    colmap: Option<colmap::ColmapStep>,
    bar: Option<ProgressBar>,
    watch: Option<Box<dyn TrainingPage>>,
    splats: usize,
}

impl<'a> TrainingConsole<'a> {
    /// Returns the observer of a training of `dataset` in the run folder `folder`.
    pub(crate) fn new(dataset: &'a Path, watch_args: &'a WatchArgs, folder: &Path) -> Self {
        let folder = folder.to_owned();
        Self { dataset, watch_args, folder, colmap: None, bar: None, watch: None, splats: 0 }
    }

    /// Removes the progress bar.
    pub(crate) fn clear(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }

    /// Tells the page in the browser that the training is done.
    pub(crate) fn end(&self, out: &Path) {
        if let Some(watch) = &self.watch {
            watch.end(format!("Done: {}, {} splats", out.display(), self.splats));
        }
    }
}

impl TrainObserver for TrainingConsole<'_> {
    fn proceed(&mut self) -> ControlFlow<()> {
        interrupt::flow()
    }

    fn on_warning(&mut self, warning: &TrainWarning) {
        match warning {
            TrainWarning::ManyPhotos { photos, most } => eprintln!(
                "geometry: {photos} photos are more than the {most} for which depth is estimated by default; --priors photos \
                 does it, in about a second per photo, or `weather-magician priors` once for all trainings"
            ),
            warning => eprintln!("warning: {warning}"),
        }
    }

    fn on_notice(&mut self, notice: &TrainNotice) {
        match notice {
            TrainNotice::FramesChosen(_) | TrainNotice::PriorsMade(_) => {
                self.clear();
                eprintln!("{notice}");
            }
            TrainNotice::FewerSteps { .. } => eprintln!("{notice} (--steps sets another number)"),
            TrainNotice::Movers { outcome: MoverOutcome::Found { .. }, .. } => {
                eprintln!("{notice}: {}", self.folder.join(MOVERS_FILE).display());
            }
            TrainNotice::Movers { outcome: MoverOutcome::None | MoverOutcome::TooFewJudged(_), .. } => {}
            TrainNotice::Haze(_) => eprintln!("{notice} (--haze keep leaves it in)"),
            notice => eprintln!("{notice}"),
        }
    }

    fn on_preparation(&mut self, preparation: &Preparation) {
        match preparation {
            Preparation::Video(VideoProgress { done, total }) => {
                let bar = self.bar.get_or_insert_with(|| progress::bar(0, "frames of the video"));
                bar.set_length(total.unwrap_or(0).max(*done) as u64);
                bar.set_position(*done as u64);
            }
            Preparation::Colmap(progress) => {
                if self.colmap.replace(progress.step) != Some(progress.step) {
                    eprintln!("colmap: {}", progress.step.name());
                }
            }
            Preparation::Priors { done, total } => {
                let bar = self.bar.get_or_insert_with(|| progress::bar(*total as u64, "passes of stereo"));
                bar.set_position(*done as u64);
            }
        }
    }

    fn on_start(&mut self, start: &TrainStart<'_>) -> Result<(), ObserverError> {
        self.clear();
        let dataset = self.dataset.display().to_string();
        self.watch = self.watch_args.page(dataset, start)?;
        let bar = progress::bar(u64::from(start.steps), "steps");
        bar.set_position(u64::from(start.step));
        bar.reset_eta();
        self.bar = Some(bar);
        Ok(())
    }

    fn on_step(&mut self, progress: &StepProgress) {
        self.splats = progress.splats;
        if let Some(bar) = &self.bar {
            bar.set_position(u64::from(progress.step));
        }
        self.watch.iter_mut().for_each(|watch| watch.on_step(progress));
    }

    fn on_summary(&mut self, summary: &StepSummary) {
        let StepSummary { loss, splats, held_out_psnr, .. } = summary;
        self.watch.iter_mut().for_each(|watch| watch.on_summary(summary));
        if let Some(bar) = &self.bar {
            let held_out = held_out_psnr.map_or_else(String::new, |psnr| format!(", held-out {psnr:.2} dB"));
            bar.set_message(format!("loss {loss:.4}, {splats} splats{held_out}"));
        }
    }

    fn on_evaluation(&mut self, scores: &HeldOutScores) {
        self.watch.iter_mut().for_each(|watch| watch.on_evaluation(scores));
    }

    fn wants_image(&mut self, moment: ImageMoment, photo: &Camera) -> Option<Camera> {
        match moment {
            ImageMoment::Step => self.watch.as_mut()?.wants_image(moment, photo),
            ImageMoment::Milestone => Some(*photo),
        }
    }

    fn on_image(&mut self, image: &TrainImage<'_>) -> Result<(), ObserverError> {
        match (image.moment, &mut self.watch) {
            (ImageMoment::Step, Some(watch)) => watch.on_image(image)?,
            (ImageMoment::Step, None) => {}
            (ImageMoment::Milestone, _) => {
                let path = self.folder.join(format!("preview-{:06}.png", image.step));
                let tags = [("photo".to_owned(), image.photo.to_owned())];
                let size = PictureSize::new(image.camera.width, image.camera.height);
                png::write_rgb(&path, &image.frame.rgb, size, Dither::Ordered, &tags)?;
            }
        }
        Ok(())
    }

    fn on_finish(&mut self, report: &TrainReport) {
        self.clear();
        if report.steps > 0 {
            let ms = |part: f64| part * 1e3 / f64::from(report.steps);
            let StepTimes { forward, loss, backward, own, optimizer, densify } = report.times;
            println!(
                "{} steps in {:.1} s on {}, {:.1} ms each: forward {:.1}, loss {:.1}, backward {:.1}, renders of terms {:.1}, \
                 optimiser {:.1}, densify {:.1}, photos and the rest {:.1}",
                report.steps,
                report.seconds,
                report.backend,
                ms(report.seconds),
                ms(forward),
                ms(loss),
                ms(backward),
                ms(own),
                ms(optimizer),
                ms(densify),
                ms(report.seconds - report.times.total()),
            );
        }
        for (photo, score) in &report.held_out.photos {
            println!("held-out {photo}: {score}");
        }
        if let Some(mean) = report.held_out.mean() {
            println!("held-out mean of {}: {mean}", report.held_out.photos.len());
        }
    }
}
