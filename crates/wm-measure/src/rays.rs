//! Transmittance along the rays of the place itself.
//!
//! A view of the place gives, a pixel, the depth of what it shows and the share of its light that
//! the air lets through. The logarithm of that share must be the expected extinction, integrated
//! along the ray to that depth: numerically, since the air may thin with height. Pixels on edges,
//! where a pixel shows two depths, are left out: expected and median depth must agree; and so is
//! the sky, whose splats stand for what is endlessly far: it is what even the thinnest fog hides.
//!
//! Tolerance 3 %: of the median of measured over asked optical depth, over all rays between 0.03
//! and 4, and of how far single rays are off. A splat is dimmed by the length of its own ray; on
//! slanted surfaces the splats of a pixel are nearer and farther than its depth.

use super::plot::Series;
use super::{AIR, Bench, Instrument, MeasuredPicture, ShotSubject, Tolerance, clear, expected, median};
use glam::DVec3;
use wm_place::Result;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "rays",
    title: "Transmittance along rays",
    about: "A view of the place itself: at each pixel the share of light that the air lets through, against the extinction that is asked \
            for, integrated along that ray to the depth that it shows. Heights count, where the air thins upwards.",
    applies: |weather, time| !expected::airs(weather, time).is_empty(),
    measure,
    sweep: &[
        "fog.mor=50",
        "fog.mor=100",
        "fog.mor=200",
        "fog.mor=500",
        "fog.mor=60, fog.scale_height=10",
        "haze.mor=1000",
    ],
};

/// Optical depths that are told from nothing and from everything.
const OPTICAL_DEPTH_RANGE: std::ops::Range<f64> = 0.03..4.0;
/// Largest relative difference of expected and median depth.
const DEPTH_TOLERANCE: f64 = 0.02;
/// Range of the thin air that tells the sky, in sizes of the place.
const THIN_AIR_RANGE_SIZES: f64 = 100.0;
/// Distance of the pixels that are taken, px.
const PIXEL_STEP: usize = 3;

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let site = bench.level.site;
    let [camera, _] = bench.rig.views()?;
    let weather = bench.with("rain=off, snowfall=off, snow_cover=off, dust_cover=off")?;
    let picture = bench.draw(ShotSubject::Place, &camera, &weather, AIR)?;
    let (frame, shares) = (&picture.frame, &picture.parts.transmittance);
    // Air that is as good as clear as far as the place goes, and takes all light from what is
    // endlessly far.
    let mut thin = clear();
    thin.set_text(&format!("fog.mor={}", (THIN_AIR_RANGE_SIZES * site.far).max(1.0)))?;
    let sky = bench.draw(ShotSubject::Place, &camera, &thin, AIR)?;
    let nearness = &sky.parts.transmittance;
    let airs = expected::airs(&weather, bench.time);
    let up = DVec3::from_array(site.up);
    let height = (camera.center().dot(up) - site.ground) * site.metres_per_unit;
    let mut points = Vec::new();
    for y in (0..camera.height as usize).step_by(PIXEL_STEP) {
        for x in (0..camera.width as usize).step_by(PIXEL_STEP) {
            let at = y * camera.width as usize + x;
            let (z, other) = (f64::from(frame.depth[at]), f64::from(frame.median_depth[at]));
            let is_sharp = (other / z - 1.0).abs() < DEPTH_TOLERANCE;
            if frame.alpha[at] < 0.99 || !is_sharp || nearness[3 * at + 1] < 0.8 {
                continue;
            }
            let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
            let metres = z / ray.dot(camera.forward()) * site.metres_per_unit;
            let wanted: f64 =
                airs.iter().map(|air| air.sigma_t[1] * air.length(height, ray.dot(up), metres)).sum();
            let found = -f64::from(shares[3 * at + 1]).ln();
            if OPTICAL_DEPTH_RANGE.contains(&wanted) && found.is_finite() {
                points.push([wanted, found]);
            }
        }
    }
    // The median: some edges slip through.
    let ratio = median(points.iter().map(|p| p[1] / p[0]).collect());
    let off = median(points.iter().map(|p| (p[1] / p[0] - 1.0).abs()).collect());
    let count = points.len();
    bench.add(
        format!("optical depth over the integral, median of {count} rays"),
        "",
        [1.0, if count < 100 { f64::NAN } else { ratio }],
        Tolerance::Relative(0.03),
    );
    bench.add("single rays are off by, median", "", [0.0, off], Tolerance::Absolute(0.03));
    let few = points.iter().step_by((count / 600).max(1)).copied().collect();
    bench.plot(
        "Optical depth of rays",
        "asked: integral along the ray",
        "measured: -ln of the transmittance",
        vec![
            Series::line("equal", vec![[0.0; 2], [OPTICAL_DEPTH_RANGE.end; 2]]),
            Series::points("rays of one view", few),
        ],
    );
    let size = (camera.width, camera.height);
    bench.show_place(frame);
    let shares = shares.iter().skip(1).step_by(3).copied();
    bench.show_picture(MeasuredPicture::grey("transmittance, white is all", shares, size));
    Ok(())
}
