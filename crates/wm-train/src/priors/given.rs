//! Turns what a source says of a photo into a prior.

use super::fit::{Fit, FitError, Freedom};
use super::relative::{self, Relative, SeenPoint};
use super::sky::{SkyInput, below_horizon, classify};
use super::{Prior, SkyClass};
use crate::photos::Photo;
use thiserror::Error;
use wm_base::statistics;
use wm_capture::CaptureUp;
use wm_image::maps::{Filter, Map};

/// Holes in depth above which it does not tell the sky, as a share.
const MAX_HOLE_SHARE: f64 = 0.01;
/// Share of a photo that may be the sky.
const MAX_SKY_SHARE: f64 = 0.99;
/// Most that given normals may be off those of the depth in the median, degrees.
const MAX_NORMAL_ANGLE_DEG: f64 = 45.0;

/// The way in which depth tells the sky, where no map does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SkyBy {
    /// The least values are the sky's, as in networks' output.
    Least,
    /// 0 is: infinitely far. The photo's colours, where nothing is 0.
    Zero,
}

/// Depth of a photo, before it is fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct GivenDepth {
    /// Inverse view z but for what is free, near is large, `[H, W]`, NaN where it is not known.
    pub values: Vec<f32>,
    /// The unknowns of its scale.
    pub freedom: Freedom,
    /// The way in which it tells the sky.
    pub sky_by: SkyBy,
}

/// The maps that a source gives of one photo; arrays of a size of their own over the whole photo.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Given {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Depth.
    pub depth: Option<GivenDepth>,
    /// `[H, W, 3]`, world axes, 0 where it is not known. Without it, that of the depth.
    pub normal: Option<Vec<[f32; 3]>>,
    /// `[H, W]`. Without it, what depth tells.
    pub sky: Option<Vec<SkyClass>>,
}

/// A reason why a photo has no prior.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum NoPrior {
    /// The depth does not fit the points.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// Normals and depth contradict each other.
    #[error(
        "its normals are {0:.0} degrees off those of its depth in the median; they are in other axes, perhaps"
    )]
    Askew(f64),
    /// There is nothing else.
    #[error("all of it is sky")]
    AllSky,
}

impl Given {
    /// The prior of a photo that shows `points`, and how its depth was fitted.
    ///
    /// # Errors
    /// [`NoPrior`] if it is left out.
    ///
    /// # Panics
    /// If the arrays are not of the size.
    pub fn prior(
        self,
        photo: &Photo,
        points: &[SeenPoint],
        up: Option<&CaptureUp>,
        seed: u64,
    ) -> Result<(Prior, Option<Fit>), NoPrior> {
        let (width, height) = (self.width, self.height);
        let (mut prior, fit) = match self.depth {
            Some(depth) => {
                let (width, height) = (width as usize, height as usize);
                let sky = self.sky.unwrap_or_else(|| {
                    let below = below_horizon(&photo.camera, width, height, up);
                    depth.sky(&resized(photo, self.width, self.height), width, points, &below)
                });
                let relative = Relative { width, height, values: depth.values, freedom: depth.freedom, sky };
                relative::prior(relative, &photo.camera, points, seed)?
            }
            None => (Prior { width, height, sky: self.sky.unwrap_or_default(), ..Prior::default() }, None),
        };
        if let Some(normal) = self.normal {
            if let Some(degrees) =
                median_angle_deg(&normal, &prior.normal).filter(|degrees| *degrees > MAX_NORMAL_ANGLE_DEG)
            {
                return Err(NoPrior::Askew(degrees));
            }
            prior.normal = normal;
            prior.clear_sky();
        }
        let sky = prior.sky.iter().filter(|class| **class == SkyClass::Sky).count();
        if sky as f64 > MAX_SKY_SHARE * f64::from(width) * f64::from(height) {
            return Err(NoPrior::AllSky);
        }
        Ok((prior, fit))
    }
}

impl GivenDepth {
    /// Returns the sky as depth tells it, and by the photo's colours where it does not, `[H, W]`.
    fn sky(&self, rgb: &[u8], width: usize, points: &[SeenPoint], below: &[bool]) -> Vec<SkyClass> {
        let height = self.values.len() / width;
        let points: Vec<[f32; 2]> = points.iter().map(|point| point.pixel(width, height)).collect();
        let holes = self.values.iter().filter(|v| v.is_nan()).count();
        let is_whole = holes as f64 <= MAX_HOLE_SHARE * self.values.len() as f64;
        let input = SkyInput { rgb, width, far: None, has_depth: &[], below, points: &points };
        if self.sky_by == SkyBy::Least && is_whole {
            return classify(&SkyInput { far: Some(&self.values), ..input });
        }
        if self.sky_by == SkyBy::Zero && self.values.contains(&0.0) {
            let class = |v: &f32| match *v {
                0.0 => SkyClass::Sky,
                v if v > 0.0 => SkyClass::Place,
                _ => SkyClass::Unknown,
            };
            return self.values.iter().map(class).collect();
        }
        let has_depth: Vec<bool> = self.values.iter().map(|v| !v.is_nan()).collect();
        classify(&SkyInput { has_depth: &has_depth, ..input })
    }
}

