//! Procedural textures: colour and relief of a point of a surface.
//!
//! Every pattern is a function of the position in metres. Patterns finer than `width`, the
//! footprint of the query, fade into their mean, so that neither a far pixel nor a coarse splat
//! aliases.

use super::hash::{cell, noise3, octaves3, smoothstep};
use super::paint::{Material, Paint, rgb};
use glam::{DVec2, DVec3};

/// The spot at which a texture is evaluated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Site {
    /// World position, m.
    pub(crate) point: DVec3,
    /// Across and up (or along) the surface, m.
    pub(crate) local: DVec2,
    /// Surface coordinates, 0-1.
    pub(crate) unit: DVec2,
    /// Footprint, m.
    pub(crate) width: f64,
    /// Key of the primitive, for what differs from one to the next.
    pub(crate) key: u64,
}

/// The result of a texture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Skin {
    /// Linear albedo.
    pub(crate) albedo: DVec3,
    /// Gradient of the relief along the surface's two tangents.
    pub(crate) slope: DVec2,
}

/// The texture of `paint` at `at`.
pub(super) fn skin(paint: &Paint, at: &Site) -> Skin {
    let seed = paint.seed;
    let p = at.point;
    let flat = |albedo: DVec3| Skin { albedo, slope: DVec2::ZERO };
    match paint.material {
        Material::Asphalt => asphalt(paint, at),
        Material::Cobbles => setts(paint, at, 0.115),
        Material::Paving => slabs(paint, at),
        Material::Stone => {
            let mottle = octaves3(p, 0.5, 4, at.width, seed);
            let grit = speckle(at, 0.012, seed) * 0.10;
            flat(weathered(paint.color * (1.0 + 0.16 * mottle + grit), at, 0.25))
        }
        Material::Grass => grass(paint, at),
        Material::Soil => {
            let clod = octaves3(p, 0.25, 4, at.width, seed);
            Skin { albedo: paint.color * (1.0 + 0.4 * clod), slope: DVec2::splat(0.5 * clod) }
        }
        Material::Gravel => setts(paint, at, 0.03),
        Material::Grit => {
            let stones = speckle(at, 0.016, seed) + 0.6 * speckle(at, 0.045, seed ^ 4);
            let worn = octaves3(p, 1.3, 4, at.width, seed ^ 2);
            let damp = smoothstep(0.15, 0.5, octaves3(p, 3.5, 3, at.width, seed ^ 8));
            let albedo = paint.color * (1.0 + 0.34 * stones + 0.16 * worn);
            Skin { albedo: albedo.lerp(paint.accent, 0.35 * damp), slope: DVec2::splat(0.35 * stones) }
        }
        Material::Meadow => meadow(paint, at),
        Material::Field => field(paint, at),
        Material::Wood => {
            let clump = octaves3(p, 30.0, 5, at.width, seed);
            flat(paint.color.lerp(paint.accent, smoothstep(-0.35, 0.45, clump)) * (1.0 + 0.3 * clump))
        }
        Material::Plaster => plaster(paint, at),
        Material::Brick => brick(paint, at),
        Material::Boards => boards(paint, at, 0.14),
        Material::Timber => {
            let grain = octaves3(p * DVec3::new(6.0, 6.0, 1.2), 0.4, 3, at.width, seed);
            flat(weathered(paint.color * (1.0 + 0.12 * grain), at, 0.12))
        }
        Material::Tiles => tiles(paint, at),
        Material::Slates => slates(paint, at),
        Material::Glass => glass(paint, at),
        Material::Metal => {
            let mottle = octaves3(p, 0.3, 3, at.width, seed);
            flat(paint.color * (1.0 + 0.08 * mottle))
        }
        Material::Cloth => {
            let stripe = (at.local.x / 0.3).rem_euclid(1.0);
            let edge = (at.width / 0.3).max(0.02);
            let share = smoothstep(0.5 - edge, 0.5 + edge, 2.0 * (stripe - 0.5).abs());
            flat(paint.color.lerp(paint.accent, share))
        }
        Material::Bark => {
            let furrow = octaves3(p * DVec3::new(1.0, 1.0, 0.22), 0.09, 3, at.width, seed);
            let moss = smoothstep(0.1, 0.6, noise3(p * 1.3, seed ^ 5) - 0.35 * (p.z - 0.6));
            let albedo = paint.color * (1.0 + 0.75 * furrow);
            Skin { albedo: albedo.lerp(paint.accent, 0.4 * moss), slope: DVec2::new(0.9 * furrow, 0.0) }
        }
        Material::Birch => {
            let band = octaves3(p * DVec3::new(1.0, 1.0, 6.0), 0.35, 3, at.width, seed);
            let dark = smoothstep(0.25, 0.42, band) * 0.85 + smoothstep(1.2, 0.2, p.z) * 0.5;
            flat(paint.color.lerp(paint.accent, dark.min(0.9)) * (1.0 + 0.1 * band))
        }
        Material::Leaf => {
            let (pick, tone) = (super::hash::unit(at.key, 1), super::hash::unit(at.key, 2));
            let base = paint.color.lerp(paint.accent, smoothstep(0.55, 1.0, pick));
            let rib = 1.0 + 0.22 * smoothstep(0.06, 0.0, (at.unit.y - 0.5).abs());
            flat(base * (0.72 + 0.56 * tone) * rib)
        }
        Material::Blade => {
            let tone = super::hash::unit(at.key, 2);
            let base = paint.color.lerp(paint.accent, 0.8 * super::hash::unit(at.key, 1));
            flat(base * (0.7 + 0.5 * tone) * (0.55 + 0.6 * at.unit.y.max(at.unit.x)))
        }
        Material::Water => {
            // Ripples of a light wind, which far away add up to nothing.
            let (a, b) = (octaves3(p, 0.55, 3, at.width, seed), octaves3(p, 0.55, 3, at.width, seed ^ 6));
            let breeze = 0.4 + 0.6 * smoothstep(-0.3, 0.4, noise3(p / 9.0, seed ^ 9));
            Skin { albedo: paint.color, slope: DVec2::new(a, b) * (0.05 * breeze) }
        }
        Material::Petal => {
            let pick = super::hash::unit(at.key, 1);
            flat(
                if pick < 0.5 { paint.color } else { paint.accent }
                    * (0.8 + 0.4 * super::hash::unit(at.key, 2)),
            )
        }
    }
}

