#!/usr/bin/env python3
"""Holds the layout `argoverse2` against Argoverse's own reader: logs of the synthetic set are read by `av2`, and counts, times, poses,
intrinsics, points and the pixel of a known point must be those of `truth.json`.

    cargo run -p wm-batch --features testing --example synthetic_set -- argoverse2 FOLDER
    python3 -m venv VENV && VENV/bin/pip install av2
    VENV/bin/python tests/peers/argoverse2.py FOLDER

It is no part of `cargo test`. The exit code is 1 if anything differs.
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from av2.datasets.sensor.av2_sensor_dataloader import AV2SensorDataLoader
from av2.structures.sweep import Sweep
from av2.torch.data_loaders.detection import DetectionDataLoader
from av2.utils.io import read_feather, read_img

from common import check, finish

# Names of the synthetic rig's cameras, which look 0, 60 and -60 degrees to the left.
CAMERAS = {"front": "ring_front_center", "left": "ring_front_left", "right": "ring_front_right"}


def main():
    folder = Path(sys.argv[1])
    truth = json.loads((folder / "truth.json").read_text())
    sensors = {sensor["name"]: sensor for sensor in truth["sensors"]}
    spot = np.array(truth["spot"])
    for clip in truth["clips"]:
        print(clip["name"])
        data = folder / clip["split"]
        loader = AV2SensorDataLoader(data_dir=data, labels_dir=data)
        log = clip["name"]
        check("log", log in loader.get_log_ids(), f"{loader.get_log_ids()}")
        readings = clip["readings"]
        lidar = [reading for reading in readings if reading["sensor"] == "top"]
        times = loader.get_ordered_log_lidar_timestamps(log)
        check("sweeps", times == [reading["timestamp"] for reading in lidar], f"{len(times)} sweeps")
        pose = max(
            np.abs(loader.get_city_SE3_ego(log, reading["timestamp"]).transform_matrix - reading["world_from_rig"]).max()
            for reading in readings
        )
        check("poses", pose < 1e-9, f"{len(readings)} readings, {pose:.1e} from truth")

        intrinsic = extrinsic = 0.0
        for own, name in CAMERAS.items():
            camera = loader.get_log_pinhole_camera(log, name)
            want = sensors[own]
            extrinsic = max(extrinsic, np.abs(camera.ego_SE3_cam.transform_matrix - want["rig_from_sensor"]).max())
            (fx, fy), (cx, cy) = want["focal"], want["center"]
            k = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
            intrinsic = max(intrinsic, np.abs(camera.intrinsics.K - k).max())
            check(f"size {name}", [camera.width_px, camera.height_px] == want["size"], f"{camera.width_px}x{camera.height_px}")
        check("intrinsics", intrinsic == 0, f"{intrinsic:.1e} px from truth")
        check("extrinsics", extrinsic < 1e-12, f"{extrinsic:.1e} from truth")

        # The spot by the sweep, from the rig at the sweep's time to the picture's pixel, and the
        # red dot in the picture there.
        far, pixel, seen, red = 0.0, 0.0, 0, []
        for reading in lidar:
            sweep = Sweep.from_feather(loader.get_lidar_fpath(log, reading["timestamp"]))
            want = np.linalg.inv(reading["world_from_rig"]) @ [*spot, 1]
            far = max(far, np.abs(sweep.xyz[0] - want[:3]).max())
            if len(sweep) != truth["points"] or sweep.offset_ns[-1] != 5_900_000 or sweep.laser_number.max() != 15:
                check("sweep", False, f"{len(sweep)} points, {sweep.offset_ns[-1]} ns, laser {sweep.laser_number.max()}")
            for other in readings:
                if other["frame"] != reading["frame"] or not other.get("spot_pixel"):
                    continue
                name = CAMERAS[other["sensor"]]
                uv, _, _ = loader.project_ego_to_img_motion_compensated(
                    want[None, :3], name, other["timestamp"], reading["timestamp"], log
                )
                # Their first pixel's centre is at 0, ours at 0.5.
                pixel = max(pixel, np.abs(uv[0] + 0.5 - other["spot_pixel"]).max())
                path = loader.get_closest_img_fpath(log, name, reading["timestamp"])
                image = read_img(path).astype(int)
                u, v = np.floor(np.array(other["spot_pixel"])).astype(int)
                seen += 1
                found = np.unravel_index((image[..., 0] - image[..., 1]).argmax(), image.shape[:2])
                red.append((found[0], found[1]) == (v, u))
        check("spot in sweeps", far < 0.5 / 64 + 1e-6, f"{far:.4f} m from truth (16-bit floats: 0.0078)")
        check("spot in pictures", pixel < 1e-6 and seen > 10, f"{seen} pictures, {pixel:.1e} px from truth")
        check("red in pictures", len(red) == seen and all(red), f"{sum(red)} of {len(red)}")
        pictures = {name: len(loader.get_ordered_log_cam_fpaths(log, name)) for name in CAMERAS.values()}
        check("pictures", all(count == len(lidar) for count in pictures.values()), f"{pictures}")
        boxes = loader.get_labels_at_lidar_timestamp(log, times[0])
        check("boxes", len(boxes.cuboids) == 0, f"{len(boxes.cuboids)}")
        kinds = read_feather(loader.get_lidar_fpath(log, times[0])).dtypes.astype(str).to_dict()
        want = dict(x="float16", y="float16", z="float16", intensity="uint8", laser_number="uint8", offset_ns="int32")
        check("columns", kinds == want, f"{kinds}")
    # The data loader in Rust, which has a reader of Feather of its own.
    with tempfile.TemporaryDirectory() as root:
        (Path(root) / "av2").mkdir()
        (Path(root) / "av2/sensor").symlink_to(folder.resolve())
        for clip in truth["clips"]:
            sweeps = DetectionDataLoader(root_dir=Path(root), dataset_name="av2", split_name=clip["split"])
            far, times = 0.0, []
            for index in range(len(sweeps)):
                sweep = sweeps[index]
                times.append(sweep.sweep_uuid[1])
                (reading,) = [r for r in clip["readings"] if r["sensor"] == "top" and r["timestamp"] == times[-1]]
                want = np.linalg.inv(reading["world_from_rig"]) @ [*spot, 1]
                far = max(far, np.abs(sweep.lidar.as_tensor()[0, :3].numpy() - want[:3]).max())
            check(f"av2.torch {clip['split']}", far < 0.5 / 64 + 1e-6 and len(set(times)) == 20, f"{len(times)} sweeps, {far:.4f} m")
    finish()


if __name__ == "__main__":
    main()
