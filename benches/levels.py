"""Levels of detail: growth with the scene, and popping in a video. Needs NumPy, Pillow and Matplotlib.

    python benches/levels.py growth OUT.png INDEX CAMERA [INDEX CAMERA]... [-- OPTIONS]
    python benches/levels.py popping OUT.png SCENE INDEX SPLATS [-- OPTIONS]

`growth` renders one picture of each scene in levels (lod-meta.json) at one budget: the time of the frame, CPU time and peak memory of the
process over the number of splats. CAMERA is as for `render --camera`.

`popping` renders a sequence three times: of all splats, and in levels with `--lod shot` and `--lod frame`. It prints and plots how much
each frame differs from the one before, and from the frame of all splats. A level that changes shows as a peak that the line of all splats
does not have.

OPTIONS are passed on to `render`, such as --size, --weather and --memory. WEATHER_MAGICIAN is the program,
target/release/weather-magician if not set.
"""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

import matplotlib
import numpy as np
from PIL import Image

matplotlib.use("Agg")
import matplotlib.pyplot as plt

PROGRAM = os.environ.get("WEATHER_MAGICIAN", "target/release/weather-magician")


def run(*args):
    """Runs the program; returns what it printed, CPU seconds, wall seconds and peak memory in bytes."""
    started = time.monotonic()
    child = subprocess.Popen([PROGRAM, *map(str, args)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    said = child.stdout.read()
    _, status, used = os.wait4(child.pid, 0)
    if status != 0:
        sys.exit(said)
    return said, used.ru_utime + used.ru_stime, time.monotonic() - started, used.ru_maxrss * 1024


def growth(out, *scenes, options):
    rows = []
    for index, camera in zip(scenes[::2], scenes[1::2], strict=True):
        count = json.loads(pathlib.Path(index).read_text())["counts"][0]
        with tempfile.TemporaryDirectory() as folder:
            picture = pathlib.Path(folder) / "a.png"
            said, cpu, wall, peak = run("render", index, "--camera", camera, "--out", picture, *options)
        frame = float(re.search(r"([\d.]+) ms", said).group(1))
        rows.append((count / 1e6, frame, cpu, peak / 2**20))
        print(f"{count / 1e6:7.2f} M splats: frame {frame:.0f} ms, process {cpu:.2f} CPU s and {wall:.2f} s, {peak / 2**20:.0f} MiB")
    rows = np.array(sorted(rows))
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    for axis, column, name in zip(axes, (1, 2, 3), ("frame, ms", "process, CPU s", "peak memory, MiB")):
        axis.plot(rows[:, 0], rows[:, column], "o-")
        axis.set(xscale="log", xlabel="million splats", ylabel=name, ylim=(0, 1.15 * rows[:, column].max()))
        axis.grid(alpha=0.3)
    figure.savefig(out, dpi=100)


def frames_of(folder):
    paths = sorted(folder.glob("*.png"))
    return np.stack([np.asarray(Image.open(path).convert("RGB"), np.float32) / 255 for path in paths])


def popping(out, scene, index, splats, options):
    films = {}
    for name, source, own in [
        ("all splats", scene, []),
        ("shot", index, ["--splats", splats, "--lod", "shot"]),
        ("frame", index, ["--splats", splats, "--lod", "frame"]),
    ]:
        with tempfile.TemporaryDirectory() as folder:
            _, cpu, wall, peak = run("render", source, "--out", pathlib.Path(folder) / "f", *own, *options)
            films[name] = frames_of(pathlib.Path(folder) / "f")
        print(f"{name}: {len(films[name])} frames, {cpu:.1f} CPU s, {wall:.1f} s, {peak / 2**20:.0f} MiB")
    changes = {name: np.sqrt((np.diff(film, axis=0) ** 2).mean((1, 2, 3))) for name, film in films.items()}
    all_of = films["all splats"]
    figure, (change, loss) = plt.subplots(1, 2, figsize=(12, 3.6), layout="constrained")
    for name, values in changes.items():
        change.plot(np.arange(1, len(values) + 1), values, label=name)
        # What the change of this frame has beyond that of all splats, against the median frame.
        extra = np.sqrt(np.maximum(values**2 - changes["all splats"] ** 2, 0))
        print(f"{name}: change RMS {values.mean():.5f}, largest {values.max():.5f}; beyond all splats at most {extra.max():.5f}")
        if name != "all splats":
            quality = [-10 * np.log10(((a - b) ** 2).mean() + 1e-12) for a, b in zip(all_of, films[name])]
            steps = np.sqrt(((np.diff(films[name] - all_of, axis=0)) ** 2).mean((1, 2, 3)))
            loss.plot(quality, label=name)
            print(
                f"{name}: PSNR {min(quality):.2f} to {max(quality):.2f} dB; the difference to all splats changes by RMS"
                f" {np.median(steps):.5f} a frame, largest {steps.max():.5f}"
            )
    change.set(xlabel="frame", ylabel="RMS change from the frame before", ylim=(0, None))
    loss.set(xlabel="frame", ylabel="PSNR against all splats, dB")
    for axis in (change, loss):
        axis.legend()
        axis.grid(alpha=0.3)
    figure.savefig(out, dpi=100)


if __name__ == "__main__":
    args = sys.argv[1:]
    cut = args.index("--") if "--" in args else len(args)
    given, options = args[:cut], args[cut + 1 :]
    commands = {"growth": growth, "popping": popping}
    if len(given) < 4 or given[0] not in commands:
        sys.exit(__doc__)
    commands[given[0]](*given[1:], options=options)
