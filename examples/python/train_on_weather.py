"""Trains a small network to tell the weather in pictures that are rendered as they are needed.

    python train_on_weather.py plan.toml

A plan for it needs a scene and weathers, such as

    splits = { train = 0.8, val = 0.2 }
    [[scene]]
    file = "street.ply"
    [rig]
    size = [96, 64]
    fov = 60
    [[weather]]
    samples = 200
"""

import itertools
import sys

import torch
from torch import nn
from torch.utils.data import DataLoader
from weather_magician.torch import CONDITIONS, BlockShuffle, WeatherDataset


def network(outputs):
    """Three strided convolutions and a mean over the picture."""

    def layer(channels, more):
        return nn.Sequential(nn.Conv2d(channels, more, 3, stride=2, padding=1), nn.ReLU())

    return nn.Sequential(
        layer(3, 16), layer(16, 32), layer(32, 32), nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(32, outputs)
    )


def train(plan, steps=10, workers=0):
    """Returns the loss of each step."""
    torch.manual_seed(0)
    data = WeatherDataset(plan, split="train", layers=("rgb",))
    loader = DataLoader(data, batch_size=8, sampler=BlockShuffle(data), num_workers=workers)
    model = network(len(CONDITIONS))
    optimizer = torch.optim.Adam(model.parameters(), lr=0.01)
    losses = []
    epochs = itertools.repeat(loader)
    for batch in itertools.islice(itertools.chain.from_iterable(epochs), steps):
        # For visibility: one output, and the mean square of its difference to batch["log_mor"].
        guess = model(batch["rgb"].float() / 255 - 0.5)
        loss = nn.functional.cross_entropy(guess, batch["condition"])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    return losses


if __name__ == "__main__":
    for step, loss in enumerate(train(sys.argv[1], steps=100, workers=2)):
        print(f"step {step}: loss {loss:.3f}")
