"""Trains a small network to tell visibility from pictures that are rendered as they are needed.

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
    vary."fog.mor" = { distribution = "log-uniform", min = 20, max = 2000 }
"""

import itertools
import sys

import torch
from torch import nn
from torch.utils.data import DataLoader
from weather_magician.torch import BlockShuffle, WeatherDataset


def network():
    """Three strided convolutions and a mean: the natural logarithm of the visibility in m, less 5."""

    def layer(channels, more):
        return nn.Sequential(nn.Conv2d(channels, more, 3, stride=2, padding=1), nn.ReLU())

    return nn.Sequential(
        layer(3, 16), layer(16, 32), layer(32, 32), nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(32, 1)
    )


def train(plan, steps=10, workers=0):
    """Returns the loss of each step."""
    torch.manual_seed(0)
    data = WeatherDataset(plan, split="train", layers=("rgb",))
    loader = DataLoader(data, batch_size=8, sampler=BlockShuffle(data), num_workers=workers)
    model = network()
    optimizer = torch.optim.Adam(model.parameters(), lr=0.01)
    losses = []
    for batch in itertools.islice(itertools.chain.from_iterable(itertools.repeat(loader)), steps):
        guess = model(batch["rgb"].float() / 255).squeeze(1)
        loss = nn.functional.mse_loss(guess, batch["log_mor"].float() - 5)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    return losses


if __name__ == "__main__":
    for step, loss in enumerate(train(sys.argv[1], steps=100, workers=2)):
        print(f"step {step}: loss {loss:.3f}")
