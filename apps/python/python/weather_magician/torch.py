"""Frames of a plan as samples for PyTorch, rendered when they are asked for.

    from torch.utils.data import DataLoader
    from weather_magician.torch import BlockShuffle, WeatherDataset

    train = WeatherDataset("plan.toml", split="train", layers=("rgb", "depth"))
    loader = DataLoader(train, batch_size=8, sampler=BlockShuffle(train), num_workers=2)
    for batch in loader:
        batch["rgb"]           # uint8 [8, 3, H, W], sRGB
        batch["condition"]     # int64 [8], indices into CONDITIONS

A sample follows from the plan and its number alone, so it is the same in every epoch, process and order; the files that ``batch`` writes
have the same bytes. PyTorch is no dependency of the package: ``pip install 'weather-magician[torch]'`` brings it.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

try:
    import torch
    from torch.utils.data import Dataset, Sampler
except ImportError as error:
    raise ImportError("weather_magician.torch needs PyTorch: pip install 'weather-magician[torch]'") from error

from weather_magician._native import CONDITIONS, Batch, Permutation

__all__ = ["CLEAREST", "CONDITIONS", "BlockShuffle", "WeatherDataset"]

#: Visibility of clear air in targets, m: that of the plan is infinite.
CLEAREST = 20_000.0


class WeatherDataset(Dataset):
    """The frames of a plan, or of one of its splits, each as a dictionary.

    Layers of pictures are tensors ``[C, H, W]``, or ``[H, W]`` for one channel, with the types of :meth:`Batch.sample`; a lidar gives
    ``points`` ``[N, 4]`` and its other arrays ``[N]``, for which a loader needs a ``collate_fn`` of its own. All share their memory with
    what was rendered. Beside them are ``frame`` (the frame's number in the plan), ``K`` ``[3, 3]`` (px) and ``viewmat`` ``[4, 4]`` (OpenCV
    axes, metres) of a camera, and as targets

    - ``condition``: an index into :data:`CONDITIONS` (clear, fog, rain, snow, dust, night);
    - ``log_mor``: natural logarithm of the visibility in m, of :data:`CLEAREST` at most;
    - ``rain_rate`` and ``snow_rate``, mm/h of water; ``is_night``.

    They are those of the clip when it begins.

    :param plan: the plan, a TOML file for ``batch``
    :param split: one of the plan's splits; ``None`` for the whole set
    :param sensor: the name of a sensor; ``None`` for the first camera
    :param layers: layers of pictures, as :meth:`Batch.sample` has them
    :param transform: a function of each dictionary, whose result is the sample
    :param device: ``"cpu"``, ``"gpu"`` or ``"auto"``: what renders. Tensors are in the computer's memory either way
    :param threads: threads of rendering in each process; 1 lets workers share the processors
    :param places: scenes that each process keeps open
    """

    def __init__(
        self,
        plan: Any,
        split: str | None = None,
        sensor: str | None = None,
        layers: Sequence[str] = ("rgb",),
        transform: Callable[[dict[str, Any]], Any] | None = None,
        device: str = "cpu",
        threads: int | None = 1,
        places: int = 2,
    ) -> None:
        self.batch = Batch(plan, device=device, threads=threads)
        self.split = split
        self.sensor = sensor
        self.layers = [layers] if isinstance(layers, str) else list(layers)
        self.transform = transform
        self.places = places
        self._frames: Sequence[int] = self._listed()

    def _listed(self) -> Sequence[int]:
        return range(self.batch.frames) if self.split is None else self.batch.split(self.split)

    def __getstate__(self) -> dict[str, Any]:
        # The list of frames is counted anew where it arrives.
        return {name: value for name, value in self.__dict__.items() if name != "_frames"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._frames = self._listed()

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int) -> Any:
        frame = self._frames[index]
        read = self.batch.sample(frame, self.sensor, self.layers, places=self.places)
        sample = {name: _tensor(value) for name, value in read.items() if hasattr(value, "__array__")}
        weather = read["weather"]
        sample["frame"] = frame
        sample["condition"] = CONDITIONS.index(read["condition"])
        sample["log_mor"] = math.log(min(weather["mor"], CLEAREST))
        sample["rain_rate"] = weather["rain_rate"]
        sample["snow_rate"] = weather["snow_rate"]
        sample["is_night"] = weather["is_night"]
        return sample if self.transform is None else self.transform(sample)


def _tensor(value: Any) -> torch.Tensor:
    if value.dtype.name == "uint16":
        # PyTorch computes with few operations on uint16; labels below 32768 have the same bits.
        value = value.view("int16")
    tensor = torch.from_numpy(value)
    # Only layers have three axes: [H, W, C].
    return tensor.permute(2, 0, 1) if tensor.ndim == 3 else tensor


class BlockShuffle(Sampler):
    """An order in which neighbours still share a scene: blocks of indices in random order, and the indices of a block in random order.

    A scene that is not open takes seconds, and a weather that lies or glows takes time in each place once. So an order over all samples
    is slow with more scenes than stay open. The order follows from ``seed`` and the epoch alone and takes no memory.

    :param data: the data set
    :param block: indices of a block: larger ones mix more weathers, smaller ones change scenes more often. Default: ten clips, of at least 256 samples
    :param seed: of all orders
    """

    def __init__(self, data: WeatherDataset, block: int | None = None, seed: int = 0) -> None:
        self.count = len(data)
        self.block = block or max(256, 10 * data.batch.frames_per_clip)
        self.seed = seed
        self.epoch = 0

    def set_epoch(self, epoch: int) -> None:
        """Sets the epoch, of which the order depends; each iteration raises it by one."""
        self.epoch = epoch

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[int]:
        epoch = self.epoch
        self.epoch += 1
        blocks = Permutation(-(-self.count // self.block), self.seed, 2 * epoch)
        for block in blocks:
            first = block * self.block
            own = min(self.block, self.count - first)
            for index in Permutation(own, self.seed + block + 1, 2 * epoch + 1):
                yield first + index
