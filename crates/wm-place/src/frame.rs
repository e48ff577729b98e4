//! Builds the plan of a frame from a prepared weather, and carries it out. All pictures of the
//! library and of the program come from here.

use crate::MovingCamera;
use crate::picture::{Picture, WaterLayers};
use std::sync::{Arc, Mutex, PoisonError};
use wm_render::frame::srgb_encode;
use wm_render::hooks::{Hooks, Particle};
use wm_render::parts::{PartPasses, PicturePart};
use wm_render::simd::SimdPath;
use wm_render::{
    Background, BlendSurface, DrawPass, FRONT_CHANNELS, Frame, FramePlan, Geometry, MedianDepth, Outputs,
    ParticlePass, PictureEffect, PictureId, Pictures, RenderBackend, RenderConfig, RenderError, SetView,
    Stats, WaterPass, at_once,
};
use wm_scene::{Camera, Splats};
use wm_weather::lens::{LensEffect, wide_camera};
use wm_weather::light::LampsOn;
use wm_weather::paper::PaperStages;
use wm_weather::paper::composite::{self, PaperBlend};
use wm_weather::shelter::Shelter;
use wm_weather::splash::SplashGround;
use wm_weather::water::{MirrorView, WaterBody, WaterEffect, WaterGrid, WaterMap, WaterMotion, WaterSurface};
use wm_weather::{Observer, PassWeather, PreparedWeather};

/// The inputs of the plan of one pinhole picture.
#[derive(Clone, Copy)]
pub struct FrameInputs<'a> {
    /// The splat sets, drawn together.
    pub sets: &'a [SetView<'a>],
    /// These sets with fewer splats, for blurred views: through drops on the lens, and mirrored in
    /// films of water and waves; `None` for [`Self::elsewhere`].
    pub thinned: Option<&'a [SetView<'a>]>,
    /// These sets for other eyes and wider views: with splats that the camera does not see.
    pub elsewhere: &'a [SetView<'a>],
    /// The weather at the instant.
    pub weather: &'a PreparedWeather,
    /// The camera.
    pub camera: MovingCamera,
    /// The camera of the whole picture, where the camera shows a part of it.
    pub whole: Option<Camera>,
    /// The map of the places that rain and snow do not reach; `None` to ignore roofs.
    pub shelter: Option<&'a Shelter>,
    /// The lamps that shine; `None` for none.
    pub lamps: Option<&'a LampsOn<'a>>,
    /// The wet ground that rain splashes on; `None` for none.
    pub splashes: Option<&'a SplashGround<'a>>,
    /// The surface of puddles and films on the ground; `None` for none.
    pub puddles: Option<&'a Arc<WaterGrid>>,
    /// Threads for what is made for the whole frame; `None` for those of the caller.
    pub pool: Option<&'a rayon::ThreadPool>,
    /// The outputs, the background and the rasterization.
    pub config: &'a RenderConfig,
    /// Parts of the picture that are rendered with it. The paper's rain and snow have none.
    pub parts: &'a [PicturePart],
    /// True to keep the pictures between the clear one and the last, of weather that is drawn as in
    /// the paper ([`wm_weather::paper`]). Without the paper's rain and snow, each of them is the
    /// picture itself.
    pub stages: bool,
}

impl<'a> FrameInputs<'a> {
    /// Splat sets in a weather, without a place: no roofs, lamps or water.
    #[must_use]
    pub fn of_sets(
        sets: &'a [SetView<'a>],
        weather: &'a PreparedWeather,
        camera: &Camera,
        config: &'a RenderConfig,
    ) -> Self {
        Self {
            sets,
            thinned: None,
            elsewhere: sets,
            weather,
            camera: (*camera).into(),
            whole: None,
            shelter: None,
            lamps: None,
            splashes: None,
            puddles: None,
            pool: None,
            config,
            parts: &[],
            stages: false,
        }
    }
}

