"""A small place, a plan of twelve blocks for it, and batches that misbehave, for the tests of clusters."""

import hashlib
import os
import random
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from splat_file import write_ply

PLAN = """
seed = 3
frames = 4
block = 2

[[scene]]
file = "scenes/yard.ply"
up = [0, 0, 1]
ground = 0.0
metres_per_unit = 1.0

[[path]]
camera = "0,-4,1.6:0,20,1.6"
speed = 8

[rig]
size = [48, 32]
fov = 50.0

[[weather]]
from = ["clear", "fog", "mist.toml"]

[[weather]]
samples = 3
[weather.vary]
"fog.mor" = { distribution = "log-uniform", min = 30, max = 500 }
"""


def write_place(folder: Path) -> Path:
    """Writes the scene and the plan; returns the path of the plan."""
    (folder / "scenes").mkdir(parents=True)
    chance = random.Random(1)
    rows = []
    for number in range(600):
        y = chance.uniform(0, 30)
        if number < 300:
            rows.append((chance.uniform(-6, 6), y, 0.0, -0.8, -0.7, -0.6, 3.0, -0.3, -0.3, -4.0, 1.0, 0.0, 0.0, 0.0))
        else:
            side = -6.0 if number % 2 else 6.0
            rows.append((side, y, chance.uniform(0, 6), chance.uniform(-1, 1), 0.2, -0.2, 3.0, -3.0, -0.3, -0.3, 1.0, 0.0, 0.0, 0.0))
    write_ply(folder / "scenes/yard.ply", rows)
    (folder / "mist.toml").write_text('name = "mist"\n[fog]\nmor = 700\n')
    (folder / "plan.toml").write_text(PLAN)
    return folder / "plan.toml"


def tree_hash(folder: Path) -> str:
    """Returns the SHA-256 of the names and bytes of all files of a folder."""
    hash = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            hash.update(f"{path.relative_to(folder).as_posix()} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return hash.hexdigest()


@dataclass(frozen=True)
class Misbehaving:
    """Makes batches that take their time, and fail at some blocks: `how` is what happens at the first attempt at block `at`.

    kill: the process dies by signal 9. disk: OSError. always: an error, at each attempt. Files in `folder` tell of attempts.
    """

    folder: str
    at: int = -1
    how: str = ""
    seconds: float = 0.0

    def __call__(self, plan, out=None, *, device="auto", threads=None):
        from weather_magician import Batch

        return _Batch(Batch(plan, out, device=device, threads=threads), self)


class _Batch:
    def __init__(self, batch, ways):
        self.batch, self.ways = batch, ways

    def __getattr__(self, name):
        return getattr(self.batch, name)

    def make(self, block, progress=None):
        time.sleep(self.ways.seconds)
        attempts = Path(self.ways.folder, f"{block}")
        with open(attempts, "a") as file:
            file.write("x")
        first = attempts.stat().st_size == 1
        if block == self.ways.at and self.ways.how == "kill" and first:
            os.kill(os.getpid(), signal.SIGKILL)
        if block == self.ways.at and self.ways.how == "disk" and first:
            raise OSError("no space left")
        if block == self.ways.at and self.ways.how == "always":
            raise ValueError(f"block {block}\nis bewitched")
        return self.batch.make(block, progress)