/// The median of the angles between normals, degrees; `None` where none are known of both.
fn median_angle_deg(first: &[[f32; 3]], second: &[[f32; 3]]) -> Option<f64> {
    let known = first.iter().zip(second).filter(|(a, b)| **a != [0.0; 3] && **b != [0.0; 3]);
    let mut cosines: Vec<f64> =
        known.map(|(a, b)| f64::from(a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).clamp(-1.0, 1.0)).collect();
    statistics::median(&mut cosines).map(|cosine| cosine.acos().to_degrees())
}

/// The colours of a photo in the size of a map, `[H, W, 3]`, sRGB.
fn resized(photo: &Photo, width: u32, height: u32) -> Vec<u8> {
    if (photo.width, photo.height) == (width, height) {
        return photo.rgb.clone();
    }
    let values = photo.rgb.iter().map(|v| f32::from(*v)).collect();
    let map = Map::new(photo.width, photo.height, 3, values).resampled(width, height, Filter::Area);
    map.values.iter().map(|v| (v + 0.5) as u8).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use wm_scene::Camera;

    /// Grey ground below a blue sky, a wall 4 units ahead; the lower half of a photo of 40x20 px.
    fn photo() -> Photo {
        let camera = Camera::looking((40, 20), 50.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap();
        let rgb = (0..800).flat_map(|i| if i < 400 { [100, 150, 230] } else { [90, 60, 40] }).collect();
        Photo { width: 40, height: 20, rgb, mask: None, camera }
    }

    fn points() -> Vec<SeenPoint> {
        (0..40).map(|i| SeenPoint { at: [f64::from(i) / 40.0, 0.75], z: 4.0 }).collect()
    }

    fn depth(freedom: Freedom, upper: f32) -> Given {
        let values = (0..800).map(|i| if i < 400 { upper } else { 0.5 }).collect();
        let depth = Some(GivenDepth { values, freedom, sky_by: SkyBy::Zero });
        Given { width: 40, height: 20, depth, ..Given::default() }
    }

    #[test]
    fn each_part_may_be_given_alone() {
        let classes: Vec<SkyClass> =
            (0..800).map(|i| if i < 400 { SkyClass::Sky } else { SkyClass::Place }).collect();
        let only = Given { width: 40, height: 20, sky: Some(classes.clone()), ..Given::default() };
        let (prior, fit) = only.prior(&photo(), &[], None, 0).unwrap();
        assert!(prior.disparity.is_empty() && prior.normal.is_empty() && fit.is_none());
        assert_eq!(prior.sky, classes);
        let normal = Some(vec![[0.0, -1.0, 0.0]; 800]);
        let only = Given { width: 40, height: 20, normal, ..Given::default() };
        let (prior, _) = only.prior(&photo(), &[], None, 0).unwrap();
        assert!(prior.sky.is_empty() && prior.normal == vec![[0.0, -1.0, 0.0]; 800]);
        let all = Given { width: 40, height: 20, sky: Some(vec![SkyClass::Sky; 800]), ..Given::default() };
        assert_eq!(all.prior(&photo(), &[], None, 0), Err(NoPrior::AllSky));
    }

    #[test]
    fn the_sky_is_infinitely_far_or_as_blue_as_it_is() {
        for upper in [0.0, f32::NAN] {
            let (prior, fit) = depth(Freedom::Scale, upper).prior(&photo(), &points(), None, 0).unwrap();
            assert_eq!([prior.sky[20], prior.sky[780]], [SkyClass::Sky, SkyClass::Place]);
            assert_eq!([prior.disparity[20], prior.disparity[780]], [0.0, 0.25], "{fit:?}");
        }
        // A known scale needs no points, but they may contradict it.
        let (prior, fit) = depth(Freedom::Known(0.5), 0.0).prior(&photo(), &[], None, 0).unwrap();
        assert_eq!((prior.disparity[780], prior.sigma, fit), (0.25, 0.005, None));
        // The wall looks at the camera, along -y.
        let turned = |normal: [f32; 3]| {
            let given = Given { normal: Some(vec![normal; 800]), ..depth(Freedom::Known(0.5), 0.0) };
            given.prior(&photo(), &[], None, 0)
        };
        assert_eq!(turned([0.0, -1.0, 0.0]).unwrap().0.normal[780], [0.0, -1.0, 0.0]);
        let fault = turned([0.0, 0.0, 1.0]).unwrap_err().to_string();
        assert!(fault.starts_with("its normals are 90 degrees off"), "{fault}");
        let fault = depth(Freedom::Known(0.8), 0.0).prior(&photo(), &points(), None, 0).unwrap_err();
        assert!(matches!(fault, NoPrior::Fit(FitError::Poor { .. })), "{fault}");
    }
}
