//! `--camera` and the options beside it.
//!
//! A camera is named in one of three ways:
//! - `X,Y,Z:X,Y,Z`: the eye and the point it looks at, scene units, in the world:
//!   `4,-60,3 : 4, -31, 2.5`;
//! - the name of a view of the scene: a photo's file name, with or without folder and extension, or
//!   its number, from 1;
//! - a JSON file of keyframes ([`super::path`]), for its first.

use super::path::CameraPath;
use super::{DEFAULT_FOV, ViewError, ViewOptions};
use glam::DVec3;
use std::path::PathBuf;
use std::str::FromStr;
use wm_base::nearest;
use wm_scene::camera::{MAX_PIXELS, MAX_SIDE};
use wm_scene::survey::Survey;
use wm_scene::{Camera, SceneView};

/// A camera, as `--camera` takes it.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraSpec {
    /// From a point to a point, scene units, in the world: the origin of the scene is subtracted.
    LookAt {
        /// The camera centre.
        eye: DVec3,
        /// The point in the middle of the picture.
        target: DVec3,
    },
    /// The first keyframe of a file.
    File(PathBuf),
    /// A view of the scene.
    SceneView(String),
}

impl FromStr for CameraSpec {
    type Err = ViewError;

    fn from_str(text: &str) -> Result<Self, ViewError> {
        let text = text.trim();
        let fault = |problem: &str| ViewError::text("camera", text, problem);
        if text.is_empty() {
            return Err(fault("give X,Y,Z:X,Y,Z, the name of a view, or a JSON file of keyframes"));
        }
        if text.to_lowercase().ends_with(".json") {
            return Ok(Self::File(text.into()));
        }
        match text.split_once(':') {
            // Names may have a colon in them, points have commas.
            Some((eye, target)) if eye.contains(',') && target.contains(',') => {
                let point = |part| parse_point(part).map_err(|problem| fault(&problem));
                Ok(Self::LookAt { eye: point(eye)?, target: point(target)? })
            }
            None if text.split(',').count() == 3 && parse_point(text).is_ok() => {
                Err(fault("this is the eye alone; add the point it looks at: X,Y,Z:X,Y,Z"))
            }
            _ => Ok(Self::SceneView(text.into())),
        }
    }
}

impl CameraSpec {
    /// The camera in a scene with these views.
    ///
    /// # Errors
    /// [`ViewError`] if there is no such view, the file cannot be read, or the numbers make no
    /// camera.
    pub fn camera(
        &self,
        views: &[SceneView],
        survey: &Survey,
        options: &ViewOptions,
    ) -> Result<Camera, ViewError> {
        let camera = match self {
            Self::LookAt { eye, target } => {
                let fov = options.fov.unwrap_or(DEFAULT_FOV);
                let [eye, target] = [*eye, *target].map(|point| point - survey.origin);
                let camera = Camera::looking(options.size(), fov, eye, target, options.up(survey))?;
                Camera { near: options.near(survey), ..camera }
            }
            Self::File(path) => {
                let path = CameraPath::read(path, survey, options)?;
                let size = options.size.or(path.size()).unwrap_or_else(|| options.size());
                path.at(path.start(), size)
            }
            Self::SceneView(name) => of_view(find(views, name)?, survey, options)?,
        };
        camera.check()?;
        Ok(camera)
    }
}

/// The camera of a photo with what is given by hand.
///
/// # Errors
/// [`ViewError`] if the numbers make no camera.
pub fn of_view(view: &SceneView, survey: &Survey, options: &ViewOptions) -> Result<Camera, ViewError> {
    let mut camera = view.camera;
    if let Some((width, height)) = options.size {
        camera = camera.refitted(width, height);
    }
    if let Some(fov) = options.fov {
        // By way of look_at for its check of the angle.
        let eye = camera.center();
        let size = (camera.width, camera.height);
        let focal = Camera::looking(size, fov, eye, eye + camera.forward(), camera.up())?.fy;
        (camera.fx, camera.fy) = (camera.fx * focal / camera.fy, focal);
    }
    camera.near = options.near(survey);
    camera.check()?;
    Ok(camera)
}

/// The view that `name` names.
fn find<'a>(views: &'a [SceneView], name: &str) -> Result<&'a SceneView, ViewError> {
    let fault = |problem: String| ViewError::text("camera", name, problem);
    if views.is_empty() {
        return Err(fault("the scene has no views of photos; give X,Y,Z:X,Y,Z or a JSON file".into()));
    }
    // The exact name first, then less and less of it.
    let parts: [fn(&str) -> &str; 3] = [|whole| whole, file_name, stem];
    for part in parts {
        let found: Vec<&SceneView> = views.iter().filter(|view| part(&view.name) == name).collect();
        match found[..] {
            [] => {}
            [view] => return Ok(view),
            [first, second, ..] => {
                let (first, second) = (&first.name, &second.name);
                return Err(fault(format!("there is more than one, such as \"{first}\" and \"{second}\"")));
            }
        }
    }
    if let Ok(number) = name.parse::<usize>() {
        let view = number.checked_sub(1).and_then(|index| views.get(index));
        return view.ok_or_else(|| fault(format!("the views have the numbers 1 to {}", views.len())));
    }
    let names = views.iter().map(|view| file_name(&view.name));
    let stems = views.iter().map(|view| stem(&view.name));
    let near = nearest(name, names.chain(stems), 3);
    let advice = match near[..] {
        [] => format!("the views are \"{}\" to \"{}\"", views[0].name, views[views.len() - 1].name),
        _ => format!(
            "did you mean {}?",
            near.iter().map(|n| format!("\"{n}\"")).collect::<Vec<_>>().join(", ")
        ),
    };
    Err(fault(format!("the scene has no such view; {advice}")))
}

