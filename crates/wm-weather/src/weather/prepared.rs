//! A weather at one time and place, which gives a renderer its hooks.

use super::observer::Observer;
use super::slant::{fall_of, slant};
use crate::cover::{Airflow, CoverRequest};
use crate::dome::Dome;
use crate::grade::ColorGrade;
use crate::infrared::InfraredAir;
use crate::lens::Glass;
use crate::level::{from_level, level_axes};
use crate::light::{CloudShadows, FlashLight, Headlamps, LightChange, MovingLight};
use crate::optics::{AirLayer, Atmosphere, Site};
use crate::paper::fall::PaperFallContext;
use crate::paper::{PaperCover, PaperFall, PaperFog, composite};
use crate::particles::fall::{Surroundings, WindSample};
use crate::particles::{NearParticle, ParticleShape, Precipitation, near};
use crate::shelter::Shelter;
use crate::water::{Flood, WaterBody, WaterForces, WaterGrid, WaterMap, WaterMotion};
use crate::wetness::{SkySheen, SlantedRain, WetRequest};
use std::fmt;
use std::sync::Arc;
use wm_base::color::srgb_decode;
use wm_render::Frame;
use wm_render::hooks::{Backdrop, Particle, ParticleView, PixelEffect};
use wm_render::simd::SimdPath;
use wm_scene::{Camera, Splats};

/// Speed of clouds: factor on the wind at 10 m, and the speed without any wind, m/s.
const CLOUD_TO_WIND_SPEED: f64 = 1.6;
const CLOUD_SPEED: f64 = 8.0;

/// Depth of a flood, and of the water on wet ground, for the rings of drops, m.
const FLOOD_DEPTH_M: f64 = 1.0;
const PUDDLE_DEPTH_M: f64 = 0.01;

/// Fall speed of flakes, m/s.
const FLAKE_FALL_SPEED: f64 = 1.0;

/// Share of what falls that a strong wind carries on along the ground.
const DRIFTING_SHARE: f64 = 0.6;

/// One instant's weather over one site, ready to render through.
#[derive(Clone, Debug)]
pub struct PreparedWeather {
    /// The air.
    pub air: Atmosphere,
    pub(super) site: Site,
    pub(super) time: f64,
    pub(crate) paper: Vec<PaperFog>,
    /// The paper's rain and snow: overlaid on the picture that [`Self::pass`] gives.
    pub paper_falls: Vec<PaperFall>,
    /// The kinds that fall, with their rates.
    pub falling: Vec<Precipitation>,
    /// The layers of the air that float: all but those of what falls.
    pub(crate) floating: Vec<AirLayer>,
    pub(super) wind_now: WindSample,
    /// The sky behind the scene, if the weather sets one.
    pub(crate) dome: Option<Dome>,
    /// The light on the scene, if it changes.
    pub(super) light: Option<LightChange>,
    /// Lightning at the instant.
    pub(super) flash: Option<FlashLight>,
    /// There may be lightning at other instants.
    pub(super) has_lightning: bool,
    /// Exposure and colour of the finished picture; `None` leaves it as it is.
    pub(crate) grade: Option<ColorGrade>,
    /// The covers, the lowest first.
    pub(super) cover: Vec<CoverRequest>,
    /// The least wind that carries some of what may lie along the ground, m/s at 10 m.
    pub(super) carried: f64,
    /// The paper's lying snow, if there is any: the same at all times.
    pub paper_cover: Option<PaperCover>,
    pub(crate) wetness: Option<WetRequest>,
    /// Water at one level.
    pub(crate) flood: Option<Flood>,
    /// Factor on the splashes of the rain; `None` where it does not splash.
    pub splash: Option<f64>,
    /// The glass in front of the camera, if it shows.
    pub(crate) glass: Option<Box<Glass>>,
    /// Changes of finished pixels that effects contribute.
    pub(crate) pixels: Vec<Arc<dyn PixelContribution>>,
    /// The strongest wind of the whole time, m/s.
    pub(super) strongest_wind: f64,
}

