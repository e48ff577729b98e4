//! The run of a training: steps, progress, checkpoints, previews, the report and the scene.

use super::ReconstructArgs;
use super::data::Data;
use super::folder::{Metrics, RunFolder};
use super::lpips::Lpips;
use super::watch::Watch;
use crate::interrupt::{self, Interrupted};
use crate::progress;
use anyhow::{Context, Result, bail};
use glam::DVec3;
use serde_json::json;
use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use wm_media::{Size, color::Dither, png};
use wm_render::{Frame, RenderError};
use wm_scene::capture::gps;
use wm_scene::capture::ground::{CaptureGround, CaptureGroundError, HELD_AT, ground};
use wm_scene::formats::{folder as scene_folder, write_scene};
use wm_scene::survey::{Survey, label_sky};
use wm_scene::{Metadata, Scene, Splats};
use wm_train::checkpoint::{self, Head, Taught};
use wm_train::losses::Truth;
use wm_train::metrics::{Ssim, psnr};
use wm_train::photos::{Photo, PhotoError};
use wm_train::priors::{Prior, Priors};
use wm_train::start::{self, SkyPhotos, StartConfig};
use wm_train::{StepTimes, TrainConfig, Trainer};

/// Photos that are decoded ahead of their step.
const AHEAD: u32 = 4;
/// Shortest side of a photo in coarse steps, px.
const SHORTEST: u32 = 100;
/// The ground under a walk and the scene's up are of one place, as a cosine: 15 degrees, steep streets and all.
const SAME_GROUND: f64 = 0.966;
/// Lines of metrics and previews in a run.
const LINES: u32 = 200;
const PREVIEWS: u32 = 10;

/// A run.
pub struct Run<'a> {
    trainer: Trainer,
    data: &'a Data,
    priors: Option<&'a Priors>,
    folder: &'a RunFolder,
    args: &'a ReconstructArgs,
    metrics: Metrics,
    /// Takes a second a photo, so only the report at the end has it.
    lpips: Option<Lpips>,
    /// Halvings that leave photos large enough.
    last_level: u8,
    truths: Truths,
    /// Photos that turned out to be damaged.
    damaged: BTreeSet<usize>,
    watch: Watch,
}

/// Photos as the losses read them, from one size to the next.
#[derive(Default)]
struct Truths {
    rgb: Vec<f32>,
    mask: Option<Vec<f32>>,
}

impl Truths {
    fn of<'b>(&'b mut self, photo: &'b Photo) -> Truth<'b> {
        self.rgb.clear();
        self.rgb.extend(photo.rgb.iter().map(|v| f32::from(*v) / 255.0));
        self.mask = photo.mask.as_ref().map(|mask| mask.iter().map(|v| f32::from(*v) / 255.0).collect());
        Truth { rgb: &self.rgb, mask: self.mask.as_deref(), camera: &photo.camera, prior: None }
    }
}

/// How near held-out photos are met.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    /// dB.
    psnr: f64,
    ssim: f64,
    /// Where it was asked for.
    lpips: Option<f64>,
}

impl fmt::Display for Score {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.2} dB, SSIM {:.4}", self.psnr, self.ssim)?;
        self.lpips.map_or(Ok(()), |lpips| write!(f, ", LPIPS {lpips:.4}"))
    }
}

impl Score {
    /// `None` of none.
    fn mean(scores: &[(usize, Self)]) -> Option<Self> {
        let count = scores.len() as f64;
        let mean = |of: fn(&Self) -> Option<f64>| {
            Some(scores.iter().map(|(_, score)| of(score)).sum::<Option<f64>>()? / count)
        };
        let (psnr, ssim) = (mean(|score| Some(score.psnr))?, mean(|score| Some(score.ssim))?);
        (count > 0.0).then(|| Self { psnr, ssim, lpips: mean(|score| score.lpips) })
    }

    /// A line of the metrics.
    fn json(&self, step: u32, splats: usize) -> serde_json::Value {
        let mut held_out = json!({ "psnr": self.psnr, "ssim": self.ssim });
        if let Some(lpips) = self.lpips {
            held_out["lpips"] = json!(lpips);
        }
        json!({ "step": step, "held_out": held_out, "splats": splats })
    }
}

