#!/usr/bin/env python3
"""Holds the scene formats against programs that others wrote: files that they write are read here, files that are written here are read by
them, and both must find the same splats. Also: the glTF validator, pictures before and after, and times beside theirs.

    python3 tests/peers/formats.py PROGRAM SCENE.ply [--camera X,Y,Z:X,Y,Z ...] [--work FOLDER] [--skip a.sog]

PROGRAM is a release build of weather-magician. It installs @playcanvas/splat-transform, @mkkellogg/gaussian-splats-3d, three and gltf-validator (npm)
and numpy (pip, in a virtual environment) into FOLDER, a temporary one unless given. It takes minutes, needs the registries, and is
no part of `cargo test`. The exit code is 1 if anything differs.
"""

import argparse
import json
import os
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# Packages by name; what they are held against is their newest version.
NPM = ["@playcanvas/splat-transform", "@mkkellogg/gaussian-splats-3d", "three", "gltf-validator"]

# GaussianSplats3D writes a .ksplat of a level from a PLY; it expects a browser's globals.
KSPLAT = """
globalThis.window ??= globalThis; globalThis.document ??= {}; Object.defineProperty(globalThis, 'navigator', {value: {userAgent: ''}, configurable: true});
const fs = await import('fs');
const G = await import('@mkkellogg/gaussian-splats-3d');
const [,, ply, out, level, degree] = process.argv;
const bytes = fs.readFileSync(ply);
const file = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
const splats = await G.PlyLoader.loadFromFileData(file, 0, +level, true, +degree);
fs.writeFileSync(out, Buffer.from(splats.bufferData));
"""

VALIDATE = """
import v from 'gltf-validator'; import fs from 'fs';
const report = await v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])), {maxIssues: 100});
console.log(JSON.stringify(report.issues.messages));
"""

failures = []


def check(name, good, what):
    print(f"  {'ok  ' if good else 'FAIL'} {name}: {what}")
    if not good:
        failures.append(f"{name}: {what}")


def run(command, cwd=None, rounds=1):
    """Runs a command; gives its output, wall and CPU seconds, the least of some rounds."""
    if rounds > 1:
        results = [run(command, cwd) for _ in range(rounds)]
        return results[0][0], min(r[1] for r in results), min(r[2] for r in results)
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.time()
    done = subprocess.run([str(c) for c in command], cwd=cwd, capture_output=True, text=True)
    wall, after = time.time() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout + done.stderr, wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def install(work, packages, scripts):
    """Installs packages of npm, writes scripts for node by their names, and goes on where numpy is."""
    python = work / "venv/bin/python"
    if not python.exists():
        run([sys.executable, "-m", "venv", work / "venv"])
        run([python, "-m", "pip", "install", "-q", "numpy"])
    if not all((work / "node_modules" / package.removesuffix("@latest")).exists() for package in packages):
        (work / "package.json").write_text('{"private": true, "type": "module"}')
        run(["npm", "install", "--no-audit", "--no-fund", *packages], cwd=work)
    for name, text in scripts.items():
        (work / name).write_text(text)
    try:
        import numpy  # noqa: F401
    except ImportError:
        os.execv(python, [str(python), *sys.argv, *([] if "--work" in sys.argv else ["--work", str(work)])])


def read_ply(path):
    """The splats of a binary PLY of floats, in activated form where that tells more."""
    import numpy as np

    data = path.read_bytes()
    end = data.index(b"end_header\n") + 11
    lines = data[:end].decode().splitlines()
    count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    kinds = {"float": "<f4", "uchar": "u1"}
    columns = [(line.split()[2], kinds[line.split()[1]]) for line in lines if line.startswith("property")]
    table = np.frombuffer(data, np.dtype(columns), count, end)
    stack = lambda names: np.stack([table[name].astype("f8") for name in names], 1)
    quats = stack([f"rot_{i}" for i in range(4)])
    rest = sorted((name for name, _ in columns if name.startswith("f_rest_")), key=lambda name: int(name[7:]))
    return {
        "means": stack("xyz"),
        "quats": quats / np.linalg.norm(quats, axis=1, keepdims=True),
        "log_scales": stack([f"scale_{i}" for i in range(3)]),
        "opacities": 1 / (1 + np.exp(-table["opacity"].astype("f8"))),
        "sh": stack(["f_dc_0", "f_dc_1", "f_dc_2", *rest]),
    }