/// The picture that a frame is drawn into, and what draws it.
struct FrameTarget<'a> {
    backend: &'a mut dyn RenderBackend,
    memory: &'a mut Pictures,
    picture: &'a mut Picture,
}

impl FrameTarget<'_> {
    /// Carries out a plan that draws into the picture, with the parts of it that are wanted.
    async fn execute(
        &mut self,
        plan: &FramePlan<'_>,
        color: PictureId,
        parts: Option<PartPasses>,
    ) -> Result<Stats, RenderError> {
        self.memory.put(color, std::mem::take(&mut self.picture.frame));
        let stats = self.backend.execute_async(plan, self.memory).await?;
        self.picture.parts = parts.map(|parts| parts.finish(self.memory)).unwrap_or_default();
        self.picture.frame = self.memory.take(color);
        Ok(stats)
    }
}

impl FrameInputs<'_> {
    /// Draws the frame into `picture`.
    ///
    /// # Errors
    /// [`RenderError`] of the back end.
    pub fn draw(
        &self,
        backend: &mut dyn RenderBackend,
        memory: &mut Pictures,
        picture: &mut Picture,
    ) -> Result<Stats, RenderError> {
        at_once(self.draw_async(backend, memory, picture))
    }

    /// [`Self::draw`] that in a browser lets the page work while a GPU draws.
    pub(crate) async fn draw_async(
        &self,
        backend: &mut dyn RenderBackend,
        memory: &mut Pictures,
        picture: &mut Picture,
    ) -> Result<Stats, RenderError> {
        picture.metres_per_unit = self.weather.site().metres_per_unit;
        (picture.stages, picture.water) = (PaperStages::default(), WaterLayers::default());
        let stats = if self.weather.paper_falls.is_empty() {
            self.draw_in_blend(&mut FrameTarget { backend, memory, picture }).await?
        } else {
            self.draw_as_paper(&mut FrameTarget { backend, memory, picture }).await?
        };
        if self.stages && self.weather.paper_falls.is_empty() {
            picture.stages.begin(&picture.frame);
        }
        Ok(stats)
    }

    /// Draws the frame with everything that falls in the blend.
    async fn draw_in_blend(&self, to: &mut FrameTarget<'_>) -> Result<Stats, RenderError> {
        let water = self.weather.water(self.puddles);
        let water = water.and_then(|map| Water::new(map, self.weather, &self.camera.camera));
        if let Some(water) = water {
            return self.draw_with_water(&water, to).await;
        }
        let weather = self.weather.pass(&self.observer());
        let drops = self.drops_view();
        let drops = drops.as_ref().map(|view| DropsPass::new(self, view));
        let mut plan = FramePlan::new();
        let color = plan.draw(self.scene_pass(self.config, &weather));
        let parts = (!self.parts.is_empty()).then(|| PartPasses::append(&mut plan, color, self.parts));
        if let Some(drops) = &drops {
            drops.append(&mut plan, color);
        }
        to.execute(&plan, color, parts).await
    }

    /// Draws coverage, expected and median depth alone. Water counts as a surface where it hides at
    /// least half of what lies behind it.
    pub(crate) async fn draw_geometry_async(
        &self,
        backend: &mut dyn RenderBackend,
        memory: &mut Pictures,
        picture: &mut Picture,
    ) -> Result<Stats, RenderError> {
        let outputs =
            Outputs { geometry: Geometry::Depth, median_depth: MedianDepth::On, ..Outputs::default() };
        let config = RenderConfig { outputs, ..*self.config };
        let camera = &self.camera.camera;
        let observer = Observer { lamps: None, splashes: None, is_within: true, ..self.observer() };
        let weather = self.weather.pass(&observer);
        // A sky of the weather takes the place of the scene's own.
        let hooks = Hooks { background: weather.hooks().background, ..Hooks::default() };
        let mut plan = FramePlan::new();
        let drawn = plan.draw(DrawPass::new(self.sets, camera, &config).with_hooks(hooks));
        let stats = FrameTarget { backend, memory, picture }.execute(&plan, drawn, None).await?;
        picture.water = WaterLayers::default();
        let surface = self.weather.water(self.puddles).and_then(|map| WaterSurface::of(&map, camera));
        let Some(WaterSurface { depth, cover, .. }) = surface else { return Ok(stats) };
        let Frame { depth: expected, median_depth: median, .. } = &mut picture.frame;
        for (i, z) in depth.into_iter().enumerate() {
            let hides = cover.get(i).is_none_or(|cover| *cover >= 0.5);
            if hides && (z < median[i] || z > 0.0 && median[i] == 0.0) {
                (expected[i], median[i]) = (z, z);
            }
        }
        Ok(stats)
    }

    /// The falling particles of the frame, each with its velocity relative to the camera, scene
    /// units a second, world axes.
    pub(crate) fn particles(&self, path: SimdPath) -> Vec<(Particle, [f64; 3])> {
        self.weather.drawn_particles(path, &self.observer())
    }

    /// Draws the scene from the mirrored eye, then from its own, and lays the water between.
    async fn draw_with_water(&self, water: &Water, to: &mut FrameTarget<'_>) -> Result<Stats, RenderError> {
        let camera = &self.camera.camera;
        let asked = self.config.outputs;
        let mirror_config =
            self.beyond_the_picture(Outputs { geometry: Geometry::Depth, ..Outputs::default() });
        let mirror = &water.mirror;
        let mirrored_observer =
            Observer { camera: &mirror.camera, splashes: None, is_within: true, ..self.observer() };
        let mirrored_weather = self.weather.pass(&mirrored_observer);
        // What a film mirrors is blurred, and what waves mirror is in pieces, so a few splats will
        // do. The lamps and their glow are mirrored too.
        let is_unclear = water.surface.is_blurred() || water.motion.is_rough;
        let sets = self.thinned.filter(|_| is_unclear).unwrap_or(self.elsewhere);
        let mirrored = DrawPass {
            cut: Some(mirror.cut),
            ..DrawPass::new(sets, &mirror.camera, &mirror_config)
                .with_hooks(Hooks { particles: Vec::new(), ..mirrored_weather.hooks() })
        };
        let weather = self.weather.pass(&self.observer());
        let hooks = weather.hooks();
        // Particles are laid over the water, from a picture of their own.
        let particles = if hooks.particles.is_empty() { asked.particles } else { ParticlePass::On };
        // The effects on pixels read depth.
        let needs_depth = asked.geometry == Geometry::None && !hooks.pixels.is_empty();
        let geometry = if needs_depth { Geometry::Depth } else { asked.geometry };
        let config = RenderConfig { outputs: Outputs { geometry, particles, ..asked }, ..*self.config };
        let effect = WaterEffect {
            map: &water.map,
            surface: &water.surface,
            mirror,
            motion: &water.motion,
            body: water.body,
            white: self.weather.brightest(),
            camera,
            medium: hooks.medium,
            effects: &hooks.pixels,
        };
        let surface = BlendSurface { depth: &water.surface.depth, normal: mirror.cut.normal };
        let scene = self.scene_pass(&config, &weather);
        let scene =
            DrawPass { surface: Some(surface), hooks: Hooks { pixels: Vec::new(), ..scene.hooks }, ..scene };
        let drops = self.drops_view();
        let drops = drops.as_ref().map(|view| DropsPass::new(self, view));
        let mut plan = FramePlan::new();
        let color = plan.draw(scene);
        let parts = (!self.parts.is_empty()).then(|| PartPasses::append(&mut plan, color, self.parts));
        let mirrored = plan.draw(mirrored);
        plan.apply(&effect, color, &[mirrored]);
        if let Some(drops) = &drops {
            drops.append(&mut plan, color);
        }
        to.picture.spare.lend(&mut to.picture.frame);
        let stats = to.execute(&plan, color, parts).await?;
        to.picture.water = match asked.water {
            WaterPass::Off => WaterLayers::default(),
            WaterPass::On => water.layers(&to.picture.frame),
        };
        let wants_particles = asked.particles == ParticlePass::On;
        to.picture.spare.take(&mut to.picture.frame, asked.geometry != Geometry::None, wants_particles);
        Ok(stats)
    }

    /// Draws the scene, then each sub-cloud of what falls by itself, and lays them over it.
    async fn draw_as_paper(&self, to: &mut FrameTarget<'_>) -> Result<Stats, RenderError> {
        let (weather, observer) = (self.weather, self.observer());
        let camera = &self.camera.camera;
        let asked = self.config.outputs.geometry;
        let geometry = if asked == Geometry::None { Geometry::Depth } else { asked };
        let config = RenderConfig { outputs: Outputs { geometry, ..self.config.outputs }, ..*self.config };
        let noise_config = RenderConfig {
            outputs: Outputs { geometry: Geometry::Depth, ..Outputs::default() },
            background: Background::default(),
            ..config
        };
        let clouds: Vec<(PaperBlend, Vec<Splats>)> = weather
            .paper_falls
            .iter()
            .map(|fall| (weather.blend(fall, camera), weather.sub_clouds(fall, &observer)))
            .collect();
        let mut kept = PaperStages::default();
        let stages = Mutex::new(self.stages.then_some(&mut kept));
        // Without what falls.
        let begin = Effect(|_: SimdPath, picture: &mut Frame, _: &[&Frame]| {
            if let Some(stages) = &mut *stages.lock().unwrap_or_else(PoisonError::into_inner) {
                stages.begin(picture);
            }
        });
        // Each lays one sub-cloud over the picture.
        let stages = &stages;
        let overlays: Vec<_> = clouds
            .iter()
            .map(|(blend, _)| {
                Effect(move |_: SimdPath, picture: &mut Frame, inputs: &[&Frame]| {
                    let mut stages = stages.lock().unwrap_or_else(PoisonError::into_inner);
                    composite::add(blend, picture, inputs[0], stages.as_deref_mut());
                })
            })
            .collect();
        // Fog, blur and grade.
        let finish =
            Effect(|path: SimdPath, picture: &mut Frame, _: &[&Frame]| weather.finish(path, picture));
        let pass_weather = weather.pass(&observer);
        let drops = self.drops_view();
        let drops = drops.as_ref().map(|view| DropsPass::new(self, view));
        let mut plan = FramePlan::new();
        let color = plan.draw(self.scene_pass(&config, &pass_weather));
        if self.stages {
            plan.apply(&begin, color, &[]);
        }
        let mut noise: Option<PictureId> = None;
        for ((_, clouds), overlay) in clouds.iter().zip(&overlays) {
            for cloud in clouds {
                let pass = DrawPass::new(&[SetView::transient(cloud)], camera, &noise_config);
                let drawn = match noise {
                    Some(id) => {
                        plan.draw_into(id, pass);
                        id
                    }
                    None => *noise.insert(plan.draw(pass)),
                };
                plan.apply(overlay, color, &[drawn]);
            }
        }
        plan.apply(&finish, color, &[]);
        if let Some(drops) = &drops {
            drops.append(&mut plan, color);
        }
        let stats = to.execute(&plan, color, None).await?;
        drop(plan);
        if asked == Geometry::None {
            to.picture.frame.depth.clear();
        }
        to.picture.stages = kept;
        Ok(stats)
    }

    /// The pass that draws the scene in its weather.
    fn scene_pass<'s>(&'s self, config: &'s RenderConfig, weather: &'s PassWeather<'_>) -> DrawPass<'s> {
        let pass = DrawPass::new(self.sets, &self.camera.camera, config).with_hooks(weather.hooks());
        DrawPass { whole: self.whole, ..pass }
    }

    /// The view that is seen through drops on the glass in front of the camera; `None` where they
    /// change no picture.
    fn drops_view(&self) -> Option<DropsView<'_>> {
        let glass = self.weather.glass()?;
        let camera = &self.camera.camera;
        let effect = LensEffect { glass, camera };
        Some(DropsView {
            effect,
            camera: wide_camera(camera),
            config: self.beyond_the_picture(Outputs::default()),
        })
    }

    /// The configuration of views that show more than the picture: a scene with a sky of its own
    /// shows what nobody photographed as haze, never black.
    fn beyond_the_picture(&self, outputs: Outputs) -> RenderConfig {
        let background = match self.config.background {
            Background::Color(_) => {
                Background::Color(self.weather.site().airlight.map(|v| srgb_encode(v) as f32))
            }
            sky => sky,
        };
        RenderConfig { outputs, background, ..*self.config }
    }

    fn observer(&self) -> Observer<'_> {
        let MovingCamera { camera, velocity } = &self.camera;
        let Self { shelter, lamps, splashes, pool, .. } = *self;
        Observer { camera, velocity: *velocity, shelter, lamps, splashes, is_within: false, pool }
    }
}