impl<'a> Run<'a> {
    /// Begins, or goes on.
    pub fn new(
        config: TrainConfig,
        data: &'a Data,
        priors: Option<&'a Priors>,
        folder: &'a RunFolder,
        args: &'a ReconstructArgs,
        lpips: Option<Lpips>,
    ) -> Result<Self> {
        let renderer = args.run.differentiable()?;
        let cameras = data.cameras();
        let extent = start::extent(&cameras);
        let trainer = match folder.resumed()? {
            Some((head, state)) => {
                let trainer = Trainer::resumed(config, renderer, state, extent, data.teaching.len());
                let same = head.config == *trainer.config()
                    && head.photos == taught(data)
                    && head.simd == trainer.path().to_string();
                if !same {
                    bail!(
                        "{}: holds a training of other photos, options or SIMD path; give those that it began with, \
                         or another --run-folder without --resume",
                        folder.path().display()
                    );
                }
                eprintln!("{}: going on after step {}", folder.path().display(), head.step());
                trainer
            }
            None => {
                let begin = StartConfig {
                    opacity: config.start_opacity,
                    scale: config.start_scale,
                    most: config.densify.max_splats().unwrap_or(usize::MAX),
                    sh_degree: config.sh_degree,
                    seed: config.seed,
                };
                let mut splats = if data.capture.points.is_empty() {
                    start::blind(&cameras, extent, &begin)
                } else {
                    start::from_points(&data.capture.points, extent, &begin)
                };
                if splats.is_empty() {
                    bail!("{}: no point of the model is finite; make it again", args.dataset.display());
                }
                add_sky(&mut splats, data, priors, extent, config.sky_splats)?;
                Trainer::new(config, renderer, splats, extent, data.teaching.len())
            }
        };
        folder.write_config(trainer.config())?;
        let metrics = folder.metrics(trainer.steps_done(), trainer.config().steps)?;
        let last_level = data.photos.last_level(SHORTEST);
        let dataset = args.dataset.display().to_string();
        let photo = data.name(shown_place(data));
        let watch = Watch::new(&args.watch, dataset, photo, trainer.config().steps, extent)?;
        Ok(Self {
            trainer,
            data,
            priors,
            folder,
            args,
            metrics,
            lpips,
            last_level,
            truths: Truths::default(),
            damaged: BTreeSet::new(),
            watch,
        })
    }

    /// Trains to the end and writes the scene.
    pub fn go(mut self, out: &Path, facts: &Metadata) -> Result<()> {
        let steps = self.trainer.config().steps;
        let done = self.trainer.steps_done();
        let (line_every, preview_every) = ((steps / LINES).max(1), (steps / PREVIEWS).max(1));
        let bar = progress::bar(u64::from(steps), "steps");
        bar.set_position(u64::from(done));
        bar.reset_eta();
        let started = Instant::now();
        let mut saved = Instant::now();
        let mut sum = Sum::default();
        let mut score = None;
        while !self.trainer.is_done() {
            if interrupt::asked() {
                bar.finish_and_clear();
                self.save()?;
                let step = self.trainer.steps_done();
                let advice = "the same command with --resume goes on";
                return Err(Interrupted(format!("{step} of {steps} steps are done, {advice}")).into());
            }
            self.step(&mut sum)?;
            let step = self.trainer.steps_done();
            bar.set_position(u64::from(step));
            self.watch.step(step, self.trainer.len());
            self.show()?;
            if step.is_multiple_of(preview_every) && step < steps {
                score = self.evaluate()?;
                self.preview()?;
                if let Some(score) = score {
                    self.metrics.add(&score.json(step, self.trainer.len()))?;
                    self.watch.held_out(step, score.psnr);
                }
            }
            if step.is_multiple_of(line_every) {
                self.watch.loss(step, sum.loss());
                let held_out =
                    score.map_or_else(String::new, |score: Score| format!(", held-out {:.2} dB", score.psnr));
                bar.set_message(format!("loss {:.4}, {} splats{held_out}", sum.loss(), self.trainer.len()));
                let line = sum.json(step, self.trainer.len());
                self.metrics.add(&line)?;
                sum.begin_line();
            }
            if saved.elapsed().as_secs_f64() > self.args.checkpoint_every {
                self.save()?;
                saved = Instant::now();
            }
        }
        bar.finish_and_clear();
        let seconds = started.elapsed().as_secs_f64();
        self.save()?;
        self.preview()?;
        self.report(&sum, seconds, steps - done)?;
        self.write(out, facts)?;
        self.watch.end(format!("Done: {}, {} splats", out.display(), self.trainer.len()));
        Ok(())
    }

