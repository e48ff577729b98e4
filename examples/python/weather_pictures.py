"""Renders a scene in fog, rain and snow: python examples/python/weather_pictures.py garden.ply

Without a scene it renders the built-in street.
"""

import sys

import weather_magician as wm

paths = [word for word in sys.argv[1:] if not word.startswith("--")]
quick = "--quick" in sys.argv

scene = wm.Scene.open(paths[0]) if paths else wm.Scene.street(0.05 if quick else 1.0)
place = wm.Renderer(scene)
camera = place.camera(size=(120, 80) if quick else (1200, 800))

# Visibility in metres, rain in mm/h with the speed of a car in m/s, snow in metres.
place.picture(wm.Weather("fog", {"fog.mor": 80}), camera).save("fog.png")
place.picture("heavy-rain", camera, time=2.0, speed=10.0).save("rain.png")
place.picture(wm.Weather("snow", {"snow_cover.depth": 0.15}), camera).save("snow.png")
print("fog.png, rain.png, snow.png:", place.describe())
