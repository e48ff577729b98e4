"""Real weather on real places."""

from weather_magician._native import *  # noqa: F403
from weather_magician._native import Batch, Error, _open_batch

__all__ = ["Batch", "Error"]