    fn step(&mut self, sum: &mut Sum) -> Result<()> {
        let step = self.trainer.steps_done();
        for ahead in step + 1..=(step + AHEAD).min(self.trainer.config().steps.saturating_sub(1)) {
            let place = self.data.teaching[self.trainer.photo_at(ahead)];
            self.data.photos.prefetch(place, self.trainer.level_at(ahead, self.last_level));
        }
        let level = self.trainer.level_at(step, self.last_level);
        let (index, photo) = self.taught_at(step, level)?;
        let prior = self.prior(self.data.teaching[index])?;
        let truth = Truth { prior: prior.as_deref(), ..self.truths.of(&photo) };
        let report = match self.trainer.step(&truth, index) {
            Err(error) if error.is_of_gpu() => return Err(self.without_gpu(&error)),
            done => done?,
        };
        if report.lost > 0 {
            eprintln!("warning: {} steps were lost with the GPU and are taken again", report.lost);
        }
        if !report.loss.is_finite() {
            bail!(
                "the training came to numbers that are not finite at step {step}: report this with the photos"
            );
        }
        sum.add(&report);
        Ok(())
    }

    /// The photo that a step sees, and its place among those that teach: in place of a damaged one the next
    /// that is not, so that going on later takes the same way.
    fn taught_at(&mut self, step: u32, level: u8) -> Result<(usize, Arc<Photo>)> {
        let count = self.data.teaching.len();
        let first = self.trainer.photo_at(step);
        for index in (0..count).map(|further| (first + further) % count) {
            if let Some(photo) = self.photo(self.data.teaching[index], level)? {
                return Ok((index, photo));
            }
        }
        bail!("{}: no photo is left to learn from; copy them again", self.args.dataset.display())
    }

    /// A photo; `None` if it is damaged and may be left out. Else what was learnt so far is kept.
    fn photo(&mut self, place: usize, level: u8) -> Result<Option<Arc<Photo>>> {
        if self.damaged.contains(&place) {
            return Ok(None);
        }
        match self.data.photos.get(place, level) {
            Ok(photo) => Ok(Some(photo)),
            Err(error) if self.args.photos.set.skip_bad => {
                eprintln!("warning: {error}; it is left out");
                self.damaged.insert(place);
                Ok(None)
            }
            Err(error) => Err(self.without(error)),
        }
    }

    /// Ends the run, since a photo is missing, but for what was learnt.
    fn without(&mut self, error: PhotoError) -> anyhow::Error {
        let step = self.trainer.steps_done();
        match self.save() {
            Ok(()) => anyhow::anyhow!(
                "{error}; {step} of {} steps are done, the same command with --resume goes on, and with --skip-bad \
                 without such photos",
                self.trainer.config().steps
            ),
            Err(also) => anyhow::anyhow!("{error}; and what was learnt is lost: {also:#}"),
        }
    }

    /// Ends the run, since the GPU failed, but for what was learnt.
    fn without_gpu(&mut self, error: &RenderError) -> anyhow::Error {
        match self.save() {
            Ok(()) => anyhow::anyhow!(
                "{error}; {} of {} steps are done, the same command with --resume goes on, and with --device \
                 cpu on the CPU",
                self.trainer.steps_done(),
                self.trainer.config().steps
            ),
            Err(also) => anyhow::anyhow!("{error}; and what was learnt is lost: {also:#}"),
        }
    }