/// The mean colour, for light that bounces.
pub(super) fn mean(paint: &Paint) -> DVec3 {
    match paint.material {
        Material::Glass => DVec3::splat(0.08),
        Material::Wood | Material::Field | Material::Cloth => (paint.color + paint.accent) * 0.5,
        Material::Brick => paint.color.lerp(paint.accent, 0.15),
        Material::Leaf | Material::Blade | Material::Petal => paint.color.lerp(paint.accent, 0.3),
        _ => paint.color * 0.95,
    }
}

/// Darkened and greened towards the foot of things, with the streaks that rain leaves.
fn weathered(albedo: DVec3, at: &Site, strength: f64) -> DVec3 {
    let p = at.point;
    let edge = 0.25 * noise3(p * DVec3::new(2.1, 2.1, 0.8), 77);
    let foot = smoothstep(0.85, 0.05, p.z - 0.12 + edge);
    albedo * (DVec3::ONE - DVec3::new(0.55, 0.48, 0.56) * (strength * foot))
}

/// Single grains of size `size`, -1 to 1; they fade where the footprint holds many.
fn speckle(at: &Site, size: f64, seed: u32) -> f64 {
    let kept = smoothstep(3.0, 0.6, at.width / size);
    if kept <= 0.0 {
        return 0.0;
    }
    kept * noise3(at.point / size, seed ^ 0x51)
}

