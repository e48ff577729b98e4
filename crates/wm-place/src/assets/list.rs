//! The list of the kinds of assets.

/// Hands the list of kinds to a macro. An entry is a kind, what tells one asset of the kind from
/// another, and the type of the asset. The slowest come first: a progress bar shows the first that
/// is missing.
macro_rules! kinds {
    ($use_list:ident) => {
        $use_list! {
            Cover(Airflow) => Mutex<Cover>,
            Lying(LyingKey) => LyingCover,
            Light(()) => CaptureLight,
            SunShadows([f64; 3]) => SunShadows,
            Casters(()) => ShadowCasters,
            Lamps(LampLights) => LampShadows,
            Wet(()) => WetSurfaces,
            Shelter([f64; 3]) => Shelter,
            Occluders(()) => Occluders,
            Surfaces(()) => SceneSurfaces,
            Standing(()) => StandingOccluders,
            OpenWater(()) => OpenWater,
        }
    };
}