    /// What is believed of a photo.
    fn prior(&self, place: usize) -> Result<Option<Arc<Prior>>> {
        let Some(priors) = self.priors else { return Ok(None) };
        Ok(priors.get(self.data.name(place), &self.data.photos.camera(place, 0))?)
    }

    /// The held-out photos' mean score; `None` where none is held out.
    fn evaluate(&mut self) -> Result<Option<Score>> {
        Ok(Score::mean(&self.scores(None)?))
    }

    /// The held-out photos' places and scores, without damaged ones.
    fn scores(&mut self, lpips: Option<&Lpips>) -> Result<Vec<(usize, Score)>> {
        let (mut scores, mut ssim) = (Vec::new(), Ssim::new(self.trainer.path()));
        for place in &self.data.held_out {
            if let Some(score) = self.score(*place, &mut ssim, lpips)? {
                scores.push((*place, score));
            }
        }
        Ok(scores)
    }

    /// `None` for a damaged photo.
    fn score(&mut self, place: usize, ssim: &mut Ssim, lpips: Option<&Lpips>) -> Result<Option<Score>> {
        let Some(photo) = self.photo(place, 0)? else { return Ok(None) };
        let mut frame = Frame::default();
        self.trainer.render(&photo.camera, &mut frame)?;
        let truth = self.truths.of(&photo);
        let width = photo.width as usize;
        // Pictures are what a screen shows: 0 to 1.
        let shown: Vec<f32> = frame.rgb.iter().map(|v| v.clamp(0.0, 1.0)).collect();
        let ssim = match truth.mask {
            Some(mask) => ssim.masked_value(&shown, truth.rgb, mask, width),
            None => ssim.value(&shown, truth.rgb, width),
        };
        let lpips = lpips.map(|lpips| lpips.distance(&shown, truth.rgb, truth.mask, width));
        Ok(Some(Score { psnr: psnr(&shown, truth.rgb, truth.mask), ssim, lpips }))
    }

    /// A picture of one view, the same all the time.
    fn preview(&mut self) -> Result<()> {
        let place = shown_place(self.data);
        let camera = self.data.photos.camera(place, 0);
        let mut frame = Frame::default();
        self.trainer.render(&camera, &mut frame)?;
        let path = self.folder.path().join(format!("preview-{:06}.png", self.trainer.steps_done()));
        let tags = [("photo".to_owned(), self.data.name(place).to_owned())];
        png::write_rgb(&path, &frame.rgb, Size::new(camera.width, camera.height), Dither::Ordered, &tags)?;
        Ok(())
    }

    /// A picture for who looks on, if one is due.
    fn show(&mut self) -> Result<()> {
        let place = shown_place(self.data);
        let Some((camera, is_photo)) = self.watch.wants(&self.data.photos.camera(place, 0)) else {
            return Ok(());
        };
        let mut frame = Frame::default();
        self.trainer.render(&camera, &mut frame)?;
        let photo = if is_photo { self.photo(place, 0)? } else { None };
        let score = photo.map(|photo| {
            let truth = self.truths.of(&photo);
            let shown: Vec<f32> = frame.rgb.iter().map(|v| v.clamp(0.0, 1.0)).collect();
            psnr(&shown, truth.rgb, truth.mask)
        });
        self.watch.picture(self.trainer.steps_done(), &frame, score)
    }

    fn save(&mut self) -> Result<()> {
        match self.trainer.state().map(|_| ()) {
            // What was known before the GPU failed.
            Err(error) if error.is_of_gpu() => {}
            done => done?,
        }
        let (config, simd) = (self.trainer.config().clone(), self.trainer.path().to_string());
        let state = self.trainer.known_state();
        let head = Head::new(&config, taught(self.data), simd, state);
        checkpoint::write(&self.folder.checkpoint(), &head, state).context("what was learnt cannot be kept")
    }

