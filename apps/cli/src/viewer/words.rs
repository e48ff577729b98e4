//! The words of the command line that name a scene, its facts and the options of a run.

use crate::choices::sky_word;
use crate::scene::{FactArgs, OwnSkyArgs, RunArgs, SceneArgs};
use glam::DVec3;
use std::ffi::{OsStr, OsString};
use std::path::PathBuf;
use wm_scene::survey::{FactSource, OwnSky, Survey};

/// Returns the command-line words that name a scene, with its photos' cameras, which influence snow
/// covers.
pub(crate) fn scene_words(args: &SceneArgs, sky: OwnSkyArgs, views: Option<&PathBuf>) -> Vec<OsString> {
    let mut words = vec![args.scene.clone().into_os_string()];
    let mut add = |option: &str, value: &OsStr| {
        let mut word = OsString::from(format!("--{option}="));
        word.push(value);
        words.push(word);
    };
    if let Some(level) = args.level {
        add("level", level.to_string().as_ref());
    }
    if sky.sky != OwnSky::Keep {
        add("sky", sky_word(sky.sky).as_ref());
    }
    if let Some(folder) = views {
        add("views", folder.as_os_str());
    }
    words.extend(args.repair.then(|| "--repair".into()));
    words
}

/// Returns the command-line words of the facts that were given with a scene.
pub(crate) fn given_words(facts: &FactArgs) -> Vec<String> {
    fact_words(facts.up, facts.ground, facts.metres_per_unit.or(facts.known_distance))
}

/// Returns the command-line words that give the facts of a survey, except those that are assumed.
pub(crate) fn survey_words(survey: &Survey) -> Vec<String> {
    let scale = survey.metres_per_unit;
    let is_known = scale.source != FactSource::Assumed;
    fact_words(Some(survey.up.value), Some(survey.world_ground()), is_known.then_some(scale.value))
}

fn fact_words(up: Option<DVec3>, ground: Option<f64>, metres_per_unit: Option<f64>) -> Vec<String> {
    let up = up.map(|up| format!("--up={}", up.to_array().map(|v| v.to_string()).join(",")));
    let ground = ground.map(|height| format!("--ground={height}"));
    let scale = metres_per_unit.map(|metres| format!("--metres-per-unit={metres}"));
    [up, ground, scale].into_iter().flatten().collect()
}

/// Returns the command-line words of the options of a run that change bytes.
pub(crate) fn run_words(args: &RunArgs) -> Vec<String> {
    let default = RunArgs::default();
    let mut words = Vec::new();
    if args.device != default.device {
        words.push(format!("--device={}", args.device));
    }
    if args.simd != default.simd {
        words.push(format!("--simd={}", args.simd.name()));
    }
    words
}
