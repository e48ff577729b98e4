//! The rig of the program: the place's studio, and targets beside it in the same renderer and the same air.

use super::{Level, Rig, Shot, Subject};
use crate::parts::Picture;
use crate::studio::{Studio, sets};
use anyhow::Result;
use wm_render::parts::render_with_parts;
use wm_render::{Background, DrawPass, RenderBackend, RenderConfig, SetId};
use wm_scene::{Camera, Splats};
use wm_weather::cover::{Airflow, Asked, Buried, Cover};
use wm_weather::scan::Scan;
use wm_weather::{Seen, Site, Sky};

/// How far the second view is aside of the first, m: not ahead, so that the air between it and the place is as long.
const STEP: f64 = 0.3;

/// A place to measure at.
pub struct Field {
    /// The place.
    pub studio: Studio,
    camera: Camera,
    targets: Vec<Target>,
}

/// What an instrument has set up.
struct Target {
    splats: Splats,
    set: SetId,
    /// What may lie on it, by how the air carries it.
    cover: Option<(Airflow, Cover)>,
    lying: Option<(Vec<Asked>, SetId, Buried)>,
}

impl Field {
    /// A place that is looked at from `camera`.
    pub fn new(studio: Studio, camera: Camera) -> Self {
        Self { studio, camera, targets: Vec::new() }
    }

    /// Lays out what lies on a target.
    fn lay(&mut self, index: usize, sky: &Sky) -> Result<()> {
        let (site, renderer) = (self.studio.site, &mut self.studio.loaded.renderer);
        let Target { splats, cover, lying, .. } = &mut self.targets[index];
        let asked = sky.cover();
        if lying.as_ref().map_or(&[][..], |(known, _, _)| known) == asked {
            return Ok(());
        }
        if let Some((_, set, _)) = lying.take() {
            renderer.unload(set);
        }
        if asked.is_empty() {
            return Ok(());
        }
        let airflow = sky.airflow();
        if cover.as_ref().is_none_or(|(known, _)| *known != airflow) {
            let threads = renderer.threads();
            let middle = Level::of(&site).point([0.0; 3]).to_array();
            *cover = Some((
                airflow,
                Cover::of(splats, &Scan::plain(splats), &site, &airflow, [middle; 2], threads),
            ));
        }
        if let Some((_, cover)) = cover {
            let lies = cover.lying_on_each_other(asked);
            *lying = Some((asked.to_vec(), renderer.load(&lies.splats)?, lies.buried));
        }
        Ok(())
    }
}

impl Rig for Field {
    fn site(&self) -> Site {
        self.studio.site
    }

    fn views(&mut self) -> Result<[Camera; 2]> {
        let first = self.camera;
        let level = Level::of(&self.studio.site);
        let rotation = first.rotation();
        let step = rotation.row(0) * level.units(STEP);
        let viewmat = wm_scene::camera::viewmat_of(rotation, -(rotation * (first.center() + step)));
        Ok([first, Camera { viewmat, ..first }])
    }

    fn set_up(&mut self, splats: Splats) -> Result<Subject> {
        let set = self.studio.loaded.renderer.load(&splats)?;
        self.targets.push(Target { splats, set, cover: None, lying: None });
        Ok(Subject::Target(self.targets.len() - 1))
    }

    fn clear_away(&mut self) {
        let renderer = &mut self.studio.loaded.renderer;
        for target in self.targets.drain(..) {
            target.lying.iter().for_each(|(_, set, _)| renderer.unload(*set));
            renderer.unload(target.set);
        }
    }

    fn draw(&mut self, shot: &Shot<'_>, picture: &mut Picture) -> Result<()> {
        let index = match shot.subject {
            Subject::Place => {
                self.studio.config.outputs = shot.outputs;
                self.studio.render_parts(
                    shot.weather,
                    shot.time,
                    (*shot.camera).into(),
                    shot.parts,
                    picture,
                )?;
                return Ok(());
            }
            Subject::Target(index) => index,
        };
        let sky = shot.weather.at(shot.time).over(&self.studio.site);
        self.lay(index, &sky)?;
        let Target { set, lying, .. } = &self.targets[index];
        let sets = sets(*set, lying.as_ref().map(|(_, set, buried)| (*set, buried)));
        let background = Background::Color([0.0; 3]);
        let config = RenderConfig { outputs: shot.outputs, background, ..RenderConfig::default() };
        let renderer = &mut self.studio.loaded.renderer;
        sky.with_hooks(&Seen::by(shot.camera), |hooks| {
            let job = DrawPass::new(&sets, shot.camera, &config).with_hooks(hooks);
            (_, picture.parts) = render_with_parts(renderer, &job, shot.parts, &mut picture.frame)?;
            Ok(())
        })
    }
}