fn asphalt(paint: &Paint, at: &Site) -> Skin {
    let (p, seed) = (at.point, paint.seed);
    let large = octaves3(p, 5.0, 3, at.width, seed);
    let small = octaves3(p, 0.35, 4, at.width, seed ^ 3);
    let grit = speckle(at, 0.011, seed);
    // Two worn tracks on each side of the middle, and a darker seam between the lanes.
    let lane = (p.x.abs() - 1.35).abs();
    let tracks = smoothstep(0.75, 0.25, (lane - 0.72).abs()) * 0.10;
    let seam = smoothstep(0.05 + at.width, 0.0, (p.x + 0.05 * noise3(p * 0.7, 9)).abs()) * 0.16;
    // Trenches that were dug and closed again: rectangles, darker and smoother.
    let (row, side) = ((p.y / 11.0).floor() as i64, i64::from(p.x > 0.0));
    let start = DVec2::new(0.2 + 1.2 * cell(row, side, 7), 11.0 * row as f64 + 5.0 * cell(row, side, 8));
    let extent = DVec2::new(0.9 + 0.6 * cell(row, side, 9), 1.5 + 4.0 * cell(row, side, 10));
    let inside = DVec2::new(p.x.abs(), p.y) - start;
    let border = inside.min(extent - inside).min_element();
    let there = f64::from(u8::from(cell(row, side, 11) < 0.45));
    let patch = there * smoothstep(-at.width, at.width.max(0.01), border);
    let joint = there * smoothstep(0.03 + at.width, 0.0, border.abs());
    // Cracks follow the zero lines of a noise.
    let line = octaves3(p, 1.9, 5, at.width, seed ^ 21).abs();
    let crack = smoothstep(0.008 + 0.3 * at.width, 0.0, line) * smoothstep(0.05, 0.35, large);
    let tone = 1.0 + 0.16 * large + 0.14 * small + 0.28 * grit + tracks - seam - 0.20 * patch - 0.25 * joint;
    let albedo = paint.color * (tone * (1.0 - 0.35 * crack / (1.0 + 18.0 * at.width)));
    // Dust and damp along the gutters.
    let gutter = smoothstep(1.9, 2.8, p.x.abs() + 0.35 * noise3(p * 0.9, 31));
    Skin { albedo: albedo.lerp(paint.accent, 0.35 * gutter), slope: DVec2::splat(0.10 * grit) }
}

fn setts(paint: &Paint, at: &Site, size: f64) -> Skin {
    let seed = paint.seed;
    let row = (at.local.y / size).floor();
    let shifted = at.local.x / size + 0.5 * row.rem_euclid(2.0) + 0.25 * cell(row as i64, 3, seed);
    let column = shifted.floor();
    let (fx, fy) = (shifted - column - 0.5, at.local.y / size - row - 0.5);
    let tone = cell(column as i64, row as i64, seed);
    let blur = (at.width / size).max(0.05);
    let distance = fx.abs().max(fy.abs()) + 0.10 * (fx * fy).abs() * 4.0;
    let joint =
        smoothstep(0.47 - 0.5 * blur, 0.47 + 0.5 * blur, distance) * (1.0 - 0.6 * smoothstep(0.3, 1.2, blur));
    let fade = smoothstep(1.3, 0.4, blur);
    let mottle = octaves3(at.point, 1.2, 4, at.width, seed ^ 2);
    let stone = paint.color * (1.0 + 0.42 * (tone - 0.5) * (0.4 + 0.6 * fade) + 0.14 * mottle);
    let dome = DVec2::new(fx, fy) * (-1.1 * fade);
    Skin { albedo: stone.lerp(paint.accent, 0.85 * joint), slope: dome * distance * 1.6 }
}

fn slabs(paint: &Paint, at: &Site) -> Skin {
    let seed = paint.seed;
    let (long, wide) = (0.60, 0.40);
    let row = (at.local.y / wide).floor();
    let shifted = at.local.x / long + 0.5 * row.rem_euclid(2.0);
    let column = shifted.floor();
    let (fx, fy) = ((shifted - column) * long, at.local.y - row * wide);
    let border = fx.min(long - fx).min(fy).min(wide - fy);
    let joint = smoothstep(0.006 + 0.6 * at.width.max(0.004), 0.002, border) / (1.0 + 9.0 * at.width);
    let (tone, hue) =
        (cell(column as i64, row as i64, seed) - 0.5, cell(column as i64, row as i64, seed ^ 8) - 0.5);
    let mottle = octaves3(at.point, 1.6, 5, at.width, seed ^ 2);
    let grit = speckle(at, 0.010, seed) * 0.10;
    let tint = DVec3::new(1.0 + 0.05 * hue, 1.0, 1.0 - 0.06 * hue);
    let albedo = paint.color * tint * (1.0 + 0.20 * tone + 0.17 * mottle + grit);
    Skin { albedo: albedo.lerp(paint.accent, 0.75 * joint), slope: DVec2::ZERO }
}