fn file_name(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or(name)
}

fn stem(name: &str) -> &str {
    let name = file_name(name);
    name.rsplit_once('.').map_or(name, |(stem, _)| if stem.is_empty() { name } else { stem })
}

/// A camera's place in a scene of this origin as `--camera` takes it, to ask for it again: eye and
/// a point 10 units ahead, in the world.
pub fn text_of(camera: &Camera, origin: DVec3) -> String {
    let text = |p: DVec3| p.to_array().map(|v| format!("{}", (v * 1e4).round() / 1e4 + 0.0)).join(",");
    let eye = camera.center() + origin;
    format!("{}:{}", text(eye), text(eye + camera.forward() * 10.0))
}

/// A picture size such as `1280x720`.
///
/// # Errors
/// [`ViewError::Text`] if it is none or a side is out of range.
pub fn parse_size(text: &str) -> Result<(u32, u32), ViewError> {
    let side = |side: &str| side.trim().parse::<u32>().ok().filter(|s| (1..=MAX_SIDE).contains(s));
    let sides = text.split_once(['x', 'X']).map(|(width, height)| (side(width), side(height)));
    match sides {
        Some((Some(width), Some(height))) if u64::from(width) * u64::from(height) <= MAX_PIXELS => {
            Ok((width, height))
        }
        _ => {
            let problem = format!("give WxH in pixels, each side 1 to {MAX_SIDE}, {MAX_PIXELS} in all");
            Err(ViewError::text("size", text, problem))
        }
    }
}

/// A direction such as `0,-1,0`, of any length but 0.
///
/// # Errors
/// [`ViewError::Text`] if it is none.
pub fn parse_direction(text: &str) -> Result<DVec3, ViewError> {
    let fault = |problem: String| ViewError::text("up", text, problem);
    let direction = parse_point(text).map_err(fault)?;
    direction.try_normalize().ok_or_else(|| fault("it has no length".into()))
}

/// Three numbers between commas.
///
/// # Errors
/// A message that says what is wrong with the text.
pub fn parse_point(text: &str) -> Result<DVec3, String> {
    let parts: Vec<&str> = text.split(',').map(str::trim).collect();
    let [x, y, z] = parts[..] else {
        return Err(format!("\"{}\" has {} numbers, a point has three: X,Y,Z", text.trim(), parts.len()));
    };
    let number = |part: &str| match part.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("\"{part}\" is not a number")),
    };
    Ok(DVec3::new(number(x)?, number(y)?, number(z)?))
}

#[cfg(test)]
mod tests {
    use super::super::testing::{survey, views};
    use super::*;
    use proptest::prelude::*;

    fn say(text: &str) -> String {
        let views = views(&["a/IMG_0012.jpg", "a/IMG_0013.jpg", "b/IMG_0013.jpg", "7.png"]);
        let camera =
            text.parse::<CameraSpec>().and_then(|s| s.camera(&views, &survey(), &ViewOptions::default()));
        camera.map_or_else(|error| error.to_string(), |camera| format!("{:.0}", camera.center().x.abs()))
    }

    #[test]
    fn three_forms() {
        let spec: CameraSpec = " 4,-60, 3 :4, -31,2.5e0".parse().unwrap();
        let (eye, target) = (DVec3::new(4.0, -60.0, 3.0), DVec3::new(4.0, -31.0, 2.5));
        assert_eq!(spec, CameraSpec::LookAt { eye, target });
        assert_eq!("way/Path.JSON".parse::<CameraSpec>().unwrap(), CameraSpec::File("way/Path.JSON".into()));
        assert_eq!("IMG:7".parse::<CameraSpec>().unwrap(), CameraSpec::SceneView("IMG:7".into()));
    }

    #[test]
    fn views_by_name_and_number() {
        // The cameras of the views stand at x = 0, 1, 2, ...
        for (text, x) in [
            ("a/IMG_0013.jpg", "1"),
            ("IMG_0012.jpg", "0"),
            ("IMG_0012", "0"),
            ("7.png", "3"),
            ("7", "3"),
            ("2", "1"),
        ] {
            assert_eq!(say(text), x, "{text}");
        }
    }