    fn report(&mut self, sum: &Sum, seconds: f64, steps: u32) -> Result<()> {
        if steps > 0 {
            let ms = |part: f64| part * 1e3 / f64::from(steps);
            let StepTimes { forward, loss, backward, own, optimizer, densify } = sum.times;
            println!(
                "{steps} steps in {seconds:.1} s on {}, {:.1} ms each: forward {:.1}, loss {:.1}, backward {:.1}, renders of terms {:.1}, optimiser {:.1}, \
                 densify {:.1}, photos and the rest {:.1}",
                self.trainer.describe(),
                ms(seconds),
                ms(forward),
                ms(loss),
                ms(backward),
                ms(own),
                ms(optimizer),
                ms(densify),
                ms(seconds - sum.times.total()),
            );
        }
        let lpips = self.lpips.take();
        let scores = self.scores(lpips.as_ref())?;
        for (place, score) in &scores {
            println!("held-out {}: {score}", self.data.name(*place));
        }
        if let Some(score) = Score::mean(&scores) {
            println!("held-out mean of {}: {score}", scores.len());
            let line = score.json(self.trainer.steps_done(), self.trainer.len());
            self.metrics.add(&line)?;
        }
        Ok(())
    }

    /// Writes the scene with what cameras tell of the place.
    fn write(&mut self, out: &Path, facts: &Metadata) -> Result<()> {
        let mut splats = self.trainer.state()?.population.drawn();
        label_sky(&mut splats);
        let metadata = Metadata {
            rasterization: Some(self.trainer.config().rasterization),
            provenance: Some(format!(
                "weather-magician {}, {} photos, {} steps",
                env!("CARGO_PKG_VERSION"),
                self.data.teaching.len(),
                self.trainer.config().steps
            )),
            ..Metadata::default()
        };
        let mut scene = Scene { splats, metadata, views: self.data.views() };
        let survey = Survey::of(&scene, facts);
        let mut known = survey.metadata();
        let ground = ground(&self.data.capture);
        if facts.ground.is_none()
            && let Ok(ground) = &ground
            && ground.up.dot(survey.up.value) > SAME_GROUND
        {
            // Seen in many photos: better than what training left of a street.
            known.ground = Some(ground.under.dot(survey.up.value));
            known.camera_height = Some(ground.height);
        }
        if known.metres_per_unit.is_none() {
            let found = self.scale(&ground);
            if let (Err(reason), true) = (&ground, found.is_none() || self.args.camera_height.is_some()) {
                eprintln!("scale: none from the height of the cameras: {reason}");
            }
            if let Some(Scale { metres_per_unit, source }) = found {
                eprintln!("scale: {metres_per_unit:.4} m per unit, from {source}");
                known.metres_per_unit = Some(metres_per_unit);
                known.scale_source = Some(source);
            }
        }
        scene.metadata = known.or(std::mem::take(&mut scene.metadata));
        write_scene(out, &scene)?;
        scene_folder::write_cameras(&scene_folder::cameras_path(out), &scene.views)?;
        println!("{}: {} splats", out.display(), scene.splats.len());
        if scene.metadata.metres_per_unit.is_none()
            && let Some(warning) = survey.warning()
        {
            eprintln!("warning: {warning}");
        }
        Ok(())
    }

    /// Metres a unit: by the height of the cameras if that is given, else by where photos say that they were
    /// taken, else by the height at which people hold cameras.
    fn scale(&self, ground: &Result<CaptureGround, CaptureGroundError>) -> Option<Scale> {
        let by_height = |metres: f64| {
            let metres_per_unit = metres / ground.as_ref().ok()?.height;
            let source = format!("the camera height of {metres} m above the ground");
            (metres_per_unit.is_finite() && metres_per_unit > 0.0)
                .then_some(Scale { metres_per_unit, source })
        };
        let by_places = || {
            let centers: Vec<DVec3> =
                self.data.capture.views.iter().map(|view| view.camera.center()).collect();
            let scale = gps::metres_per_unit(&centers, self.data.photos.gps())?;
            let source = format!("the places of {} photos, met within {:.1} m", scale.photos, scale.residual);
            Some(Scale { metres_per_unit: scale.metres_per_unit, source })
        };
        let given = self.args.camera_height.and_then(by_height);
        given.or_else(by_places).or_else(|| match self.args.camera_height {
            Some(_) => None,
            None => by_height(HELD_AT),
        })
    }
}

