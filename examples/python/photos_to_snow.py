"""Turns photos into a scene and lays snow on it for any viewer: python examples/python/photos_to_snow.py photos/ place.ply

Without photos it takes some of the built-in street, by the program.
"""

import subprocess
import sys

import weather_magician as wm

words = [word for word in sys.argv[1:] if not word.startswith("--")]
quick = "--quick" in sys.argv
photos, out = [*words, "photos", "place.ply"][:2] if words else ("photos", "place.ply")
if not words:
    count, size = ("6", "96x64") if quick else ("24", "480x320")
    program = [sys.executable, "-m", "weather_magician", "demo", "--photos", photos, "--count", count, "--size", size]
    subprocess.run(program, check=True)


def tell(event, facts):
    """Prints a line now and then."""
    if event in ("summary", "evaluation", "warning"):
        print(event, {name: round(fact, 4) if isinstance(fact, float) else fact for name, fact in facts.items()})


scene = wm.reconstruct(photos, preset="draft", steps=60 if quick else None, callback=tell)
scene.save(out)
snow = wm.Renderer(scene).bake(wm.Weather(parameters={"snow_cover.depth": 0.1}))
snow.save("snow.ply")
print(f"{out}: {len(scene)} splats; snow.ply: {len(snow) - len(scene)} more")
