"""Real weather on real places.

Renders 3D Gaussian splatting scenes in fog, haze, rain, snow and dust, with weather in physical units::

    import weather_magician as wm

    place = wm.Renderer("garden.ply")
    place.picture("fog").save("fog.png")

The classes are those of ``__init__.pyi``; ``help(weather_magician.Renderer.render)`` has shapes and units.
"""

from weather_magician._native import (
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
    _camera_of,
    _open_batch,
    _renderer_of,
    _scene_of_bytes,
    _scene_of_file,
    _weather_of,
    reconstruct,
)

__all__ = [
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


def convert(source, target, **change):
    """Reads a scene, changes it and writes it in the format that ``target`` ends in.

    ``change`` are the arguments of :meth:`Scene.changed`. Returns lines that its user should know.
    """
    scene = Scene.open(source)
    notes = []
    if change:
        scene, notes = scene.changed(**change)
    scene.save(target)
    return notes