/// The wide view that drops on a glass show.
struct DropsView<'a> {
    effect: LensEffect<'a>,
    camera: Camera,
    config: RenderConfig,
}

/// The glass in front of the camera as passes of a plan.
struct DropsPass<'a> {
    view: &'a DropsView<'a>,
    sets: &'a [SetView<'a>],
    weather: PassWeather<'a>,
}

impl<'a> DropsPass<'a> {
    fn new(inputs: &'a FrameInputs<'a>, view: &'a DropsView<'a>) -> Self {
        let observer = Observer { camera: &view.camera, lamps: None, splashes: None, ..inputs.observer() };
        let sets = inputs.thinned.unwrap_or(inputs.elsewhere);
        Self { view, sets, weather: inputs.weather.pass(&observer) }
    }

    /// Lays the glass over a finished picture.
    fn append<'s>(&'s self, plan: &mut FramePlan<'s>, picture: PictureId) {
        let hooks = Hooks { particles: Vec::new(), ..self.weather.hooks() };
        let wide = DrawPass::new(self.sets, &self.view.camera, &self.view.config).with_hooks(hooks);
        let wide = plan.draw(wide);
        plan.apply(&self.view.effect, picture, &[wide]);
    }
}

/// The water that one picture shows.
struct Water {
    map: WaterMap,
    surface: WaterSurface,
    mirror: MirrorView,
    motion: WaterMotion,
    body: WaterBody,
}

