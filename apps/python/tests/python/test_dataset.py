"""Samples of plans and the PyTorch data set: the bytes of the files, in any order and process."""

import importlib.util
import math
import pickle
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from conftest import needed
from splat_file import write_ply

torch = needed("torch")

from torch.utils.data import DataLoader
from weather_magician import Batch, Error
from weather_magician.torch import CLEAREST, CONDITIONS, BlockShuffle, WeatherDataset

EXAMPLE = Path(__file__).parents[4] / "examples" / "python" / "train_on_weather.py"

RIG = """
[[sensor]]
name = "front"
kind = "camera"
rate = 20.0
size = [48, 32]
fov = 60.0
iso = 400

[[sensor]]
name = "top"
kind = "lidar"
model = "lidar.toml"
sub_rays = 1
format = "npy"
"""

LIDAR = """
name = "small"
wavelength = 905
divergence = 3.0
pulse = 6
range = [0.5, 100]
reference_range = 50
range_noise = 0.015
[rows]
rate = 10
elevations = [-12, -6, -2]
columns = 90
"""

PLAN = """
seed = 3
frames = 2
block = 8
also = ["depth.npy"]
pairs = true
splits = { train = 0.7, val = 0.3 }

[[scene]]
file = "red.ply"
up = [0, 0, 1]
ground = 0.0
metres_per_unit = 1.0

[[scene]]
file = "blue.ply"
up = [0, 0, 1]
ground = 0.0
metres_per_unit = 1.0

[[path]]
camera = "0,-6,1:0,4,1"
speed = 4

[rig]
file = "rig.toml"

[[weather]]
from = ["clear", "heavy-rain"]

[[weather]]
samples = 3
[weather.vary]
"fog.mor" = { distribution = "log-uniform", min = 8, max = 200 }
"""


def write_scene(path, rgb):
    """A floor and a box in front of the camera, as 3D Gaussian splatting files are."""
    floor = np.stack(np.meshgrid(np.arange(-6, 6, 0.5), np.arange(-8, 8, 0.5), [0.0]), -1).reshape(-1, 3)
    box = np.stack(np.meshgrid(np.arange(0, 2, 0.25), [3.0], np.arange(0, 2, 0.25)), -1).reshape(-1, 3)
    points = np.concatenate([floor, box]).astype("f4")
    colors = np.concatenate([np.full(floor.shape, 0.5), np.tile(rgb, (len(box), 1))])
    rows = np.zeros((len(points), 14), "f4")
    rows[:, :3] = points
    rows[:, 3:6] = (colors - 0.5) / 0.28209479
    rows[:, 6] = 4.0
    rows[:, 7:10] = np.log([0.35, 0.35, 0.05])
    rows[:, 10] = 1.0
    write_ply(path, rows)