/// The photo whose view is shown while the training goes on.
fn shown_place(data: &Data) -> usize {
    data.held_out.first().or(data.teaching.first()).copied().unwrap_or(0)
}

/// How large the place is, and what says so.
struct Scale {
    metres_per_unit: f64,
    source: String,
}

/// Photos that the sky takes its colours from, about.
const SKY_PHOTOS: usize = 200;

/// Adds the sky, where the priors say that photos show it.
fn add_sky(splats: &mut Splats, data: &Data, priors: Option<&Priors>, extent: f64, count: u32) -> Result<()> {
    let Some(priors) = priors.filter(|priors| count > 0 && priors.has_sky()) else { return Ok(()) };
    let (mut cameras, mut maps) = (Vec::new(), Vec::new());
    // Of thousands of photos some hundred show all of the sky that is to be seen.
    for place in data.teaching.iter().step_by(data.teaching.len().div_ceil(SKY_PHOTOS)) {
        let camera = data.photos.camera(*place, 0);
        let Some(prior) = priors.get(data.name(*place), &camera)? else { continue };
        if prior.sky.is_empty() {
            continue;
        }
        // Colours of photos as small as the maps: means of their pixels.
        let level = (0..6).take_while(|level| camera.width >> level >= prior.width).last().unwrap_or(0);
        let photo = data.photos.get(*place, level)?;
        cameras.push(camera);
        maps.push((prior.width as usize, prior.height as usize, prior.sky.clone(), photo));
    }
    let look = |index: usize, [x, y]: [f64; 2]| {
        let (width, height, sky, photo) = &maps[index];
        let class = sky[(y * *height as f64) as usize * width + (x * *width as f64) as usize];
        let (column, row) = ((x * f64::from(photo.width)) as usize, (y * f64::from(photo.height)) as usize);
        let at = 3 * (row * photo.width as usize + column);
        (class, [photo.rgb[at], photo.rgb[at + 1], photo.rgb[at + 2]])
    };
    let photos = SkyPhotos { cameras: &cameras, look: &look };
    start::add_sky(splats, &photos, &data.capture.points, extent, count as usize);
    Ok(())
}

fn taught(data: &Data) -> Vec<Taught> {
    let taught = |place: &usize| {
        let camera = data.photos.camera(*place, 0);
        Taught { name: data.name(*place).to_owned(), size: (camera.width, camera.height) }
    };
    data.teaching.iter().map(taught).collect()
}

/// What steps add up to: all, and since the last line.
#[derive(Default)]
struct Sum {
    times: StepTimes,
    line: StepTimes,
    steps: u32,
    loss: f64,
    terms: Vec<(&'static str, f64)>,
}

impl Sum {
    fn add(&mut self, report: &wm_train::StepReport) {
        self.times.add(&report.times);
        self.line.add(&report.times);
        self.steps += 1;
        self.loss += report.loss;
        for (name, value) in &report.terms {
            match self.terms.iter_mut().find(|(known, _)| known == name) {
                Some((_, sum)) => *sum += value,
                None => self.terms.push((name, *value)),
            }
        }
    }

    fn loss(&self) -> f64 {
        self.loss / f64::from(self.steps.max(1))
    }

    fn json(&self, step: u32, splats: usize) -> serde_json::Value {
        let mean = |sum: f64| sum / f64::from(self.steps.max(1));
        let terms: serde_json::Map<String, serde_json::Value> =
            self.terms.iter().map(|(name, sum)| ((*name).to_owned(), json!(mean(*sum)))).collect();
        json!({ "step": step, "loss": mean(self.loss), "terms": terms, "splats": splats, "step_ms": mean(self.line.total()) * 1e3 })
    }

    fn begin_line(&mut self) {
        (self.line, self.steps, self.loss) = (StepTimes::default(), 0, 0.0);
        self.terms.clear();
    }
}
