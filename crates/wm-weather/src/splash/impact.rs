//! A drop that hits a film of water.
//!
//! Numbers that are not laws are estimates from pictures of single drops, and marked `[E]`.

use crate::physics::WATER_DENSITY;

/// Surface tension of water, N/m, and its viscosity, Pa s, at 15 degrees.
const WATER_SURFACE_TENSION: f64 = 0.073;
const WATER_VISCOSITY: f64 = 1.1e-3;
/// Film over the drop's diameter from which water counts as deep: splashes do not change any more
/// (Mutchler and Hansen 1970).
pub(crate) const DEEP_FILM_RATIO: f64 = 3.0;
/// Film over the drop's diameter at which it throws most (the same).
const BEST_FILM_RATIO: f64 = 1.0 / 3.0;
/// Water that a drop far above the threshold throws from the best film, as a share of its own, and
/// the factors on dry ground and on deep water `[E]`.
const MAX_THROWN_SHARE: f64 = 0.3;
const DRY_GROUND_FACTOR: f64 = 0.5;
const DEEP_WATER_FACTOR: f64 = 0.4;
/// Least and greatest diameter of droplets, m; smaller ones are more frequent (the share below
/// `least + (greatest - least) u^2` is u).
pub(crate) const DROPLET_DIAMETERS_M: [f64; 2] = [1e-4, 5e-4];
/// Largest radius of a crown, diameters of the drop `[E]`.
const MAX_CROWN_RADIUS_DIAMETERS: f64 = 4.0;
/// Height of a crown over the drop's diameter and the root of its Weber number `[E]`.
const CROWN_HEIGHT: f64 = 0.05;
/// Life of a crown, s a metre of the drop's diameter, and its bounds, s.
const CROWN_LIFE_S_PER_M: f64 = 5.0;
const CROWN_LIFE_LIMITS_S: [f64; 2] = [0.005, 0.015];
/// Share of its outline that a crown hides `[E]`: a thin sheet with thick rims and fingers.
const CROWN_COVERAGE: f64 = 0.5;
/// Least diameter of drops that make a jet, m, its height and width in diameters `[E]`; so are its
/// times.
const MIN_JET_DROP_DIAMETER_M: f64 = 1.5e-3;
const JET_SIZE_DIAMETERS: [f64; 2] = [4.0, 0.4];
/// Age at which a jet rises.
pub(crate) const JET_START_S: f64 = 0.015;
pub(crate) const JET_LIFE_S: f64 = 0.045;

/// A drop that hits a film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Impact {
    /// Diameter of the drop, m.
    pub(crate) diameter: f64,
    /// Speed, m/s.
    pub(crate) speed: f64,
    /// Depth of the water that it hits, m.
    pub(crate) film: f64,
}

/// A crown at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Crown {
    /// Radius, m.
    pub(crate) radius: f64,
    /// Height, m.
    pub(crate) height: f64,
    /// Area that it hides seen from the side, m^2.
    pub(crate) area: f64,
}

impl Impact {
    /// Inertia over surface tension.
    pub(crate) fn weber(&self) -> f64 {
        WATER_DENSITY * self.speed * self.speed * self.diameter / WATER_SURFACE_TENSION
    }

    /// Viscosity over inertia and surface tension.
    pub(crate) fn ohnesorge(&self) -> f64 {
        WATER_VISCOSITY / (WATER_DENSITY * WATER_SURFACE_TENSION * self.diameter).sqrt()
    }

    /// Depth of the film over the drop's diameter, no more than that of deep water.
    fn film_ratio(&self) -> f64 {
        (self.film / self.diameter).clamp(0.0, DEEP_FILM_RATIO)
    }

    /// Cossali's splash number over that from which crowns throw droplets: they do above 1.
    pub(crate) fn excess(&self) -> f64 {
        let number = self.weber() * self.ohnesorge().powf(-0.4);
        number / (2100.0 + 5880.0 * self.film_ratio().powf(1.44))
    }

    /// Returns true if it throws droplets.
    pub(crate) fn splashes(&self) -> bool {
        self.excess() > 1.0
    }

    /// Water that it throws, as a share of its own.
    pub(crate) fn thrown(&self) -> f64 {
        MAX_THROWN_SHARE * by_film(self.film_ratio()) * (1.0 - 1.0 / self.excess()).max(0.0)
    }

    /// Mean number of droplets.
    pub(crate) fn droplets(&self) -> f64 {
        self.thrown() * self.diameter.powi(3) / mean_cube()
    }

    /// Life of its crown, s.
    pub(crate) fn life(&self) -> f64 {
        (CROWN_LIFE_S_PER_M * self.diameter).clamp(CROWN_LIFE_LIMITS_S[0], CROWN_LIFE_LIMITS_S[1])
    }

    /// Crown at an age, s. The radius follows Yarin and Weiss (1995).
    pub(crate) fn crown(&self, age: f64) -> Crown {
        let film = self.film.clamp(0.1 * self.diameter, self.diameter);
        let spread =
            (2.0f64 / 3.0).powf(0.25) * self.speed.sqrt() * self.diameter.powf(0.75) * film.powf(-0.25);
        let radius = (spread * age.max(0.0).sqrt()).min(MAX_CROWN_RADIUS_DIAMETERS * self.diameter);
        let phase = (age / self.life()).clamp(0.0, 1.0);
        let height =
            CROWN_HEIGHT * self.weber().sqrt() * self.diameter * (std::f64::consts::PI * phase).sin();
        Crown { radius, height, area: CROWN_COVERAGE * 2.0 * radius * height }
    }

    /// Height and width of its jet at an age, m; `None` where it makes none.
    pub(crate) fn jet(&self, age: f64) -> Option<[f64; 2]> {
        let phase = (age - JET_START_S) / JET_LIFE_S;
        let has_jet = self.film >= self.diameter
            && self.diameter > MIN_JET_DROP_DIAMETER_M
            && (0.0..1.0).contains(&phase);
        has_jet.then(|| {
            [
                JET_SIZE_DIAMETERS[0] * self.diameter * 4.0 * phase * (1.0 - phase),
                JET_SIZE_DIAMETERS[1] * self.diameter,
            ]
        })
    }
}

/// Factor on the water that is thrown, by the depth of the film over the drop's diameter.
fn by_film(ratio: f64) -> f64 {
    let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
    if ratio < BEST_FILM_RATIO {
        DRY_GROUND_FACTOR + (1.0 - DRY_GROUND_FACTOR) * smooth(ratio / BEST_FILM_RATIO)
    } else {
        1.0 - (1.0 - DEEP_WATER_FACTOR)
            * smooth(
                (ratio / BEST_FILM_RATIO).ln().min((DEEP_FILM_RATIO / BEST_FILM_RATIO).ln())
                    / (DEEP_FILM_RATIO / BEST_FILM_RATIO).ln(),
            )
    }
}

/// Diameter of the droplet with a share of them below it, m.
pub(crate) fn droplet(share: f64) -> f64 {
    DROPLET_DIAMETERS_M[0] + (DROPLET_DIAMETERS_M[1] - DROPLET_DIAMETERS_M[0]) * share * share
}

/// Mean cube of the diameters of droplets, m^3.
fn mean_cube() -> f64 {
    let [a, b] = [DROPLET_DIAMETERS_M[0], DROPLET_DIAMETERS_M[1] - DROPLET_DIAMETERS_M[0]];
    a.powi(3) + a * a * b + 3.0 / 5.0 * a * b * b + b.powi(3) / 7.0
}
