//! Maps by places on a grid.

/// A map by whole numbers that say where something is. Nobody chooses them so that they collide, so
/// that a plain hash does.
pub(crate) type PlaceMap<K, V> = rustc_hash::FxHashMap<K, V>;
