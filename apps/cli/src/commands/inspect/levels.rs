//! The levels of detail of a scene.

use crate::scene::count_of;
use serde_json::{Value, json};
use wm_scene::levels::LevelIndex;

/// A level: its splats, and the mean over the leaves of its error, if all state one.
fn rows(index: &LevelIndex) -> impl Iterator<Item = (u32, u64, Option<f64>)> + '_ {
    (0..index.levels).map(|level| {
        let error = |sum: f64, error: Option<f32>| Some(sum + f64::from(error?));
        let mut errors = index.leaves.iter().filter_map(|leaf| Some(leaf.at_level(level)?.error));
        let mean = errors.try_fold(0.0, error).map(|sum| sum / index.leaves.len().max(1) as f64);
        (level, index.count_of_level(level), mean)
    })
}

pub(super) fn report(index: &LevelIndex) -> Value {
    json!({
        "leaves": index.leaves.len(),
        "files": index.files.len(),
        "environment": index.environment.is_some(),
        "levels": rows(index).map(|(level, splats, error)| json!({
            "level": level,
            "splats": splats,
            "error": error,
        })).collect::<Vec<_>>(),
    })
}

pub(super) fn print(index: &LevelIndex) {
    println!("Levels of detail");
    let environment = if index.environment.is_some() { ", and one that is always drawn" } else { "" };
    println!("  {} in {}{environment}", leaves(index), count_of(index.files.len(), "file"));
    for (level, splats, error) in rows(index) {
        let error = error.map(|error| format!(", error {error:.4}")).unwrap_or_default();
        println!("  level {level}: {splats} splats{error}");
    }
}

fn leaves(index: &LevelIndex) -> String {
    match index.leaves.len() {
        1 => "1 leaf".into(),
        count => format!("{count} leaves"),
    }
}
