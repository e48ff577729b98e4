"""What the tests share: a small scene, and the program."""

import os
import subprocess
import sys

import pytest

import weather_magician as wm

def needed(module):
    """Imports a module that tests need; they are skipped without it, or fail where nothing may be skipped.

    PyTorch, which is large, is required by a word of its own: WM_REQUIRE_TORCH.
    """
    try:
        return __import__(module)
    except ImportError:
        if os.environ.get("WM_REQUIRE_TORCH" if module == "torch" else "WM_REQUIRE_PYTHON") == "1":
            raise
        pytest.skip(f"{module} is not installed", allow_module_level=True)


@pytest.fixture(scope="session")
def street(tmp_path_factory):
    """The path of the built-in street, thinly sampled."""
    path = tmp_path_factory.mktemp("place") / "street.ply"
    wm.Scene.street(0.05).save(path)
    return path


@pytest.fixture(scope="session")
def place(street):
    """The scene in a renderer on the CPU."""
    return wm.Renderer(street, device="cpu")


@pytest.fixture(scope="session")
def program():
    """Runs the program; returns what it printed and its exit status."""

    def run(*args, cwd=None, check=True):
        words = [sys.executable, "-m", "weather_magician", *map(str, args)]
        done = subprocess.run(words, cwd=cwd, capture_output=True, text=True)
        assert done.returncode == 0 or not check, done.stderr
        return done

    return run