def same(name, a, b):
    """Both readers must give equal numbers but for rounding of floats; bytes of 0 and 255 stand for a range of opacities."""
    import numpy as np

    if a["means"].shape != b["means"].shape or a["sh"].shape != b["sh"].shape:
        return check(name, False, f"{a['means'].shape}, {a['sh'].shape} here, {b['means'].shape}, {b['sh'].shape} there")
    size = np.abs(a["means"]).max()
    # A splat's axes may change their signs, and a quaternion of zeros be read as it is by one and
    # as no turn by the other.
    turn = 1 - np.nanmin(np.abs(alike_axes(a["quats"], b["quats"])))
    # A scale that is too small for its type comes back as 0, for whose logarithm each reader has a
    # number of its own.
    a, b = ({**side, "log_scales": np.maximum(side["log_scales"], -10)} for side in (a, b))
    far = {key: np.abs(a[key] - b[key]).max() for key in ("means", "log_scales", "opacities", "sh")}
    limits = {"means": 2e-6 * size + 1e-6, "log_scales": 1e-5, "opacities": 0.0011, "sh": 1e-5}
    # splat-transform reads the bytes of a .splat's quaternion as 2 b / 255 - 1, the program that
    # made the format as (b - 128) / 128.
    good = all(far[key] <= limits[key] for key in far) and turn < 1e-4
    far["turns"] = turn
    check(name, good, f"{len(a['means'])} splats, largest differences " + ", ".join(f"{k} {v:.1e}" for k, v in far.items()))


def alike_axes(a, b):
    """|a . b| of quaternions (wxyz), b turned by that of no turn and the half turns about its own axes that fits best."""
    import numpy as np

    w, x, y, z = b.T
    turned = [(w, x, y, z), (-x, w, z, -y), (-y, -z, w, x), (-z, y, -x, w)]
    return np.max([np.abs((a * np.stack(q, 1)).sum(1)) for q in turned], axis=0)


def psnr(a, b):
    import numpy as np

    return 10 * np.log10(1 / max(np.mean((a - b) ** 2), 1e-12))


