"""Renders many views as arrays, with depth in metres and the transmittance of the air, as perception code takes them.

python examples/python/arrays_and_depth.py garden.ply
"""

import sys

import numpy as np

import weather_magician as wm

paths = [word for word in sys.argv[1:] if not word.startswith("--")]
quick = "--quick" in sys.argv

place = wm.Renderer(wm.Scene.open(paths[0]) if paths else wm.Scene.street(0.05))
width, height = (96, 64) if quick else (640, 480)
camera = place.camera(size=(width, height))

# Eight views, each 0.2 m further to the right.
step = np.eye(4)
step[0, 3] = -0.2 / place.metres_per_unit
viewmats = np.stack([np.linalg.matrix_power(step, index) @ camera.viewmat for index in range(8)])
made = place.render(
    wm.Weather("fog", {"fog.mor": 60}),
    viewmats,
    np.stack([camera.K] * 8),
    width,
    height,
    outputs=["rgb", "depth", "transmittance", "clean"],
)
for name, array in made.items():
    print(f"{name:14}{array.shape} {array.dtype}")

# Koschmieder's law along the axis: the air lets through exp(-3 d / MOR) at least, since rays are
# longer than depths.
depth, through = made["depth"][..., 0], made["transmittance"][..., 1]
seen = (depth > 5) & (depth < 40)
expected = np.exp(-3.0 * depth[seen] / 60.0)
print(f"transmittance over exp(-3 d / MOR): {np.median(through[seen] / expected):.2f} in the middle of the pixels")
