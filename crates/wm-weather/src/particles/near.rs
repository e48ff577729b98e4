//! Falling particles near a sensor that takes no picture, such as a lidar: the same ones that
//! cameras see.

use super::fall::{DISC_SIGMA_RATIO, FallingParticles, LINE_SIGMA_RATIO, Surroundings};
use super::precipitation::{ParticleAppearance, Precipitation};
use super::spectrum::ParticleShape;
use std::f64::consts::PI;
use wm_render::hooks::{Particle, ParticleView, Particles};
use wm_render::simd::SimdPath;
use wm_scene::Camera;

/// Shortest time over which the way of a particle gives its velocity.
const MIN_VELOCITY_TIME_S: f64 = 1e-4;

/// One falling particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearParticle {
    /// Centre relative to that of the view, world axes, m.
    pub offset: [f64; 3],
    /// Velocity, world axes, m/s.
    pub velocity: [f64; 3],
    /// Visible diameter, m; of a flake not that of its water.
    pub diameter: f64,
    /// Shape.
    pub shape: ParticleShape,
}

/// The particles of one kind in front of a view, at a time and within half of a duration, s, of it.
pub(crate) fn particles(
    path: SimdPath,
    view: &ParticleView,
    kind: &Precipitation,
    around: &Surroundings<'_>,
    duration: f64,
    reach: &dyn Fn(ParticleShape, f64) -> f64,
) -> Vec<NearParticle> {
    // As they are in nature: what makes pictures of them clearer is no part of them.
    let exposure = duration.max(MIN_VELOCITY_TIME_S);
    let look = ParticleAppearance { exposure, seed: kind.look.seed, ..ParticleAppearance::default() };
    let bare = Precipitation { look, ..kind.clone() };
    let shape = kind.kind.shape;
    let ranges: Vec<f64> =
        bare.classes.iter().map(|class| reach(shape, 1e-3 * kind.kind.seen(class.diameters[1]))).collect();
    let fall = FallingParticles::new(&bare, around.clone()).within(&ranges);
    let metres = around.site.metres_per_unit;
    let mut found = Vec::new();
    each_particle(&fall, path, view, |particle| {
        let width = f64::from(particle.sigma) / DISC_SIGMA_RATIO;
        let (offset, diameter) = (particle.offset.map(|v| f64::from(v) * metres), width * metres);
        // One of the last below the density that is requested is there by a half: it is there or
        // not.
        if f64::from(particle.area) >= 0.5 * PI / 4.0 * width * width
            && offset.iter().map(|v| v * v).sum::<f64>().sqrt() <= reach(shape, diameter)
        {
            let velocity = particle.reach[0].map(|v| f64::from(v) * metres / (exposure * LINE_SIGMA_RATIO));
            found.push(NearParticle { offset, velocity, diameter, shape });
        }
    });
    found
}

/// The particles of one kind that a picture shows, with their velocity relative to the camera,
/// scene units a second, world axes.
pub(crate) fn drawn(
    path: SimdPath,
    camera: &Camera,
    kind: &Precipitation,
    around: &Surroundings<'_>,
) -> Vec<(Particle, [f64; 3])> {
    let view = ParticleView::new(camera);
    let fall = FallingParticles::new(kind, around.clone());
    // A streak is the way within the exposure.
    let seconds = kind.look.exposure * LINE_SIGMA_RATIO;
    let velocity = |one: &Particle| one.reach[0].map(|v| f64::from(v) / seconds);
    let mut found = Vec::new();
    each_particle(&fall, path, &view, |one| found.push((one, velocity(&one))));
    found
}

/// Visits all particles that a view shows.
pub(crate) fn each_particle<P: Particles + ?Sized>(
    particles: &P,
    path: SimdPath,
    view: &ParticleView,
    mut take: impl FnMut(Particle),
) {
    for part in particles.parts(view) {
        particles.gather(path, view, part, &mut |group| group.particles().for_each(&mut take));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Site;
    use crate::{Observer, Weather};
    use glam::DVec3;
    use wm_scene::Camera;

    /// The distance from a point to the nearest particle, m.
    fn nearest(particles: &[NearParticle], at: DVec3) -> f64 {
        let distances = particles.iter().map(|one| DVec3::from_array(one.offset).distance(at));
        distances.fold(f64::INFINITY, f64::min)
    }

    /// The drops of a camera's picture are found again, at the same place within a thousandth of a
    /// pixel.
    #[test]
    fn a_camera_sees_the_same_particles() {
        let eye = DVec3::new(3.0, -2.0, 1.5);
        let camera = Camera::looking((300, 200), 50.0, eye, eye + DVec3::Y, DVec3::Z).unwrap();
        let view = ParticleView::new(&camera);
        let path = SimdPath::widest();
        for (key, rate) in [("rain.rate", 10.0), ("snowfall.rate", 3.0)] {
            let weather = Weather::clear().set(key, rate).unwrap().set("wind.speed", 4.0).unwrap();
            let prepared = weather.at(7.25).prepare(&Site::PLAIN);
            let near = prepared.near_particles(path, &view, None, 0.0, 0.0, &|_, _| 3.0);
            let mut seen = Vec::new();
            for kind in prepared.pass(&Observer::at_rest(&camera)).hooks().particles {
                each_particle(kind, path, &view, |particle| seen.push(particle));
            }
            let offset = |offset: [f32; 3]| DVec3::from_array(offset.map(f64::from));
            // Those in front of the middle of the picture; flakes that show their arms are three.
            let is_near = |at: DVec3| at.length() < 1.5 && at.angle_between(DVec3::Y) < 0.3;
            let seen: Vec<DVec3> =
                seen.iter().map(|one| offset(one.offset)).filter(|at| is_near(*at)).collect();
            assert!(seen.len() > 10, "{key}: {}", seen.len());
            let farthest = seen.iter().map(|at| nearest(&near, *at)).fold(0.0, f64::max);
            assert!(farthest < 1e-5, "{key}: {farthest} m");
        }
    }

    /// A quarter of a second later the drops that are requested then are those that fly on.
    #[test]
    fn particles_fly_on_with_their_velocity() {
        let eye = DVec3::new(3.0, -2.0, 1.5);
        let camera = Camera::looking((300, 200), 90.0, eye, eye + DVec3::Y, DVec3::Z).unwrap();
        let view = ParticleView::new(&camera);
        let weather = Weather::clear().set("rain.rate", 10.0).unwrap().set("wind.speed", 4.0).unwrap();
        let prepared = weather.at(2.0).prepare(&Site::PLAIN);
        let at =
            |after: f64| prepared.near_particles(SimdPath::widest(), &view, None, after, 0.1, &|_, _| 4.0);
        let (now, then) = (at(0.0), at(0.02));
        let flown =
            now.iter().map(|one| DVec3::from_array(one.offset) + DVec3::from_array(one.velocity) * 0.02);
        let inside: Vec<DVec3> = flown
            .filter(|at| {
                at.y > 1.0 && at.x.abs() < 0.4 * at.y && at.z.abs() < 0.2 * at.y && at.length() < 3.0
            })
            .collect();
        assert!(inside.len() > 100, "{}", inside.len());
        for place in inside {
            let nearest = nearest(&then, place);
            assert!(nearest < 1e-4, "{nearest}");
        }
    }
}
