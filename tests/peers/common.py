"""What the scripts beside this file share: checks, rotations, and `MadeSet`, a set that `batch` made, by its manifest and its own frames."""

import functools
import json
import sys
from pathlib import Path

import numpy as np

failures = []
# Of each clip, pixels of points are held in every so many frames.
EVERY = 5
# Pixels that 13 digits of text, or matrices of f64, may be off where points are 1 m in front of the
# camera and far outside of the picture.
EXACT = 1e-5
# Classes of the points of `frames/`, by number.
CLASSES = ["surface", "drop", "flake", "air", "ghost"]
SURFACE, FLAKE = 0, 2


def check(name, good, what):
    print(f"  {'ok  ' if good else 'FAIL'} {name}: {what}", flush=True)
    if not good:
        failures.append(name)


def finish():
    sys.exit(1 if failures else 0)


def rotation(w, x, y, z):
    """The matrix of a unit quaternion."""
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def matrix(turn, translation):
    """A pose as a 4x4 matrix, from its 3x3 rotation and its translation."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, translation
    return pose


def turn(a, b):
    """The angle between two rotations, radians."""
    return 2 * np.arcsin(min(1, np.linalg.norm(a[:3, :3] - b[:3, :3]) / np.sqrt(8)))


def moved(pose, points):
    """Points [N, 3] through a pose, 4x4, in f64."""
    return points.astype(float) @ pose[:3, :3].T + pose[:3, 3]


def pixels(k, points):
    """Pixels [N, 2] of points in a camera's axes by its intrinsics, 3x3, or of homogeneous pixels [N, 3] where `k` is 1."""
    if np.ndim(k):
        points = points @ np.asarray(k, float).T
    with np.errstate(divide="ignore", invalid="ignore"):
        return points[:, :2] / points[:, 2:]


class MadeSet:
    """A set that `batch` made with the layout `frames`: PNG and PLY. All sensors must have the rate of the frames, and the rig one lidar."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.manifest = json.loads((self.folder / "manifest.json").read_text())
        self.sensors = {sensor["name"]: sensor for sensor in self.manifest["sensors"]}
        for sensor in self.sensors.values():
            sensor["rig_from_sensor"] = self._pose(sensor["rig_from_sensor"])
            if sensor["kind"] == "camera":
                i = sensor["intrinsics"]
                # The first pixel's centre at 0.5, 0.5.
                sensor["k"] = np.array([[i["fx"], 0, i["cx"]], [0, i["fy"], i["cy"]], [0, 0, 1]])
                sensor["size"] = (i["width"], i["height"])
        self.cameras = [name for name, sensor in self.sensors.items() if sensor["kind"] == "camera"]
        (self.lidar,) = [name for name, sensor in self.sensors.items() if sensor["kind"] == "lidar"]
        self.clips = [json.loads(line) for line in (self.folder / "clips.jsonl").read_text().splitlines()]
        self.readings = {}
        for line in (self.folder / "frames.jsonl").read_text().splitlines():
            frame = json.loads(line)
            for reading in frame["readings"]:
                assert reading["is_key"] and reading["index"] == frame["index"], "a sensor has another rate than frames"
                reading["world_from_sensor"] = self._pose(reading["world_from_sensor"])
                self.readings[frame["clip"], frame["index"], reading["sensor"]] = reading
        self.frames = len(self.readings) // len(self.sensors) // len(self.clips)

    @staticmethod
    def _pose(entry):
        return matrix(rotation(*entry["quaternion"]), entry["translation"])

    def pose(self, clip, frame, sensor):
        """world_from_sensor, 4x4."""
        return self.readings[clip["clip"], frame, sensor]["world_from_sensor"]

    def rig(self, clip, frame):
        """world_from_rig, 4x4."""
        return self.pose(clip, frame, self.lidar) @ np.linalg.inv(self.sensors[self.lidar]["rig_from_sensor"])

    def time(self, clip, frame, sensor):
        """Nanoseconds since 1970."""
        return self.readings[clip["clip"], frame, sensor]["timestamp_ns"]

    def times(self, clip, sensor):
        return [self.time(clip, frame, sensor) for frame in range(self.frames)]

    def whole_k(self, camera):
        """Intrinsics with the first pixel's centre at 0, 0."""
        return self.sensors[camera]["k"] - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]

    def file(self, clip, frame, sensor):
        return self.folder / self.readings[clip["clip"], frame, sensor]["files"][0]["path"]

    @functools.lru_cache(64)
    def _sweep(self, path):
        data = path.read_bytes()
        head, points = data.split(b"end_header\n", 1)
        kinds = {"float": "<f4", "uint": "<u4", "ushort": "<u2", "uchar": "u1"}
        fields = [(name, kinds[kind]) for _, kind, name in (line.split() for line in head.decode().splitlines() if line.startswith("property"))]
        return np.frombuffer(points, np.dtype(fields))

    def sweep(self, clip, frame):
        """Points of `frames/`, with a field for each column."""
        return self._sweep(self.file(clip, frame, self.lidar))

    def points(self, clip, frame):
        """x, y and z [N, 3], f32, in the lidar's axes."""
        sweep = self.sweep(clip, frame)
        return np.stack([sweep[axis] for axis in "xyz"], axis=1)

    def world_points(self, clip, frame):
        return moved(self.pose(clip, frame, self.lidar), self.points(clip, frame))

    def pixels(self, clip, frame, camera, world_points=None):
        """Pixels [N, 2] of the sweep of a frame, and if the points are more than 1 m in front of the camera."""
        points = self.world_points(clip, frame) if world_points is None else world_points
        points = moved(np.linalg.inv(self.pose(clip, frame, camera)), points)
        return pixels(self.sensors[camera]["k"], points), points[:, 2] > 1

    def picture(self, clip, frame, camera):
        """A picture of `frames/`, [H, W, 3], u8."""
        from PIL import Image

        return np.array(Image.open(self.file(clip, frame, camera)))