fn grass(paint: &Paint, at: &Site) -> Skin {
    let (p, seed) = (at.point, paint.seed);
    let large = octaves3(p, 3.0, 3, at.width, seed);
    let small = octaves3(p * DVec3::new(1.0, 1.0, 0.3), 0.16, 4, at.width, seed ^ 7);
    let base = paint.color.lerp(paint.accent, smoothstep(-0.3, 0.5, large + 0.4 * small));
    Skin { albedo: base * (1.0 + 0.55 * small + 0.12 * large), slope: DVec2::splat(0.55 * small) }
}

/// Blades under a foot, tufts under a stride, patches under a tree: contrast at every distance.
fn meadow(paint: &Paint, at: &Site) -> Skin {
    let (p, seed) = (at.point, paint.seed);
    let large = octaves3(p, 3.0, 3, at.width, seed);
    let tufts = octaves3(p * DVec3::new(1.0, 1.0, 0.3), 0.34, 3, at.width, seed ^ 7);
    // Blades: thin streaks that lie every way, two crossed noises a few millimetres wide.
    let along = DVec3::new(p.x + 0.4 * p.y, p.y, p.z);
    let blades = speckle(&Site { point: along * DVec3::new(1.0, 0.22, 1.0), ..*at }, 0.011, seed)
        + speckle(&Site { point: along * DVec3::new(0.25, 1.0, 1.0), ..*at }, 0.013, seed ^ 9);
    let base = paint.color.lerp(paint.accent, smoothstep(-0.3, 0.5, large + 0.6 * tufts + 0.4 * blades));
    // Between tufts one looks down to the shaded ground.
    let gap = smoothstep(0.12, 0.5, -tufts - 0.35 * blades);
    let tone = (1.0 + 0.5 * tufts + 0.42 * blades + 0.12 * large) * (1.0 - 0.45 * gap);
    Skin { albedo: base * tone.clamp(0.15, 1.6), slope: DVec2::splat(0.45 * tufts + 0.3 * blades) }
}

fn field(paint: &Paint, at: &Site) -> Skin {
    let p = at.point;
    let (u, v) = ((p.x + 0.22 * p.y) / 120.0, (p.y - 0.15 * p.x) / 90.0);
    let kind = cell(u.floor() as i64, v.floor() as i64, paint.seed);
    let tuft = octaves3(p, 14.0, 6, at.width, paint.seed);
    let straw = rgb(0xB9A566);
    let base = if kind < 0.35 {
        paint.color
    } else if kind < 0.75 {
        paint.accent
    } else {
        straw
    };
    Skin { albedo: base * (1.0 + 0.25 * tuft), slope: DVec2::ZERO }
}

fn plaster(paint: &Paint, at: &Site) -> Skin {
    let (p, seed) = (at.point, paint.seed);
    let cloud = octaves3(p, 2.6, 4, at.width, seed);
    let rough = octaves3(p, 0.06, 2, at.width, seed ^ 3);
    // Rain streaks: noise drawn out downwards.
    let streak = octaves3(p * DVec3::new(1.0, 1.0, 0.09), 0.22, 3, at.width, seed ^ 9);
    let tone = 1.0 + 0.06 * cloud + 0.02 * rough + 0.06 * streak.min(0.1);
    let albedo = weathered(paint.color * tone, at, 0.5);
    Skin { albedo, slope: DVec2::new(0.06 * rough, 0.06 * octaves3(p, 0.06, 2, at.width, seed ^ 4)) }
}