/// A change of finished pixels that an effect contributes to every pass that draws colour: the
/// picture, the mirrored view, the view through drops. It acts after the air and before lamps glow
/// and the picture is graded, on each pixel by itself; for a change that reads neighbours see
/// [`wm_render::PictureEffect`].
pub trait PixelContribution: fmt::Debug + Send + Sync {
    /// Returns the change for one eye; `None` where there is none. The weather has everything else
    /// that the instant brings: light, air, what falls.
    fn in_pass<'a>(
        &'a self,
        weather: &'a PreparedWeather,
        observer: &Observer<'a>,
    ) -> Option<Box<dyn PixelEffect + 'a>>;
}

impl PreparedWeather {
    /// Returns the change of the light on the scene; `None` where the captured light stays.
    #[must_use]
    pub fn light(&self) -> Option<&LightChange> {
        self.light.as_ref()
    }

    /// Returns the brightest light that the place can show, linear, 1 = display white: under the
    /// captured sky what the photos show white, since a training tells nothing of what is above;
    /// infinite where the weather brings a sky or lamps of its own.
    #[must_use]
    pub fn brightest(&self) -> f32 {
        let is_own = |light: &LightChange| light.open.is_some() || light.has_headlamps;
        let has_own = self.dome.is_some() || self.has_lightning || self.light.as_ref().is_some_and(is_own);
        if has_own { f32::INFINITY } else { 1.0 }
    }

    /// Returns true if its light changes from frame to frame, at this or another instant: see
    /// [`MovingLight`].
    #[must_use]
    pub fn moves_light(&self) -> bool {
        let moves = |light: &LightChange| light.has_headlamps || light.has_cloud_shadows;
        self.has_lightning || self.light.as_ref().is_some_and(moves)
    }

    /// The light of one frame of [`Self::moves_light`]; `None` where nothing of it shines at the
    /// instant.
    #[must_use]
    pub fn moving_light(&self, camera: &Camera) -> Option<MovingLight> {
        let change = self.light.as_ref()?;
        let headlamps =
            change.has_headlamps.then(|| Headlamps::new(camera, change.display(&self.site), &self.site));
        let sun = change.open.as_ref().filter(|_| change.has_cloud_shadows).map(|open| open.sun);
        let clouds = sun.map(|sun| {
            // Clouds go faster than the air near the ground, and go on where no wind is requested.
            let [x, y] = self.wind_now.drift.map(|v| v * CLOUD_TO_WIND_SPEED);
            let drift = if self.wind_now.mean == [0.0; 2] { [CLOUD_SPEED * self.time, 0.0] } else { [x, y] };
            let center = camera.center().to_array();
            CloudShadows::new(change.clouds, sun, drift, center, 0, &self.site)
        });
        let moving = MovingLight { headlamps, flash: self.flash, clouds };
        (!moving.is_nothing()).then_some(moving)
    }

    /// The air and the eye for particles, without lamps.
    pub(super) fn surroundings<'a>(&'a self, air: Arc<Atmosphere>, seen: &Observer<'a>) -> Surroundings<'a> {
        let Observer { shelter, velocity, .. } = *seen;
        let (site, wind, time) = (&self.site, self.wind_now, self.time);
        Surroundings { site, air, shelter, lamps: None, wind, velocity, time }
    }

    /// Returns the rate of the rain, mm/h: of all that is water.
    #[must_use]
    pub fn rain_rate(&self) -> f64 {
        self.falling.iter().filter(|kind| kind.kind.name == "rain").map(|kind| kind.rate).sum()
    }

    /// Returns the extinction of the rain, 1/m.
    pub(crate) fn rain_extinction(&self) -> f64 {
        let rain = self.falling.iter().filter(|kind| kind.kind.name == "rain");
        rain.map(|kind| kind.layer().sigma_t[1]).sum()
    }

    /// Returns the direction to the sun of the weather's own and its irradiance across the beam, by
    /// channel, in display values of a white board; `None` where the captured light stays.
    pub(crate) fn sunlight(&self) -> Option<([f64; 3], [f64; 3])> {
        let change = self.light.as_ref()?;
        let open = change.open.as_ref()?;
        let display = change.display(&self.site);
        Some((open.sun, open.light.sun.map(|light| light * display)))
    }

    /// The facts of the place, with the light of the weather.
    #[must_use]
    pub fn site(&self) -> &Site {
        &self.site
    }

