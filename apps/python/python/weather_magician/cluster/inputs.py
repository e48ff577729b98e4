"""The files that a plan reads: they travel to nodes that share no folder with the driver."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from .runner import ClusterError

# Longest text of a TOML file that may be a path.
LONGEST = 1000
# Scenes of several files: the rest lies in the folder of the one that is named.
FOLDERS_OF = (".json", ".gltf")
# What each node makes for itself: a scene's prepared assets may be a hundred times as long as the
# scene.
ASSETS = ".assets"


@dataclass(frozen=True)
class InputFile:
    """A file: its path on this machine, its path from the root of all inputs with `/`, its length in bytes and its SHA-256."""

    path: Path
    name: str
    bytes: int
    sha256: str


@dataclass(frozen=True)
class Inputs:
    """All files of a plan. plan: the name of the plan among them."""

    plan: str
    files: list[InputFile]


def inputs_of(plan: str | os.PathLike) -> Inputs:
    """Returns the files that a plan reads: itself, and what it names by paths that are not absolute, and what these name in turn.

    Any text of a TOML file that is the path of a file counts, so no list of keys has to be kept. Folders count as scenes alone. Absolute
    paths are left to the nodes, which must have them.
    """
    plan = Path(os.path.abspath(plan))
    found: dict[Path, None] = {}
    waiting = [plan]
    while waiting:
        path = waiting.pop()
        if path in found:
            continue
        found[path] = None
        if path.suffix.lower() != ".toml":
            continue
        for key, text in _texts(_toml(path)):
            if not text or len(text) > LONGEST or "\n" in text or os.path.isabs(text):
                continue
            named = Path(os.path.normpath(path.parent / text))
            if named.is_file():
                waiting.append(named)
                if key == "file":
                    waiting.extend(_beside(named))
            elif named.is_dir() and key == "file":
                waiting.extend(_all_of(named))
    paths = sorted(found)
    root = Path(os.path.commonpath([path.parent for path in paths]))
    names = {path: PurePosixPath(path.relative_to(root)).as_posix() for path in paths}
    files = [InputFile(path, name, *digest_of(path)) for path, name in names.items()]
    return Inputs(names[plan], files)


def _toml(path: Path) -> dict:
    try:
        import tomllib
    except ImportError:
        try:
            import tomli as tomllib
        except ImportError:
            raise ClusterError("Python 3.10 reads no TOML by itself, and a store needs it: `pip install tomli`") from None
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ClusterError(f"{path}: {error}") from None


def _texts(value: object, key: str = ""):
    """All texts of a TOML value, with the key of each."""
    if isinstance(value, str):
        yield key, value
    elif isinstance(value, dict):
        for name, inner in value.items():
            yield from _texts(inner, name)
    elif isinstance(value, list):
        for inner in value:
            yield from _texts(inner, key)


def _beside(scene: Path) -> list[Path]:
    """What belongs to a scene file: files with its name and an ending, the folder of a scene of several files, a training's cameras."""
    beside = [path for path in scene.parent.glob(f"{_literal(scene.name)}.*") if path.is_file()]
    if scene.suffix.lower() in FOLDERS_OF:
        beside.extend(_all_of(scene.parent))
    cameras = scene.parents[2] / "cameras.json" if len(scene.parents) > 2 else None
    if scene.name == "point_cloud.ply" and cameras and cameras.is_file():
        beside.append(cameras)
    return beside


def _literal(name: str) -> str:
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in name)


def _all_of(folder: Path) -> list[Path]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return [path for path in files if not any(part.endswith(ASSETS) for part in path.relative_to(folder).parts[:-1])]


def digest_of(path: Path) -> tuple[int, str]:
    """Returns the length and the SHA-256 of a file."""
    hash, length = hashlib.sha256(), 0
    with open(path, "rb") as file:
        while part := file.read(1 << 20):
            hash.update(part)
            length += len(part)
    return length, hash.hexdigest()