class Differences:
    """The largest differences of a layout from a set's manifest and frames."""

    def __init__(self, made):
        self.made, self.largest, self.count, self.limits, self.psnr = made, {}, {}, {}, None
        self.wrong_pictures, self.pictures = [], 0

    def add(self, name, limit, found, expected=0):
        """Takes the largest element of |found - expected|. Other shapes and NaN fail."""
        found, expected = np.asarray(found, float), np.asarray(expected, float)
        is_alike = expected.ndim == 0 or found.shape == expected.shape
        far = np.abs(found - expected) if is_alike else np.full(len(found), np.inf)
        self.limits[name] = limit
        self.largest[name] = np.maximum(self.largest.get(name, 0), far.max(initial=0))
        self.count[name] = self.count.get(name, 0) + len(far) if far.ndim else self.count.get(name, 0) + 1

    def add_pose(self, name, found, expected, metres=1e-9, radians=1e-8):
        self.add(f"{name}, m", metres, np.linalg.norm(found[:3, 3] - expected[:3, 3]))
        self.add(f"{name}, rad", radians, turn(found, expected))

    def add_pixels(self, way, limit, clip, frame, camera, found, world_points=None):
        """Holds the pixels [N, 2] of all points of a sweep, the first pixel's centre at 0.5, 0.5, against the manifest's."""
        expected, before = self.made.pixels(clip, frame, camera, world_points)
        if found.shape == expected.shape:
            found, expected = found[before], expected[before]
        self.add(f"points by {way}, px", limit, found, expected)

    def add_picture(self, clip, frame, camera, found, is_lossless):
        expected, found = self.made.picture(clip, frame, camera), np.asarray(found)
        self.pictures += 1
        if found.shape != expected.shape or is_lossless and not np.array_equal(found, expected):
            self.wrong_pictures.append(f"{clip['name']} {camera} {frame}")
        elif not is_lossless:
            error = np.mean((found.astype(float) - expected) ** 2)
            self.psnr = min(self.psnr or np.inf, 10 * np.log10(255**2 / max(error, 1e-9)))

    def report(self):
        for name, far in self.largest.items():
            check(name, far <= self.limits[name], f"at most {far:.1e} in {self.count[name]}")
        if self.pictures:
            good = not self.wrong_pictures and (self.psnr is None or self.psnr > 35)
            what = "equal" if self.psnr is None else f"at least {self.psnr:.1f} dB"
            check("pictures", good, f"{self.pictures}, {what}" + "".join(f"; not so {name}" for name in self.wrong_pictures[:3]))
