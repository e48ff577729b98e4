//! Flat cards of one colour: targets for measurements on rendered pictures.

use crate::splats::{Splat, logit};
use crate::{Camera, Group, Splats};
use glam::{DMat3, DQuat, DVec3};

/// A flat rectangle, opaque inside.
#[derive(Clone, Copy, Debug)]
pub struct Card {
    /// Middle, scene units.
    pub center: DVec3,
    /// From the middle to an edge.
    pub u: DVec3,
    /// From the middle to another edge, at right angles or nearly so.
    pub v: DVec3,
}

impl Card {
    /// The card that fills the pixels within `half` of `pixel`, `distance` scene units away in its
    /// middle and square to `normal`.
    #[must_use]
    pub fn over(camera: &Camera, pixel: (f64, f64), half: f64, distance: f64, normal: DVec3) -> Self {
        let center = camera.center() + distance * camera.ray(pixel.0, pixel.1);
        let meet = |x: f64, y: f64| {
            let ray = camera.ray(x, y);
            camera.center() + ray * ((center - camera.center()).dot(normal) / ray.dot(normal))
        };
        let (x, y) = pixel;
        Self {
            center,
            u: 0.5 * (meet(x + half, y) - meet(x - half, y)),
            v: 0.5 * (meet(x, y + half) - meet(x, y - half)),
        }
    }

    /// Length of the camera's ray through the picture point `(x, y)` to the card's plane, scene
    /// units.
    #[must_use]
    pub fn ray_length(&self, camera: &Camera, x: f64, y: f64) -> f64 {
        let normal = self.u.cross(self.v);
        (self.center - camera.center()).dot(normal) / camera.ray(x, y).dot(normal)
    }

    /// Adds the card to `splats` as a dense grid of `cells` (columns, rows) of flat splats
    /// of a display-referred colour, several sheets of them in one plane.
    ///
    /// Blending stops before the transmittance falls to 1e-4. Splats of opacity 1/2 halve it at
    /// most, so that it ends at 1e-4 to 2e-4 and the card is opaque within that. A sheet adds
    /// -ln(1 - alpha) over its splats, 2 pi 0.75^2 (1/2 + 1/16 + ...) = 2.05 in the mean, and more
    /// with the 0.3 px^2 by which the renderer widens splats: five sheets exceed ln 1e4 = 9.2.
    pub fn paint(&self, splats: &mut Splats, cells: (usize, usize), rgb: [f32; 3]) {
        let (columns, rows) = cells;
        let spacing = [2.0 * self.u.length() / columns as f64, 2.0 * self.v.length() / rows as f64];
        let z = self.u.cross(self.v).normalize();
        let x = self.u.normalize();
        let turn = DQuat::from_mat3(&DMat3::from_cols(x, z.cross(x), z));
        let thin = 0.01 * spacing[0].min(spacing[1]);
        for _ in 0..5 {
            for i in 0..columns {
                for j in 0..rows {
                    let [a, b] =
                        [(i, columns), (j, rows)].map(|(k, n)| (2.0 * k as f64 + 1.0) / n as f64 - 1.0);
                    splats.push(&Splat {
                        mean: (self.center + a * self.u + b * self.v).to_array().map(|v| v as f32),
                        quat: [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32),
                        log_scale: [0.75 * spacing[0], 0.75 * spacing[1], thin].map(|v| v.ln() as f32),
                        logit_opacity: logit(0.5) as f32,
                        rgb,
                        group: Group::Scene,
                    });
                }
            }
        }
    }
}
