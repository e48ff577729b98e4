"""Real weather on real places: 3D Gaussian splatting scenes in fog, rain, snow and dust::

    import weather_magician as wm

    place = wm.Renderer("garden.ply")
    place.picture("fog").save("fog.png")

Conventions, which are those of gsplat:

- Cameras have OpenCV axes: x right, y down, z ahead. ``viewmat [4, 4]`` maps points of the scene to the camera
  (world to camera); its translation is in scene units, as ``Splats.means``. ``K [3, 3]`` is in px, the centre of the top left pixel is
  (0.5, 0.5).
- Quaternions are wxyz.
- Pictures are ``[C, H, W, k]``: C cameras, the top row first, k channels.
- Depths, ranges and points of lidars are in metres, times in seconds.

Every frame is a function of (scene, weather, camera, time): the same inputs give the same bytes on the CPU, on any number of threads.

Functions that take a while release the GIL, can be stopped by Ctrl-C, and tell an optional ``progress(done, total, task)``.
Objects can be pickled, and used after a fork: each process then makes its own renderer.
"""

from __future__ import annotations

from typing import Any

from weather_magician._native import (
    CONDITIONS,
    LIDAR_CLASSES,
    Batch,
    Camera,
    Error,
    Picture,
    Renderer,
    Scene,
    Splats,
    Weather,
    __version__,
    reconstruct,
)
from weather_magician.aliases import Path

__all__ = [
    "CONDITIONS",
    "LIDAR_CLASSES",
    "Batch",
    "Camera",
    "Error",
    "Picture",
    "Renderer",
    "Scene",
    "Splats",
    "Weather",
    "__version__",
    "convert",
    "reconstruct",
]


def convert(source: Path, target: Path, **change: Any) -> list[str]:
    """Reads a scene, changes it and writes it in the format that ``target`` ends in.

    ``change`` has the arguments of :meth:`Scene.changed`. Returns lines that its user should know.
    """
    scene, notes = Scene.open(source), []
    if change:
        scene, notes = scene.changed(**change)
    scene.save(target)
    return notes