fn brick(paint: &Paint, at: &Site) -> Skin {
    let seed = paint.seed;
    let (long, high) = (0.25, 0.075);
    let row = (at.local.y / high).floor();
    let shifted = at.local.x / long + 0.5 * row.rem_euclid(2.0);
    let column = shifted.floor();
    let (fx, fy) = ((shifted - column) * long, at.local.y - row * high);
    let border = fx.min(long - fx).min(fy).min(high - fy);
    let soft = at.width.max(0.005) * 0.6;
    let face = smoothstep(0.005 - soft, 0.005 + soft, border);
    let face = face + (0.82 - face) * smoothstep(0.025, 0.07, at.width);
    let kept = smoothstep(0.20, 0.05, at.width);
    let (tone, burnt) = (cell(column as i64, row as i64, seed), cell(column as i64, row as i64, seed ^ 5));
    let cloud = octaves3(at.point, 2.2, 5, at.width, seed ^ 2);
    let mut stone = paint.color * (1.0 + kept * 0.34 * (tone - 0.5) + 0.13 * cloud);
    stone *= DVec3::ONE - DVec3::new(0.30, 0.25, 0.20) * kept * smoothstep(0.84, 0.95, burnt);
    let mortar = paint.accent * (1.0 + 0.2 * cloud);
    let slope = DVec2::new(0.0, 0.35 * (1.0 - face) * (0.5 - fy / high).signum() * kept);
    Skin { albedo: weathered(mortar.lerp(stone, face), at, 0.4), slope }
}

fn boards(paint: &Paint, at: &Site, high: f64) -> Skin {
    let row = (at.local.y / high).floor();
    let f = at.local.y / high - row;
    let tone =
        cell(row as i64, (at.local.x / 3.2 + cell(row as i64, 1, paint.seed)).floor() as i64, paint.seed);
    let grain = octaves3(at.point * DVec3::new(0.7, 0.7, 9.0), 0.5, 3, at.width, paint.seed);
    let blur = (at.width / high).max(0.05);
    let shadow = smoothstep(1.0 - 0.10 - blur, 1.0, f) / (1.0 + 2.0 * blur);
    let albedo = paint.color * (1.0 + 0.10 * (tone - 0.5) + 0.07 * grain - 0.45 * shadow);
    // Lapped boards lean out at their lower edge.
    Skin { albedo: weathered(albedo, at, 0.35), slope: DVec2::new(0.0, -0.12) }
}

fn tiles(paint: &Paint, at: &Site) -> Skin {
    let seed = paint.seed;
    let (wide, high) = (0.22, 0.33);
    let row = (at.local.y / high).floor();
    let across = at.local.x / wide + 0.06 * (cell(row as i64, 2, seed) - 0.5);
    let column = across.floor();
    let (fx, fy) = (across - column, at.local.y / high - row);
    let kept = smoothstep(0.24, 0.06, at.width);
    let (tone, hue) = (cell(column as i64, row as i64, seed), cell(column as i64, row as i64, seed ^ 6));
    let cloud = octaves3(at.point, 3.0, 5, at.width, seed ^ 2);
    let moss = smoothstep(0.22, 0.75, octaves3(at.point, 1.1, 4, at.width, seed ^ 4) + 0.1 * cloud);
    let tint = DVec3::new(1.0, 1.0 - 0.10 * hue, 1.0 - 0.16 * hue);
    let mut albedo = paint.color * tint * (1.0 + (0.25 + 0.75 * kept) * 0.42 * (tone - 0.5) + 0.16 * cloud);
    albedo = albedo.lerp(paint.accent, 0.42 * moss);
    // The course above shades the upper end; the butt of each course is dark.
    let edge = smoothstep(0.86, 0.98, fy) * 0.55 + smoothstep(0.06, 0.0, fy) * 0.25;
    let valley = smoothstep(0.30, 0.5, (fx - 0.5).abs()) * 0.30;
    albedo *= 1.0 - kept * (edge + valley) - (1.0 - kept) * 0.13;
    let wave = -0.75 * (std::f64::consts::TAU * fx).sin() * kept;
    Skin { albedo, slope: DVec2::new(wave, -0.08) }
}