def read_png(path):
    """Pixels [H, W, 3] of an 8-bit RGB picture."""
    data, at, packed = path.read_bytes(), 8, b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height = struct.unpack(">II", body[:8])
        elif kind == b"IDAT":
            packed += body
        at += 12 + length
    lines = np.frombuffer(zlib.decompress(packed), "u1").reshape(height, 1 + 3 * width).astype(int)
    pixels = np.zeros((height + 1, 3 * width + 3), int)  # with a row and a pixel of zeros before them
    for y, line in enumerate(lines):
        above, own = pixels[y], pixels[y + 1]
        for x in range(3, 3 * width + 3):
            left, up, corner = own[x - 3], above[x], above[x - 3]
            guess = left + up - corner
            nearest = min((abs(guess - left), 0, left), (abs(guess - up), 1, up), (abs(guess - corner), 2, corner))[2]
            own[x] = (line[x - 2] + (0, left, up, (left + up) // 2, nearest)[line[0]]) % 256
    return pixels[1:, 3:].reshape(height, width, 3).astype("u1")


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plan")
    write_scene(folder / "red.ply", (0.8, 0.2, 0.1))
    write_scene(folder / "blue.ply", (0.1, 0.2, 0.8))
    for name, text in [("rig.toml", RIG), ("lidar.toml", LIDAR), ("plan.toml", PLAN)]:
        (folder / name).write_text(text)
    return folder / "plan.toml"


@pytest.fixture(scope="module")
def data(plan):
    return WeatherDataset(plan, layers=("rgb", "depth"))


def same(one, other):
    return one.keys() == other.keys() and all(
        torch.equal(value, other[name]) if torch.is_tensor(value) else value == other[name]
        for name, value in one.items()
    )


def test_samples_have_the_bytes_of_the_files_in_any_order(plan, tmp_path):
    batch = Batch(plan, tmp_path / "set", device="cpu", threads=1)
    for block in range(2):
        batch.make(block)
    # Four clips of the first scene: two frames each. The camera is twice as fast as the frames.
    for frame in [7, 2, 0, 5]:
        sample = batch.sample(frame)
        stem = tmp_path / "set" / "frames" / sample["clip"] / "front" / f"{2 * (frame % 2):06}"
        assert sample["sensor"] == "front" and sample["frame"] == frame
        assert sample["rgb"].dtype == np.uint8 and sample["rgb"].shape == (32, 48, 3)
        assert np.array_equal(sample["rgb"], read_png(stem.with_suffix(".png")))
        assert np.array_equal(sample["clear"], read_png(stem.with_suffix(".clear.png")))
        assert np.array_equal(sample["depth"], np.load(stem.with_suffix(".depth.npy")))
        assert np.allclose(sample["viewmat"] @ sample["world_from_sensor"], np.eye(4))
        # The camera stands 1 m high and looks along y, before the box at y = 3 m.
        assert np.allclose(sample["world_from_sensor"][:3, 3], [0, -6 + 0.4 * (frame % 2), 1], atol=1e-6)
        assert np.allclose(sample["viewmat"][2, :3], [0, 1, 0], atol=1e-6)
        assert np.allclose(sample["K"][:2, 2], [24, 16]) and sample["K"][0, 0] == sample["K"][1, 1] > 0
    sweep = batch.sample(3, "top")
    rows = np.load(tmp_path / "set" / "frames" / sweep["clip"] / "top" / "000001.npy")
    order = np.lexsort(sweep["points"][:, :3].T), np.lexsort(rows[:, :3].T)
    assert np.array_equal(sweep["points"][order[0], :3], rows[order[1], :3]) and len(rows) > 50
    assert sweep["range"].shape == sweep["ring"].shape == (len(rows),) and "K" not in sweep
    assert set(batch.sample(3, layers=["median_depth"])) & {"rgb", "depth", "median_depth"} == {"median_depth"}


def test_weather_is_told_beside_the_layers(plan):
    batch = Batch(plan, device="cpu", threads=1)
    clear, rain, fog = (batch.sample(2 * clip, layers=[]) for clip in range(3))
    assert [one["condition"] for one in (clear, rain, fog)] == ["clear", "rain", "fog"]
    assert clear["weather"]["mor"] == math.inf and rain["weather"]["rain_rate"] > 1
    assert fog["weather"]["mor"] == pytest.approx(fog["weather"]["variables"]["fog.mor"])
    assert "fog" in fog["weather_file"] and fog["place"] == "red"
    assert (batch.sensors, batch.splits, batch.frames_per_clip) == (["front", "top"], ["train", "val"], 2)


def test_splits_share_the_frames_out(plan):
    batch = Batch(plan, device="cpu", threads=1)
    train, val = batch.split("train"), batch.split("val")
    assert sorted([*train, *val]) == list(range(20)) and len(train) > len(val) > 0
    assert train[-1] == list(train)[-1] and all(batch.sample(frame, layers=[])["split"] == "val" for frame in val)
    assert list(WeatherDataset(plan, split="val")._frames) == list(val)
    with pytest.raises(Error, match='no split "test": it has train, val'):
        batch.split("test")


def test_what_is_not_there_is_refused(plan, data):
    batch = data.batch
    for index in (20, -21):
        with pytest.raises(IndexError):
            data[index]
    for frame in (20, -1):
        with pytest.raises(IndexError):
            batch.sample(frame)
    with pytest.raises(IndexError):
        batch.split("val")[20]
    with pytest.raises(ValueError, match="layers: .dept. is not a picture output"):
        batch.sample(0, layers=["dept"])
    with pytest.raises(Error, match="no sensor `frnt`, did you mean `front`"):
        batch.sample(0, "frnt")
    with pytest.raises(Error, match="gone.toml: cannot be read"):
        WeatherDataset(plan.with_name("gone.toml"))


def test_a_sample_is_the_same_in_any_order_and_place(plan, data):
    again = WeatherDataset(plan, layers=("rgb", "depth"), places=1)
    forth = [data[index] for index in range(20)]
    back = [again[index] for index in reversed(range(20))][::-1]
    assert all(map(same, forth, back))
    assert len({sample["rgb"].numpy().tobytes() for sample in forth}) == 20
    assert same(data[-1], forth[19])
    first, foggy = forth[0], forth[4]
    assert first["rgb"].shape == (3, 32, 48) and first["depth"].shape == (32, 48)
    # Tensors over the memory that was rendered into.
    assert first["rgb"].permute(1, 2, 0).is_contiguous()
    assert first["log_mor"] == math.log(CLEAREST) and foggy["log_mor"] < math.log(200)
    assert [CONDITIONS[forth[index]["condition"]] for index in (0, 2, 4)] == ["clear", "rain", "fog"]


def test_workers_give_what_one_process_gives(data):
    own = list(DataLoader(data, batch_size=5))
    assert own[0]["rgb"].shape == (5, 3, 32, 48) and own[0]["condition"].dtype == torch.int64
    # The plan is open in this process, with threads that the forks have not.
    forked = list(DataLoader(data, batch_size=5, num_workers=2, multiprocessing_context="fork"))
    assert len(own) == len(forked) == 4 and all(map(same, own, forked))


def test_a_pickle_is_small_and_opens_the_plan_again(plan, data):
    pickled = pickle.dumps(data)
    assert len(pickled) < 2000
    assert same(pickle.loads(pickled)[3], data[3])
    loader = DataLoader(data, batch_size=10, num_workers=1, multiprocessing_context="spawn")
    assert same(next(iter(loader)), next(iter(DataLoader(data, batch_size=10))))
    changed = plan.with_name("changed.toml")
    changed.write_text(PLAN)
    pickled = pickle.dumps(WeatherDataset(changed))
    changed.write_text(PLAN.replace("seed = 3", "seed = 4"))
    with pytest.raises(Error, match="is not the plan that was pickled"):
        pickle.loads(pickled)


def test_blocks_are_shuffled_alike_in_every_process(data):
    orders = [list(BlockShuffle(data, block=6, seed=seed)) for seed in (1, 1, 2)]
    assert orders[0] == orders[1] != orders[2]
    assert all(sorted(order) == list(range(20)) for order in orders)
    # Indices of a block stay together.
    blocks = [index // 6 for index in orders[0]]
    assert sum(one != other for one, other in zip(blocks, blocks[1:])) == 3
    shuffle = BlockShuffle(data, block=6, seed=1)
    first, second = list(shuffle), list(shuffle)
    shuffle.set_epoch(0)
    assert first != second and list(shuffle) == first == orders[0] and len(shuffle) == 20


def test_a_transform_makes_the_sample(plan):
    data = WeatherDataset(plan, split="train", transform=lambda sample: (sample["rgb"].float() / 255, sample["condition"]))
    picture, condition = data[1]
    assert picture.max() <= 1 and condition in range(len(CONDITIONS))


def test_the_example_learns(plan):
    spec = importlib.util.spec_from_file_location("train_on_weather", EXAMPLE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    losses = example.train(plan, steps=10)
    assert len(losses) == 10 and np.mean(losses[-3:]) < 0.8 * np.mean(losses[:3])
