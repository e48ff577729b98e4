#!/usr/bin/env python3
"""Holds the layout `nuscenes` against nuscenes-devkit: loads a set with it and compares counts, intrinsics, poses, times, points and pixels with
`truth.json`, the set's own numbers, then draws points into a picture and joins sweeps as trainings do.

    cargo run -p wm-batch --features testing --example synthetic_set -- nuscenes SET
    python3 -m venv VENV && VENV/bin/pip install nuscenes-devkit==1.2.0 'numpy<2'
    VENV/bin/python tests/peers/nuscenes.py SET

It takes seconds and is no part of `cargo test`. The exit code is 1 if anything differs.
"""

import json
import sys
from pathlib import Path

from common import check, finish, turn

# This file has the package's name: its folder must not be searched.
sys.path.pop(0)

import numpy as np
from nuscenes.nuscenes import NuScenes
from nuscenes.utils.data_classes import LidarPointCloud, RadarPointCloud
from nuscenes.utils.data_io import load_bin_file
from nuscenes.utils.geometry_utils import transform_matrix, view_points
from nuscenes.utils.splits import get_scenes_of_split
from PIL import Image
from pyquaternion import Quaternion


def main():
    folder = Path(sys.argv[1])
    truth = json.loads((folder / "truth.json").read_text())
    nusc = NuScenes(version=f"v1.0-{truth['name']}", dataroot=str(folder), verbose=False)
    sensors = {sensor["name"]: sensor for sensor in truth["sensors"]}
    readings = [(clip, reading) for clip in truth["clips"] for reading in clip["readings"]]
    frames = max(1, round(truth["frame_rate"] / 2))
    keys = [(clip, r) for clip, r in readings if r["is_key"] and r["frame"] % frames == 0]
    samples = {(clip["name"], r["frame"]) for clip, r in keys}
    check("counts", (len(nusc.scene), len(nusc.sample), len(nusc.sample_data)) == (len(truth["clips"]), len(samples), len(readings)),
          f"{len(nusc.scene)} scenes, {len(nusc.sample)} samples, {len(nusc.sample_data)} readings, {len(nusc.lidarseg)} classified sweeps")
    check("key readings", sum(r["is_key_frame"] for r in nusc.sample_data) == len(keys), f"{len(keys)}")

    # Channels by sensor: readings of a clip at the same time, of sensors at the same place.
    scene_of = {s["token"]: nusc.get("scene", s["scene_token"])["name"] for s in nusc.sample}
    found = {}
    for record in nusc.sample_data:
        found.setdefault((scene_of[record["sample_token"]], record["timestamp"]), []).append(record)
    far = {"place, m": 0, "turn, rad": 0, "intrinsics, px": 0, "spot in points, m": 0}
    quarter = transform_matrix([0, 0, 0], Quaternion(axis=[0, 0, 1], angle=-np.pi / 2))
    world_from, records = {}, {}
    for clip, reading in readings:
        sensor = sensors[reading["sensor"]]
        near = lambda record: np.linalg.norm(
            np.array(nusc.get("calibrated_sensor", record["calibrated_sensor_token"])["translation"]) - np.array(sensor["rig_from_sensor"])[:3, 3])
        record = min((r for r in found[clip["name"], reading["timestamp"] // 1000] if r["sensor_modality"] == sensor["kind"]), key=near)
        calibration, ego = nusc.get("calibrated_sensor", record["calibrated_sensor_token"]), nusc.get("ego_pose", record["ego_pose_token"])
        pose = transform_matrix(ego["translation"], Quaternion(ego["rotation"])) @ transform_matrix(
            calibration["translation"], Quaternion(calibration["rotation"]))
        world_from[record["token"]], records[record["token"]] = pose, (clip, reading, sensor)
        expected = np.array(reading["world_from_sensor"]) @ (quarter if sensor["kind"] == "lidar" else np.eye(4))
        far["place, m"] = max(far["place, m"], np.linalg.norm(pose[:3, 3] - expected[:3, 3]))
        far["turn, rad"] = max(far["turn, rad"], turn(pose, expected))
        path = folder / record["filename"]
        if sensor["kind"] == "camera":
            (fx, fy), (cx, cy) = sensor["focal"], sensor["center"]
            k = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
            far["intrinsics, px"] = max(far["intrinsics, px"], np.abs(k - calibration["camera_intrinsic"]).max())
            assert Image.open(path).size == tuple(sensor["size"]) == (record["width"], record["height"])
        elif sensor["kind"] == "lidar":
            cloud = LidarPointCloud.from_file(str(path))
            assert cloud.nbr_points() == truth["points"]
            spot = (pose @ np.append(cloud.points[:3, 0], 1))[:3]
            far["spot in points, m"] = max(far["spot in points, m"], np.linalg.norm(spot - truth["spot"]))
        else:
            assert RadarPointCloud.from_file(str(path)).nbr_points() == truth["detections"]
    for name, limit in [("place, m", 1e-9), ("turn, rad", 1e-8), ("intrinsics, px", 1e-9), ("spot in points, m", 1e-5)]:
        check(name, far[name] <= limit, f"at most {far[name]:.1e} in {len(readings)} readings")

    # The devkit's own projection of a sweep, kept where it is inside of the picture: the spot must
    # be where the picture shows it.
    worst, pale, shown, channels = 0, 0, 0, set()
    for sample in nusc.sample:
        for channel, token in sample["data"].items():
            clip, reading, sensor = records[token]
            if sensor["kind"] != "camera" or reading["spot_pixel"] is None:
                continue
            points, depths, picture = nusc.explorer.map_pointcloud_to_image(sample["data"]["LIDAR_TOP"], token, min_dist=0.1)
            expected = np.array(reading["spot_pixel"]) - 0.5
            worst = max(worst, np.linalg.norm(points[:2] - expected[:, None], axis=0).min())
            column, row = np.rint(expected).astype(int)
            red, green, blue = (int(value) for value in picture.getpixel((int(column), int(row))))
            pale, shown = max(pale, 255 - red, green, blue), shown + 1
            channels.add(channel)
    check("devkit's projection", shown and worst < 0.01, f"at most {worst:.1e} px off in {shown} pictures of {sorted(channels)}")
    check("colour there", pale < 40, f"red within {pale} of 255")
    by_hand, cameras = 0, set()
    for token, (clip, reading, sensor) in records.items():
        if sensor["kind"] == "camera" and reading["spot"][2] > 1:
            k = np.array(nusc.get("calibrated_sensor", nusc.get("sample_data", token)["calibrated_sensor_token"])["camera_intrinsic"])
            at = view_points((np.linalg.inv(world_from[token]) @ np.append(truth["spot"], 1))[:3, None], k, normalize=True)[:2, 0]
            (fx, fy), (cx, cy), (x, y, z) = sensor["focal"], sensor["center"], reading["spot"]
            by_hand = max(by_hand, np.abs(at + 0.5 - [fx * x / z + cx, fy * y / z + cy]).max())
            cameras.add(sensor["name"])
    check("pixels of all cameras", by_hand < 1e-6, f"at most {by_hand:.1e} px off, cameras {sorted(cameras)}")

    # Ten sweeps in one frame, as detectors read them: the spot is one place.
    sample = nusc.sample[len(samples) // len(truth["clips"]) - 1]
    cloud, times = LidarPointCloud.from_file_multisweep(nusc, sample, "LIDAR_TOP", "LIDAR_TOP", nsweeps=10)
    spots = cloud.points[:3, cloud.points[3] == 40]
    check("multisweep", spots.shape[1] == 10 and np.ptp(spots, axis=1).max() < 1e-4,
          f"{spots.shape[1]} sweeps over {times.max():.2f} s, the spot within {np.ptp(spots, axis=1).max():.1e} m")
    radar, _ = RadarPointCloud.from_file_multisweep(nusc, sample, "RADAR_FRONT", "RADAR_FRONT", nsweeps=5)
    check("radar sweeps", radar.nbr_points() == 5 * truth["detections"], f"{radar.nbr_points()} detections")
    speeds = np.linalg.norm(radar.points[6:8], axis=0)
    check("radial velocities", np.abs(speeds - 7.5).max() < 1e-5, f"{speeds.min():.3f} to {speeds.max():.3f} m/s")

    labels = [load_bin_file(str(folder / record["filename"])) for record in nusc.lidarseg]
    noise = sum((label == nusc.lidarseg_name2idx_mapping["noise"]).sum() for label in labels)
    check("lidarseg", all(len(label) == truth["points"] for label in labels) and noise == 2 * len(labels), f"{noise} points of noise")
    points, colours, _ = nusc.explorer.map_pointcloud_to_image(sample["data"]["LIDAR_TOP"], sample["data"]["CAM_FRONT"], show_lidarseg=True)
    check("classes drawn", len(colours) == points.shape[1] > 0, f"{points.shape[1]} points in front")
    for split in {clip["split"] for clip in truth["clips"]}:
        names = get_scenes_of_split(f"{truth['name']}_{split}", nusc)
        check(f"split {split}", names == [c["name"] for c in truth["clips"] if c["split"] == split], ", ".join(names))
    nusc.list_scenes()
    finish()


if __name__ == "__main__":
    main()