    /// Returns the velocity of the rain, m/s, world axes: its mean fall by water, and the wind with
    /// its gusts; `None` where no rain falls.
    #[must_use]
    pub fn rain_velocity(&self) -> Option<[f64; 3]> {
        let rain = self.falling.iter().find(|kind| kind.kind.name == "rain" && kind.rate > 0.0)?;
        let [x, y] = self.wind_now.wind;
        Some(from_level(&level_axes(self.site.up), [x, y, -rain.mean_speed()]))
    }

    /// Returns the air at a wavelength of the near infrared, nm, for a lidar. `lidar_ratio`
    /// replaces the ratios of extinction and backscatter of all that floats, sr.
    #[must_use]
    pub fn infrared_air(&self, wavelength: f64, lidar_ratio: Option<f64>) -> InfraredAir {
        InfraredAir::new(&self.floating, &self.falling, wavelength, lidar_ratio, &self.site)
    }

    /// Returns what falls in front of a view of a sensor that takes no picture, `after` seconds
    /// from the instant: the very particles that a camera sees there, each once. `reach` says up to
    /// where those of a shape and a diameter (m) are requested, m; particles that may come into the
    /// view within `duration` seconds around that time are among them.
    #[must_use]
    pub fn near_particles(
        &self,
        path: SimdPath,
        view: &ParticleView,
        shelter: Option<&Shelter>,
        after: f64,
        duration: f64,
        reach: &dyn Fn(ParticleShape, f64) -> f64,
    ) -> Vec<NearParticle> {
        let [drift, wind] = [self.wind_now.drift, self.wind_now.wind];
        let drift = [0, 1].map(|k| drift[k] + wind[k] * after);
        let around = Surroundings {
            site: &self.site,
            air: Arc::new(self.air.clone()),
            shelter,
            lamps: None,
            wind: WindSample { drift, ..self.wind_now },
            velocity: [0.0; 3],
            time: self.time + after,
        };
        let of_kind = |kind| near::particles(path, view, kind, &around, duration, reach);
        self.falling.iter().flat_map(of_kind).collect()
    }

    /// Returns the falling particles that a picture shows, as they are drawn, each with its
    /// velocity relative to the camera, scene units a second, world axes. Splashes are not among
    /// them.
    #[must_use]
    pub fn drawn_particles(&self, path: SimdPath, seen: &Observer<'_>) -> Vec<(Particle, [f64; 3])> {
        let around = self.surroundings(Arc::new(self.air.clone()), seen);
        let of_kind = |kind| near::drawn(path, seen.camera, kind, &around);
        self.falling.iter().flat_map(of_kind).collect()
    }

    /// The sub-clouds of one of [`Self::paper_falls`], the farthest first, each to be rendered by
    /// itself.
    #[must_use]
    pub fn sub_clouds(&self, fall: &PaperFall, seen: &Observer<'_>) -> Vec<Splats> {
        let Observer { camera, velocity, .. } = *seen;
        fall.sub_clouds(&PaperFallContext { site: &self.site, wind_now: self.wind_now, camera, velocity })
    }

    /// Returns the blending of one of them.
    #[must_use]
    pub fn blend(&self, fall: &PaperFall, camera: &Camera) -> composite::PaperBlend {
        let PaperFall { sky, t, t_c, d_max, .. } = *fall;
        composite::PaperBlend { sky, t, t_d: fall.reach(camera) / self.site.metres_per_unit, t_c, d_max }
    }

    /// Finishes the picture after all of [`Self::paper_falls`] have been overlaid.
    pub fn finish(&self, path: SimdPath, picture: &mut Frame) {
        composite::finish(&self.paper_falls, self.grade.as_ref(), path, picture);
    }

    /// Returns the covers, each on those before it; empty where nothing lies.
    #[must_use]
    pub fn cover(&self) -> &[CoverRequest] {
        &self.cover
    }

    /// Returns the wetness of surfaces; `None` where all are dry.
    #[must_use]
    pub fn wetness(&self) -> Option<&WetRequest> {
        self.wetness.as_ref().filter(|asked| !asked.is_nothing())
    }

    /// Returns the direction of the rain that wets surfaces, the same at all times; `None` if the
    /// weather wets none.
    #[must_use]
    pub fn wetting_rain(&self) -> Option<&SlantedRain> {
        self.wetness.as_ref().map(|asked| &asked.rain)
    }

    /// Returns the water that stands at one level, if any stands over the ground.
    #[must_use]
    pub fn flood(&self) -> Option<&Flood> {
        self.flood.as_ref().filter(|flood| flood.level > 0.0)
    }

