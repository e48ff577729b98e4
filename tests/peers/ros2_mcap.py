#!/usr/bin/env python3
"""Holds the layout `ros2-mcap` against two readers of ROS 2 bags: files of the synthetic set are decoded by `mcap-ros2-support`, by the
definitions in them, and bags by `rosbags`, by its own definitions of Humble; counts, transforms, CameraInfo, points and the pixel of a
known point must be those of `truth.json`.

    cargo run -p wm-batch --features testing --example synthetic_set -- ros2-mcap FOLDER
    python3 -m venv VENV && VENV/bin/pip install mcap-ros2-support==0.6.0 rosbags==0.11.9 numpy pillow
    VENV/bin/python tests/peers/ros2_mcap.py FOLDER

It is no part of `cargo test`. The exit code is 1 if anything differs.
"""

import io
import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from PIL import Image
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from common import check, finish, matrix, rotation

KINDS = {2: "u1", 4: "<u2", 6: "<u4", 7: "<f4", 8: "<f8"}


def pose(transform):
    t, q = transform.translation, transform.rotation
    return matrix(rotation(q.w, q.x, q.y, q.z), [t.x, t.y, t.z])


def is_reddest(picture, x, y):
    """True if the pixel at x, y is the reddest."""
    found = np.unravel_index((picture[..., 0] - picture[..., 1]).argmax(), picture.shape[:2])
    return found == (y, x)


def stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def cloud(message):
    kind = np.dtype({
        "names": [field.name for field in message.fields],
        "formats": [KINDS[field.datatype] for field in message.fields],
        "offsets": [field.offset for field in message.fields],
        "itemsize": message.point_step,
    })
    return np.frombuffer(bytes(message.data), kind, message.width * message.height)


