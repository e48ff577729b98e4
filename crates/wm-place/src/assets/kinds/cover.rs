//! The ground that snow and dust can lie on, by the airflow that carries them.

use crate::Result;
use crate::assets::AssetKey;
use crate::assets::cache::AssetFile;
use crate::assets::kind::{Asset, AssetFiles, Keep, Workshop};
use std::sync::{Mutex, MutexGuard, PoisonError};
use wm_weather::cover::{Airflow, Cover};
use wm_weather::open_water::OpenWater;

/// Airflows whose covers are kept.
const MAX_AIRFLOWS: usize = 2;

/// Locks a cover. A panic of another thread leaves it whole: its ladder of depths only grows.
pub(crate) fn lock(cover: &Mutex<Cover>) -> MutexGuard<'_, Cover> {
    cover.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Asset for Mutex<Cover> {
    const WORK: &'static str = "finding what snow can lie on";
    const FILES: Option<AssetFiles<Self>> = Some(AssetFiles {
        name: |Airflow { slope, moved }| AssetFile {
            word: "cover",
            numbers: vec![slope[0], slope[1], *moved],
        },
        read: |_, cache, file, splats| {
            cache.get(file).filter(|cover: &Cover| cover.is_consistent(splats)).map(Self::new)
        },
        write: |cover, cache, file| cache.put(file, &*lock(cover)),
    });
    const KEEP: Keep = Keep::Last(MAX_AIRFLOWS);
    // With what has slid when it was first used.
    const FILE_COMES_LAST: bool = true;

    fn needs(_: &Airflow) -> Vec<AssetKey> {
        vec![AssetKey::Surfaces(()), AssetKey::OpenWater(())]
    }

    fn make(airflow: &Airflow, workshop: &Workshop<'_>) -> Result<Self> {
        let source = workshop.source;
        let found = workshop.surfaces()?;
        let water = workshop.get::<OpenWater>(());
        let (splats, site) = (source.splats()?, &source.site);
        let cover = Cover::of(splats, &found, site, airflow, source.path());
        Ok(Self::new(cover.off_water(water)))
    }
}

#[cfg(test)]
mod tests {
    use super::Cover;

    #[test]
    fn covers_that_older_programs_wrote_are_read() {
        // No rings, 1 m per unit, no spots, walls or depths, and 2 threads.
        let bytes = [&[0][..], &1f64.to_le_bytes(), &[0, 0, 0, 2]].concat();
        assert!(postcard::from_bytes::<Cover>(&bytes).is_ok());
        assert!(postcard::from_bytes::<Cover>(&bytes[..bytes.len() - 1]).is_err());
    }
}
