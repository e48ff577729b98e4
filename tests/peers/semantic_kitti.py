#!/usr/bin/env python3
"""Holds the layouts `semantic-kitti` and `wads` against semantic-kitti-api: opens points and labels with its `SemLaserScan`, poses with its
`generate_sequential.py`, counts classes with its `content.py` and its configuration, and compares with `truth.json`, the set's own numbers.

    for LAYOUT in semantic-kitti wads; do
        cargo run -p wm-batch --features testing --example synthetic_set -- $LAYOUT SETS/$LAYOUT; done
    python3 -m venv VENV && VENV/bin/pip install numpy pyyaml
    git clone --depth 1 https://github.com/PRBonn/semantic-kitti-api API
    VENV/bin/python tests/peers/semantic_kitti.py SETS API

It takes seconds and is no part of `cargo test`. The exit code is 1 if anything differs.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml

from common import check, finish


def classes(truth, config):
    """Classes of the points of a synthetic sweep: labels go round nothing and the set's own, point 20 is a drop and point 40 a flake."""
    numbers = {name: number for number, name in config["labels"].items()}
    own = [0] + [numbers.get(name, 0) for name in truth["labels"]]
    weather = {20: numbers["outlier"], 40: numbers.get("active-snow", numbers["outlier"])}
    return np.array([weather.get(k, own[k % len(own)]) for k in range(truth["points"])])


def sequences(folder, api, config):
    from auxiliary.laserscan import SemLaserScan
    from generate_sequential import parse_calibration, parse_poses

    truth = json.loads((folder / "truth.json").read_text())
    lidar = next(sensor["name"] for sensor in truth["sensors"] if sensor["kind"] == "lidar")
    spread, wrong, turned, scans = 0, 0, 0, 0
    for clip in truth["clips"]:
        readings = [r for r in clip["readings"] if r["sensor"] == lidar and r["is_key"]]
        sequence = folder / f"sequences/{clip['number']:02}"
        poses = parse_poses(sequence / "poses.txt", parse_calibration(sequence / "calib.txt"))
        points, labels = (sorted((sequence / name).iterdir()) for name in ("velodyne", "labels"))
        check(f"sequence {sequence.name}", len(points) == len(labels) == len(poses) == len(readings), f"{len(poses)} scans")
        start = np.linalg.inv(readings[0]["world_from_sensor"])
        expected = (start @ np.append(truth["spot"], 1))[:3]
        for reading, pose, point, label in zip(readings, poses, points, labels):
            scan = SemLaserScan(config["color_map"], project=True)
            scan.open_scan(str(point))
            scan.open_label(str(label))
            scan.colorize()
            wrong += (scan.sem_label != classes(truth, config)).sum() + scan.inst_label.sum()
            spread = max(spread, np.linalg.norm((pose @ np.append(scan.points[0], 1))[:3] - expected))
            turned = max(turned, np.abs(pose - start @ reading["world_from_sensor"]).max())
            scans += 1
        times = np.loadtxt(sequence / "times.txt")
        far = np.abs(times - [(r["timestamp"] - readings[0]["timestamp"]) * 1e-9 for r in readings]).max()
        check("times", far < 1e-9, f"within {far:.1e} s")
    check("labels", wrong == 0, f"{int(wrong)} of {scans * truth['points']} points differ")
    check("poses", turned < 1e-9, f"elements of Tr^-1 T Tr within {turned:.1e}")
    check("spot", spread < 1e-5, f"one place in all scans of a sequence within {spread:.1e} m")

    # The configuration as a training has it, with the sequences of this set.
    numbers = [clip["number"] for clip in truth["clips"]]
    with tempfile.TemporaryDirectory() as work:
        own = Path(work) / "config.yaml"
        own.write_text(yaml.safe_dump({**config, "split": {"train": numbers, "valid": [], "test": []}}))
        done = subprocess.run([sys.executable, "content.py", "-d", str(folder.resolve()), "-c", str(own)], cwd=api, capture_output=True, text=True)
        shares = dict(re.findall(r"^ (\d+): ([0-9.e-]+)$", done.stdout, re.M))
    unknown = done.stdout.count("wrong label")
    check("content.py", done.returncode == 0 and unknown == 0 and abs(sum(map(float, shares.values())) - 1) < 1e-9,
          ", ".join(f"{config['labels'][int(k)]} {float(v):.3f}" for k, v in shares.items() if float(v)) or done.stderr[-200:])


if __name__ == "__main__":
    sets, api = map(Path, sys.argv[1:])
    sys.path.insert(0, str(api))
    for layout in ("semantic-kitti", "wads"):
        print(layout)
        # WADS' classes are SemanticKITTI's and two of snow.
        config = yaml.safe_load((api / "config/semantic-kitti.yaml").read_text())
        if layout == "wads":
            config["labels"] |= {110: "active-snow", 111: "accumulated-snow"}
            config["color_map"] |= {110: [255, 255, 255], 111: [200, 200, 200]}
        sequences(sets / layout, api, config)
    finish()