def shown(path):
    """A picture in linear light as a screen shows it."""
    import numpy as np

    light = np.load(path).astype("f8").clip(0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def gltf_values(path):
    """Attributes of the first primitive of a GLB of floats."""
    import numpy as np

    data = path.read_bytes()
    length = struct.unpack("<I", data[12:16])[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    widths = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
    values = {}
    for name, index in document["meshes"][0]["primitives"][0]["attributes"].items():
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        if accessor["componentType"] == 5126:
            start, width = view.get("byteOffset", 0) + accessor.get("byteOffset", 0), widths[accessor["type"]]
            values[name] = np.frombuffer(binary, "<f4", accessor["count"] * width, start).reshape(-1, width)
    return values


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=Path)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--camera", action="append", default=[])
    parser.add_argument("--work", type=Path)
    parser.add_argument("--rounds", type=int, default=1, help="how often to run what is timed; the least counts")
    parser.add_argument("--skip", action="append", default=[], help="what splat-transform need not write, such as a.sog: it takes minutes for SH")
    arguments = parser.parse_args()
    work = (arguments.work or Path(tempfile.mkdtemp(prefix="peers-"))).resolve()
    work.mkdir(parents=True, exist_ok=True)
    install(work, NPM, {"ksplat.mjs": KSPLAT, "validate.mjs": VALIDATE})
    import numpy as np

    program, scene = arguments.program.resolve(), arguments.scene.resolve()
    theirs = [work / "node_modules/.bin/splat-transform", "-q", "-w", "-g", "cpu"]
    out = work / "files"
    shutil.rmtree(out, ignore_errors=True)
    for folder in ("ours", "theirs/sog"):
        (out / folder).mkdir(parents=True)
    original = read_ply(scene)
    count, bands = len(original["means"]), int((original["sh"].shape[1] // 3) ** 0.5) - 1
    print(f"{scene.name}: {count} splats, SH degree {bands}")

    # Name, our options, their options, whether they write it, whether they read it.
    kinds = [
        ("a.spz", [], ["--spz-version", "3"], True, True),
        ("a4.spz", ["--spz-version", "4"], [], True, True),
        ("a.compressed.ply", [], [], True, True),
        ("a.sog", [], [], True, True),
        ("sog/meta.json", [], [], True, True),
        ("a.glb", [], [], True, False),
        ("a.splat", [], [], False, True),
        ("a.ksplat", [], [], False, True),
    ]
    times = []
    for name, our_options, their_options, they_write, they_read in kinds:
        print(name)
        ours, other = out / "ours" / name, out / "theirs" / name
        _, wall, cpu = run([program, "convert", scene, ours, *our_options], rounds=arguments.rounds)
        row = {"name": name, "write": (wall, cpu), "size": sum(f.stat().st_size for f in files_of(ours))}
        back = out / "back.ply"
        _, wall, cpu = run([program, "convert", ours, back], rounds=arguments.rounds)
        row["read"] = (wall, cpu)
        here = read_ply(back)
        if they_read:
            _, wall, cpu = run([*theirs, ours, out / "their-back.ply"], rounds=arguments.rounds)
            row["their read"] = (wall, cpu)
            same("written here, read by splat-transform", here, read_ply(out / "their-back.ply"))
        if they_write and name not in arguments.skip:
            _, wall, cpu = run([*theirs, *their_options, scene, other], rounds=arguments.rounds)
            row["their write"] = (wall, cpu)
            row["their size"] = sum(f.stat().st_size for f in files_of(other))
            run([program, "convert", other, back])
            if they_read:
                run([*theirs, other, out / "their-back.ply"])
                same("written by splat-transform, read here", read_ply(back), read_ply(out / "their-back.ply"))
            else:
                same("written by splat-transform, read here", read_ply(back), original)
        if name == "a.glb":
            a, b = gltf_values(ours), gltf_values(other)
            far = max(np.abs(a[key] - b[key]).max() for key in b if not key.endswith("ROTATION"))
            check("the same attributes as splat-transform's", set(a) - {"_GROUP"} == set(b) and far < 1e-4, f"largest difference {far:.1e}")
            for path in (ours, out / "ours/packed.glb"):
                if not path.exists():
                    run([program, "convert", scene, path, "--gltf", "spz"])
                issues = json.loads(run(["node", "validate.mjs", path], cwd=work)[0].splitlines()[-1])
                # The validator knows no names of this extension's attributes, nor their types.
                own = "KHR_gaussian_splatting"
                real = [i for i in issues if i["severity"] == 0 and own not in i.get("pointer", "") + i["message"]]
                check(f"the glTF validator on {path.name}", not real, f"{len(real)} errors but for names that it does not know {real[:2]}")
        times.append(row)

    print("a.ksplat by GaussianSplats3D")
    for level in (0, 1, 2):
        other = out / "theirs" / f"level{level}.ksplat"
        run(["node", "ksplat.mjs", scene, other, level, min(bands, 2)], cwd=work)
        run([program, "convert", other, out / "back.ply"])
        run([*theirs, other, out / "their-back.ply"])
        same(f"level {level}, read here and by splat-transform", read_ply(out / "back.ply"), read_ply(out / "their-back.ply"))

    if arguments.camera:
        print("pictures: PSNR against the PLY's, dB")
        # What is found out of the splats may differ a little from file to file, and must not move
        # the camera.
        survey = json.loads(subprocess.run([program, "inspect", "--json", scene], capture_output=True, text=True).stdout)["survey"]
        place = ["--up=" + ",".join(str(v) for v in survey["up"]["value"]), "--near", str(min(0.2, 0.01 * survey["radius"]))]
        for name, *_ in kinds:
            values = []
            for number, camera in enumerate(arguments.camera):
                for source, target in ((scene, out / f"view{number}.npy"), (out / "ours" / name, out / "now.npy")):
                    if target.name == "now.npy" or not target.exists():
                        run([program, "render", source, f"--camera={camera}", *place, "--size", "960x640", "--device", "cpu", "--out", target])
                values.append(psnr(shown(out / "now.npy"), shown(out / f"view{number}.npy")))
            print(f"  {name:18} " + "  ".join(f"{v:.1f}" for v in values))

    speeds(times, count)
    print(f"{len(failures)} differences" + "".join(f"\n  {failure}" for failure in failures))
    return 1 if failures else 0


def speeds(times, count):
    """Prints a table of the processor's time for PLY -> format and format -> PLY by whole programs: splats and megabytes of the format a second."""
    print("| format | | s | M splats/s | MB/s | theirs: s | M splats/s | MB/s | ratio |")
    print("|---|---|---|---|---|---|---|---|---|")
    for row in times:
        for way in ("write", "read"):
            cells = []
            # What they read is ours.
            sides = [(row[way], row["size"]), (row.get(f"their {way}"), row.get("their size", 0) if way == "write" else row["size"])]
            for side, size in sides:
                cells += [f"{side[1]:.2f}", f"{count / side[1] / 1e6:.1f}", f"{size / side[1] / 1e6:.0f}"] if side else ["-"] * 3
            ratio = f"{sides[1][0][1] / sides[0][0][1]:.1f}" if sides[1][0] else "-"
            print(f"| `{row['name']}` | {way} | " + " | ".join(cells) + f" | {ratio} |")
    print("MB: " + ", ".join(f"{row['name']} {row['size'] / 1e6:.1f} (theirs {row.get('their size', 0) / 1e6:.1f})" for row in times))


def files_of(path):
    return list(path.parent.glob("*")) if path.name == "meta.json" else [path]


if __name__ == "__main__":
    sys.exit(main())
