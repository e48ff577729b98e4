//! The splats of snow or dust at one instant.

use super::cover::lock;
use crate::Result;
use crate::assets::AssetKey;
use crate::assets::key::LyingKey;
use crate::assets::kind::{Asset, Cost, Keep, Workshop};
use std::sync::Mutex;
use wm_weather::cover::{Cover, LyingCover};

impl Asset for LyingCover {
    const WORK: &'static str = "laying out the snow";
    // The renderer keeps it.
    const KEEP: Keep = Keep::IfAsked;

    fn cost(key: &LyingKey) -> Cost {
        match key {
            LyingKey::Physical(..) => Cost::Quick,
            LyingKey::Paper(_) => Cost::Slow,
        }
    }

    fn needs(key: &LyingKey) -> Vec<AssetKey> {
        match key {
            LyingKey::Physical(airflow, _) => vec![AssetKey::Cover(*airflow)],
            LyingKey::Paper(_) => Vec::new(),
        }
    }

    fn make(key: &LyingKey, workshop: &Workshop<'_>) -> Result<Self> {
        match key {
            LyingKey::Physical(airflow, requests) => {
                Ok(lock(workshop.get::<Mutex<Cover>>(*airflow)).lay_all(requests))
            }
            LyingKey::Paper(paper) => {
                Ok(Self::on_top(paper.snow(workshop.source.splats()?, &workshop.source.site)))
            }
        }
    }
}
