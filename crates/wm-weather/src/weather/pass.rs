//! A weather in one pass: all that it makes for one eye.

use super::observer::Observer;
use super::prepared::PreparedWeather;
use crate::dome::Dome;
use crate::light::LampGlow;
use crate::optics::Atmosphere;
use crate::particles::FallingParticles;
use crate::particles::fall::Surroundings;
use crate::splash::SplashParticles;
use std::sync::Arc;
use wm_render::hooks::{Backdrop, Hooks, Medium, ParticleView, Particles, PixelEffect};
use wm_render::simd::SimdPath;

/// The weather of one pass: it owns what was made for its eye, and lends it as [`Hooks`].
pub struct PassWeather<'a> {
    background: Option<&'a Dome>,
    air: Arc<Atmosphere>,
    particles: Vec<Box<dyn Particles + 'a>>,
    pixels: Vec<Box<dyn PixelEffect + 'a>>,
}

impl PassWeather<'_> {
    /// The hooks of the pass.
    #[must_use]
    pub fn hooks(&self) -> Hooks<'_> {
        Hooks {
            background: self.background.map(|dome| dome as &dyn Backdrop),
            medium: (!self.air.is_clear()).then_some(&*self.air as &dyn Medium),
            particles: self.particles.iter().map(|particles| &**particles).collect(),
            pixels: self.pixels.iter().map(|pixels| &**pixels).collect(),
        }
    }
}

impl PreparedWeather {
    /// Makes the weather of one pass for an eye.
    #[must_use]
    pub fn pass<'a>(&'a self, observer: &Observer<'a>) -> PassWeather<'a> {
        let size = f64::from(ParticleView::new(observer.camera).pixels());
        let residuals = self.falling.iter().map(|kind| kind.residual(size)).collect();
        let air = Arc::new(self.air.clone().without(residuals));
        let lamps = observer.lamps.filter(|lamps| !lamps.lights.is_empty());
        let mut pixels: Vec<Box<dyn PixelEffect + 'a>> = Vec::new();
        for fog in &self.paper {
            pixels.push(Box::new(fog));
        }
        pixels.extend(self.pixels.iter().filter_map(|pixels| pixels.in_pass(self, observer)));
        if let Some(lamps) = lamps {
            let path = SimdPath::widest();
            let glow = || LampGlow::new(lamps, observer.camera, &air, &self.site, path);
            pixels.push(Box::new(observer.pool.map_or_else(glow, |pool| pool.install(glow))));
        }
        // The grade comes last: after the paper's rain, which is not the renderer's.
        if let Some(grade) =
            self.grade.as_ref().filter(|_| self.paper_falls.is_empty() && !observer.is_within)
        {
            pixels.push(Box::new(grade));
        }
        let around = || Surroundings { lamps, ..self.surroundings(Arc::clone(&air), observer) };
        let mut particles: Vec<Box<dyn Particles + 'a>> = Vec::new();
        for kind in &self.falling {
            particles.push(Box::new(FallingParticles::new(kind, around())));
        }
        if let Some(splashes) = self.splashes(observer, around()) {
            particles.push(Box::new(splashes));
        }
        PassWeather { background: self.dome.as_ref(), air, particles, pixels }
    }

    /// The splashes in front of a camera; `None` without rain, or without anything wet that it
    /// hits.
    fn splashes<'a>(
        &'a self,
        observer: &Observer<'a>,
        around: Surroundings<'a>,
    ) -> Option<SplashParticles<'a>> {
        let splash = self.splash?;
        let rain = self.falling.iter().find(|kind| kind.kind.name == "rain")?;
        let ground = self.site.ground * self.site.metres_per_unit;
        let plane = self.flood().map(|flood| ground + flood.height());
        if plane.is_none() && observer.splashes.is_none() {
            return None;
        }
        let seed = self.flood.map_or(0, |flood| flood.seed);
        Some(SplashParticles::new(splash, rain, seed, around, observer.splashes, plane))
    }
}
