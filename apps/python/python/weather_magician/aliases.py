"""Types of arguments and results, for type checkers and readers."""

from collections.abc import Callable
from os import PathLike
from typing import Literal, TypeAlias, TypedDict

from weather_magician._native import Camera, Weather

Path: TypeAlias = "str | PathLike[str]"
"""A path of a file or a folder."""
WeatherLike: TypeAlias = "Weather | str | PathLike[str]"
"""A weather, or what makes one: the name of a preset, a file, a report or words."""
CameraLike: TypeAlias = "Camera | str | int | PathLike[str]"
"""A camera; ``"x,y,z:x,y,z"`` (eye and target, scene units); the name or the number (from 1) of a photo; a JSON file of keyframes."""
Progress: TypeAlias = "Callable[[int, int | None, str], object]"
"""Called with the steps done, all steps (None if that is not known) and the task. An exception stops the work."""
Output: TypeAlias = Literal[
    "rgb", "rgb_linear", "depth", "median_depth", "normal", "alpha", "transmittance", "particles", "clean",
    "airlight", "water", "reflection", "water_depth", "label", "instance", "surface_depth", "clear",
]
"""Outputs of a picture:

=================  ===  ========  =====================================================================
name               k    type      meaning
=================  ===  ========  =====================================================================
``rgb``            3    uint8     colour for display, sRGB, dithered: the pixels of the PNG
``rgb_linear``     3    float32   colour in linear light, 1 = display white
``depth``          1    float32   mean depth along the axis of the camera, m; 0 where nothing is
``median_depth``   1    float32   depth at which half of the light is reached, m
``normal``         3    float32   unit normal, axes of the scene
``alpha``          1    float32   coverage by splats, 0-1
``transmittance``  3    float32   share of the scene's light that the air lets through, 0-1
``particles``      4    float32   linear light of falling particles, and their coverage
``clean``          3    float32   linear light of the scene without air and particles
``airlight``       3    float32   linear light that the air adds
``water``          1    float32   share of the pixel that is water, 0-1
``reflection``     1    float32   share of the pixel's light that the water mirrors, 0-1
``water_depth``    1    float32   depth of the water's surface, m
``label``          1    uint16    class of the surface, 0 for none
``instance``       1    uint16    thing that the surface belongs to, 0 for none
``surface_depth``  1    float32   depth of surfaces without what falls, m; 0 in the sky
``clear``          3    float32   the same view without any weather, sRGB, 1 = display white
=================  ===  ========  =====================================================================
"""


class Reading(TypedDict):
    """A value measured from pictures, and the expected one."""

    instrument: str
    quantity: str
    unit: str
    expected: float
    measured: float
    standard_error: float | None
    error: float
    passes: bool