    #[test]
    fn errors_are_one_clear_line() {
        for (text, expected) in [
            ("", "camera \"\": give X,Y,Z:X,Y,Z, the name of a view, or a JSON file of keyframes"),
            ("1,2,3", "camera \"1,2,3\": this is the eye alone; add the point it looks at: X,Y,Z:X,Y,Z"),
            ("1,2:3,4,5", "camera \"1,2:3,4,5\": \"1,2\" has 2 numbers, a point has three: X,Y,Z"),
            ("1,2,x:3,4,5", "camera \"1,2,x:3,4,5\": \"x\" is not a number"),
            (",\n1:2,", "camera \",\\n1:2,\": \",\\n1\" has 2 numbers, a point has three: X,Y,Z"),
            ("1,2,inf:3,4,5", "camera \"1,2,inf:3,4,5\": \"inf\" is not a number"),
            (
                "1,2,3:1,2,3",
                "camera from 1,2,3 to 1,2,3 with up 0,0,1 has no direction or no up; look from one point to another, \
                 not along up",
            ),
            (
                "IMG_0013.jpg",
                "camera \"IMG_0013.jpg\": there is more than one, such as \"a/IMG_0013.jpg\" and \"b/IMG_0013.jpg\"",
            ),
            (
                "img_012",
                "camera \"img_012\": the scene has no such view; did you mean \"IMG_0012\", \"IMG_0013\"?",
            ),
            (
                "front door",
                "camera \"front door\": the scene has no such view; the views are \"a/IMG_0012.jpg\" to \"7.png\"",
            ),
            ("5", "camera \"5\": the views have the numbers 1 to 4"),
            ("0", "camera \"0\": the views have the numbers 1 to 4"),
        ] {
            assert_eq!(say(text), expected, "{text}");
        }
        let error =
            CameraSpec::SceneView("1".into()).camera(&[], &survey(), &ViewOptions::default()).unwrap_err();
        let expected = "camera \"1\": the scene has no views of photos; give X,Y,Z:X,Y,Z or a JSON file";
        assert_eq!(error.to_string(), expected);
    }

    #[test]
    fn what_is_given_wins() {
        let views = views(&["a.jpg"]);
        let options = ViewOptions { size: Some((200, 200)), fov: Some(30.0), near: Some(0.5), up: None };
        let camera = CameraSpec::SceneView("a".into()).camera(&views, &survey(), &options).unwrap();
        assert!((camera.fov_y() - 30.0).abs() < 1e-9);
        assert_eq!((camera.width, camera.near, camera.viewmat), (200, 0.5, views[0].camera.viewmat));
        let plain =
            CameraSpec::SceneView("a".into()).camera(&views, &survey(), &ViewOptions::default()).unwrap();
        assert_eq!(plain, Camera { near: 0.1, ..views[0].camera });
        let wide = ViewOptions { fov: Some(200.0), ..options };
        assert!(CameraSpec::SceneView("a".into()).camera(&views, &survey(), &wide).is_err());
        // Up along the view has no picture.
        let up = ViewOptions { up: Some(DVec3::X), ..options };
        assert!("0,0,0:1,0,0".parse::<CameraSpec>().unwrap().camera(&[], &survey(), &up).is_err());
    }

    #[test]
    fn a_camera_can_be_asked_for_again() {
        let camera = views(&["a", "b"])[1].camera;
        assert_eq!(text_of(&camera, DVec3::ZERO), "1,0,1.6:1,10,1.6");
        let again = text_of(&camera, DVec3::ZERO).parse::<CameraSpec>().unwrap();
        let again = again.camera(&[], &survey(), &ViewOptions::default()).unwrap();
        assert!((again.center() - camera.center()).length() < 1e-3);
        assert!((again.forward() - camera.forward()).length() < 1e-4);
    }

    #[test]
    fn sizes_and_directions() {
        assert_eq!(parse_size("1280x720").unwrap(), (1280, 720));
        assert_eq!(parse_size(" 3 X 4 ").unwrap(), (3, 4));
        for text in ["", "1280", "0x7", "1x99999", "32768x32768", "-1x2", "1x2x3"] {
            let message = parse_size(text).unwrap_err().to_string();
            let expected = "give WxH in pixels, each side 1 to 32768, 268435456 in all";
            assert_eq!(message, format!("size \"{text}\": {expected}"));
        }
        assert_eq!(parse_direction("0, -2, 0").unwrap(), DVec3::NEG_Y);
        assert_eq!(parse_direction("0,0,0").unwrap_err().to_string(), "up \"0,0,0\": it has no length");
    }

    proptest! {
        #[test]
        fn any_text_is_understood_or_refused_in_one_line(text in "(?s).{0,40}") {
            prop_assert!(!say(&text).contains('\n'));
        }

        #[test]
        fn numbers_come_back(v in prop::array::uniform6(prop::num::f64::NORMAL)) {
            let [a, b, c, d, e, f] = v;
            let spec: CameraSpec = format!("{a},{b:e}, {c} : {d},{e} ,{f}").parse().unwrap();
            prop_assert_eq!(spec, CameraSpec::LookAt { eye: DVec3::new(a, b, c), target: DVec3::new(d, e, f) });
        }
    }
}