    /// Returns the glass in front of the camera; `None` if it changes no picture.
    #[must_use]
    pub fn glass(&self) -> Option<&Glass> {
        self.glass.as_deref()
    }

    /// Has the level of a flood whose `ground` is `auto` count from the ground at this height over
    /// that of the site, m.
    pub fn stand_flood_on(&mut self, ground: f64) {
        self.flood.iter_mut().for_each(|flood| flood.ground = flood.ground.or(Some(ground)));
    }

    /// Returns where water stands, with the puddles of the place; `None` where none does.
    #[must_use]
    pub fn water(&self, puddles: Option<&Arc<WaterGrid>>) -> Option<WaterMap> {
        let flood = self.flood().map(Flood::height);
        let has_water = flood.is_some() || puddles.is_some();
        has_water.then(|| WaterMap::new(flood, puddles.cloned(), &self.site))
    }

    /// Returns the motion of the water, with the streams of the place.
    #[must_use]
    pub fn water_motion(&self, puddles: Option<&Arc<WaterGrid>>) -> WaterMotion {
        let rain = self.rain_rate();
        let (fetch, seed) = self.flood.map_or((0.0, 0), |flood| (flood.fetch, flood.seed));
        let (wind, time, strongest) = (self.wind_now.mean, self.time, self.strongest_wind);
        let depth = if self.flood().is_some() { FLOOD_DEPTH_M } else { PUDDLE_DEPTH_M };
        let forces = WaterForces { wind, strongest, fetch, rain, depth, time, seed };
        WaterMotion::new(&forces, puddles)
    }

    /// Returns what the water is like that has depth.
    #[must_use]
    pub fn water_body(&self) -> WaterBody {
        let (secchi, tint) = self.flood.map_or((10.0, None), |flood| (flood.secchi, flood.tint));
        WaterBody::new(secchi, tint, self.white())
    }

    /// The radiance of a white level board in the open, linear RGB.
    fn white(&self) -> [f64; 3] {
        let open = self.light.as_ref().and_then(|change| change.open.as_ref().map(|open| (change, open)));
        open.map_or(self.site.airlight, |(change, open)| {
            let display = change.display(&self.site);
            open.light.irradiance(open.sin_sun).map(|v| v * display)
        })
    }

    /// Returns the sky that wet walls mirror to a camera.
    #[must_use]
    pub fn sheen(&self, camera: &Camera) -> SkySheen {
        let pixel = camera.widest_pixel();
        let sky = |way: [f64; 3]| match &self.dome {
            Some(dome) => dome.reference(pixel, way).map(srgb_decode),
            None => self.site.airlight,
        };
        SkySheen::new(camera.center().to_array(), &level_axes(self.site.up), sky)
    }

    /// Returns the effect of the mean wind on what lies, while it falls and along the ground: no
    /// more than 45 degrees from straight down ([`Self::slant`]), and along the ground the more the
    /// farther it is above the threshold.
    #[must_use]
    pub fn airflow(&self) -> Airflow {
        let [x, y] = self.wind_now.mean;
        let moved = DRIFTING_SHARE * ((x.hypot(y) / self.carried).powi(3) - 1.0).clamp(0.0, 1.0);
        Airflow { slope: self.slant(FLAKE_FALL_SPEED), moved }
    }

    /// Returns the sideways drift by the mean wind, for each metre of fall at `speed`, m/s, along
    /// [`level_axes`]: no more than 1, since eddies carry drops behind what a strong wind meets.
    pub(crate) fn slant(&self, speed: f64) -> [f64; 2] {
        slant(self.wind_now.mean, speed)
    }

    /// The direction in which most of it falls, world axes, length 1: down, with the mean wind but
    /// no flatter than 45 degrees, since eddies carry drops behind what a strong wind meets. In
    /// steps of some three degrees, so that few maps of shelter serve all times and each is that of
    /// its instant alone. `None` where nothing falls.
    #[must_use]
    pub fn fall(&self) -> Option<[f64; 3]> {
        let kind = self.falling.iter().max_by(|a, b| a.rate.total_cmp(&b.rate))?;
        Some(fall_of(self.wind_now.mean, kind.mean_speed(), self.site.up))
    }
}