fn slates(paint: &Paint, at: &Site) -> Skin {
    let seed = paint.seed;
    let (wide, high) = (0.26, 0.19);
    let row = (at.local.y / high).floor();
    let shifted = at.local.x / wide + 0.5 * row.rem_euclid(2.0);
    let column = shifted.floor();
    let (fx, fy) = (shifted - column, at.local.y / high - row);
    let kept = smoothstep(0.20, 0.05, at.width);
    let tone = cell(column as i64, row as i64, seed);
    let cloud = octaves3(at.point, 2.6, 5, at.width, seed ^ 2);
    let edge = smoothstep(0.84, 0.98, fy) * 0.45;
    let joint = smoothstep(0.47, 0.5, (fx - 0.5).abs()) * 0.35;
    let lichen = smoothstep(0.25, 0.8, octaves3(at.point, 0.6, 4, at.width, seed ^ 4));
    let albedo = paint.color * (1.0 + (0.3 + 0.7 * kept) * 0.5 * (tone - 0.5) + 0.16 * cloud);
    let albedo = albedo.lerp(paint.accent, 0.30 * lichen) * (1.0 - kept * (edge + joint));
    Skin { albedo, slope: DVec2::new(0.25 * (tone - 0.5) * kept, -0.05) }
}

/// Behind a pane: a dim room with curtains at the sides and, here and there, a blind.
fn glass(paint: &Paint, at: &Site) -> Skin {
    let (kind, open) = (super::hash::unit(at.key, 4), super::hash::unit(at.key, 5));
    let (a, b) = (at.unit.x, at.unit.y);
    let room = DVec3::new(0.020, 0.021, 0.024) * (0.7 + 1.2 * b);
    if paint.color.x < 0.05 {
        return Skin { albedo: room, slope: DVec2::ZERO };
    }
    let fold = 0.5 + 0.5 * ((at.local.x * 52.0 + 3.0 * (at.local.y * 1.3).sin()).sin());
    let fold = fold + (0.5 - fold) * smoothstep(0.04, 0.12, at.width);
    let cloth = paint.color * (0.55 + 0.45 * fold) * 0.42;
    let gather = 0.10 + 0.16 * open + 0.10 * (1.0 - b) * (b - 0.35).max(0.0);
    let side = smoothstep(gather + 0.02, gather - 0.01, a.min(1.0 - a));
    let share = if kind < 0.62 {
        side
    } else if kind < 0.82 {
        // A half-height net.
        0.8 * smoothstep(0.56, 0.54, b)
    } else {
        smoothstep(0.70 + 0.15 * open, 0.72 + 0.15 * open, b)
    };
    Skin { albedo: room.lerp(cloth, share), slope: DVec2::ZERO }
}

#[cfg(test)]
mod tests {
    use super::super::hash::Dice;
    use super::*;

    /// No pattern may shine: albedo stays inside what surfaces have.
    #[test]
    fn albedo_is_that_of_matter() {
        let mut dice = Dice::new(6, 0);
        use Material::*;
        let all = [
            Asphalt, Cobbles, Paving, Stone, Grass, Soil, Gravel, Grit, Field, Wood, Plaster, Brick, Boards,
            Timber, Tiles, Slates, Glass, Metal, Cloth, Bark, Birch, Leaf, Blade, Petal, Water, Meadow,
        ];
        for material in all {
            let paint = Paint { material, color: rgb(0xE0D8C8), accent: rgb(0x404030), seed: 9 };
            for width in [0.002, 0.05, 1.0] {
                for _ in 0..200 {
                    let point = dice.direction() * 50.0;
                    let unit = DVec2::new(dice.unit(), dice.unit());
                    let at =
                        Site { point, local: point.truncate(), unit, width, key: (dice.unit() * 1e9) as u64 };
                    let skin = skin(&paint, &at);
                    assert!(
                        skin.albedo.min_element() >= 0.0 && skin.albedo.max_element() < 1.3,
                        "{material:?}"
                    );
                    assert!(skin.slope.is_finite() && skin.slope.length() < 3.0, "{material:?}");
                }
            }
        }
    }
}
