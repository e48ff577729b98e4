"""Sweeps a lidar in clear air and in snow, and counts what it hits."""

import sys

import numpy as np

import weather_magician as wm

quick = "--quick" in sys.argv
place = wm.Renderer(wm.Scene.street(0.05 if quick else 1.0))
for weather in ("clear", "snow"):
    sweep = place.scan(weather, "vlp-16", rays=1 if quick else 7)
    counts = np.bincount(sweep["class"], minlength=len(wm.LIDAR_CLASSES))
    hits = ", ".join(f"{count} {name}" for name, count in zip(wm.LIDAR_CLASSES, counts) if count)
    print(f"{weather}: {len(sweep['range'])} points of {sweep['pulses']} pulses: {hits}")