impl Water {
    /// The layers of a finished picture.
    fn layers(&self, frame: &Frame) -> WaterLayers {
        let WaterSurface { depth, cover, .. } = &self.surface;
        let seen = |(i, front): (usize, f32)| {
            if depth[i].is_nan() { 0.0 } else { (1.0 - front) * cover.get(i).copied().unwrap_or(1.0) }
        };
        WaterLayers {
            cover: frame.front_sums(FRONT_CHANNELS - 1).into_iter().enumerate().map(seen).collect(),
            // The effect leaves it there.
            reflected: frame.front_sums(0),
            depth: depth.iter().map(|z| if z.is_nan() { 0.0 } else { *z }).collect(),
        }
    }

    /// The water of a map in front of a camera; `None` if it sees none.
    fn new(map: WaterMap, weather: &PreparedWeather, camera: &Camera) -> Option<Self> {
        let surface = WaterSurface::of(&map, camera)?;
        let mirror = MirrorView::new(&map, &surface, camera);
        Some(Self {
            surface,
            mirror,
            motion: weather.water_motion(map.grid()),
            body: weather.water_body(),
            map,
        })
    }
}

/// A pass over a picture that a closure does.
struct Effect<F>(F);

impl<F: Fn(SimdPath, &mut Frame, &[&Frame]) + Sync> PictureEffect for Effect<F> {
    fn apply(&self, path: SimdPath, picture: &mut Frame, inputs: &[&Frame]) {
        (self.0)(path, picture, inputs);
    }
}
