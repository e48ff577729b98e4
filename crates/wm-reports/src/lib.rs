//! Weather reports as weathers: METAR, hourly tables, WMO codes, CARLA's weather parameters and plain words.