def hold(name, messages, clip, truth):
    """Messages as (topic, log time, message), in order, against a clip of truth."""
    print(f"{clip['name']} by {name}")
    sensors = {sensor["name"]: sensor for sensor in truth["sensors"]}
    readings = {(reading["sensor"], reading["timestamp"]): reading for reading in clip["readings"]}
    spot = np.array([*truth["spot"], 1])
    static, world, counts = {}, {}, Counter()
    worst = Counter()
    seen, red = 0, []
    pictures = {}
    for topic, time, message in messages:
        counts[topic] += 1
        if topic == "/tf_static":
            static = {t.child_frame_id: pose(t.transform) for t in message.transforms}
            for frame, found in static.items():
                worst["tf_static"] = max(worst["tf_static"], np.abs(found - sensors[frame]["rig_from_sensor"]).max())
            continue
        if topic == "/tf":
            (t,) = message.transforms
            assert (t.header.frame_id, t.child_frame_id) == ("map", "base_link") and stamp(t) == time
            world[time] = pose(t.transform)
            continue
        sensor = topic.split("/")[2]
        assert message.header.frame_id == sensor and stamp(message) == time
        reading = readings[sensor, time]
        worst["tf"] = max(worst["tf"], np.abs(world[time] - reading["world_from_rig"]).max())
        if topic.endswith("compressed"):
            pictures[sensor] = np.array(Image.open(io.BytesIO(bytes(message.data))).convert("RGB")).astype(int)
            continue
        if topic.endswith("camera_info"):
            want = sensors[sensor]
            assert [message.width, message.height] == want["size"] and message.distortion_model == "plumb_bob"
            k, p = np.array(message.k).reshape(3, 3), np.array(message.p).reshape(3, 4)
            (fx, fy), (cx, cy) = want["focal"], want["center"]
            near = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
            worst["K"] = max(worst["K"], np.abs(k - near).max(), np.abs(p[:, :3] - near).max(), np.abs(message.d).max())
            if reading.get("spot_pixel"):
                u, v, w = p @ np.linalg.inv(world[time] @ static[sensor]) @ spot
                pixel = np.array([u / w, v / w]) + 0.5
                worst["pixel"] = max(worst["pixel"], np.abs(pixel - reading["spot_pixel"]).max())
                x, y = np.floor(pixel).astype(int)
                seen += 1
                red.append(is_reddest(pictures[sensor], x, y))
            continue
        points = cloud(message)
        if sensor == "bumper":
            assert points.dtype.names == ("x", "y", "z", "velocity", "rcs", "snr") and len(points) == truth["detections"]
            assert points["velocity"][0] == -7.5 and points["rcs"][3] == 8 and points["snr"][0] == 14
            continue
        assert len(points) == truth["points"] and message.point_step == 32
        first = np.array([points[axis][0] for axis in "xyz"])
        worst["lidar"] = max(worst["lidar"], np.abs(first - reading["spot"]).max())
        assert points["channel"][17] == 1 and points["intensity"][1] == 41
        assert abs(int(points["time_stamp"][59]) - 5_900_000) <= 1
        length = np.sqrt(sum(points[axis].astype("f8") ** 2 for axis in "xyz"))
        worst["distance"] = max(worst["distance"], np.abs(points["distance"] - length).max())
        azimuth = np.arctan2(points["y"], points["x"])
        worst["azimuth"] = max(worst["azimuth"], np.abs(points["azimuth"] - azimuth).max())
    frames = len({reading["timestamp"] for reading in clip["readings"]})
    want = {"/tf": frames}
    for reading in clip["readings"]:
        ends = ["image/compressed", "camera_info"] if sensors[reading["sensor"]]["kind"] == "camera" else ["points"]
        for end in ends:
            topic = f"/sensors/{reading['sensor']}/{end}"
            want[topic] = want.get(topic, 0) + 1
    got = {topic: count for topic, count in counts.items() if topic != "/tf_static"}
    check("counts", got == want, f"{sum(counts.values())} messages of {len(counts)} topics")
    limits = dict(tf_static=1e-12, tf=1e-9, K=1e-12, pixel=1e-6, lidar=2e-6, distance=1e-5, azimuth=1e-6)
    for key, limit in limits.items():
        check(key, worst[key] <= limit, f"{worst[key]:.1e} from truth")
    check("red in pictures", len(red) == seen > 10 and all(red), f"{sum(red)} of {len(red)}")
    return counts


def main():
    folder = Path(sys.argv[1])
    truth = json.loads((folder / "truth.json").read_text())
    for clip in truth["clips"]:
        bag = folder / clip["split"] / clip["name"]
        files = sorted(bag.glob("*.mcap"))

        def by_mcap():
            for file in files:
                with file.open("rb") as stream:
                    reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
                    assert reader.get_header().profile == "ros2"
                    for _, channel, message, decoded in reader.iter_decoded_messages():
                        yield channel.topic, message.log_time, decoded

        hold(f"mcap-ros2-support, {len(files)} files", by_mcap(), clip, truth)

        store = get_typestore(Stores.ROS2_HUMBLE)
        with Reader(bag) as reader:
            def by_rosbags():
                for connection, time, data in reader.messages():
                    yield connection.topic, time, store.deserialize_cdr(data, connection.msgtype)

            counts = hold("rosbags", by_rosbags(), clip, truth)
            told = {topic: info.msgcount for topic, info in reader.topics.items()}
            check("metadata counts", told == dict(counts) and reader.message_count == sum(counts.values()), f"{reader.message_count}")
            times = [reading["timestamp"] for reading in clip["readings"]]
            # Its ends are exclusive.
            check("metadata times", (reader.start_time, reader.end_time - 1) == (min(times), max(times)), f"{reader.duration} ns")
        with AnyReader([bag]) as reader:
            count = sum(reader.deserialize(data, c.msgtype) is not None for c, _, data in reader.messages())
            check("by the definitions in the files", count == sum(counts.values()), f"{count} messages")
    finish()


if __name__ == "__main__":
    main()
