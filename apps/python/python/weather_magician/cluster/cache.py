"""Files on a node: what is fetched once for all of its workers, and the folders in which they make blocks."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from pathlib import Path
from typing import Callable, Iterator

from .inputs import digest_of
from .runner import ClusterError

try:
    import fcntl
except ImportError:
    # Without locks two workers may fetch a file twice; it is put in place whole all the same.
    fcntl = None


class NodeCache:
    """The folder of a node's files.

    folder: default is one of the user's in the folder for temporary files (`TMPDIR`), which is mostly a disk of the node. Files are named
    by their SHA-256, and whatever is there is whole.
    """

    def __init__(self, folder: str | os.PathLike | None = None) -> None:
        self.folder = Path(folder or _default())
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if hasattr(os, "getuid") and self.folder.stat().st_uid != os.getuid():
            raise ClusterError(f"{self.folder}: belongs to another user; give another folder with --cache")

    @contextlib.contextmanager
    def lock(self, name: str) -> Iterator[None]:
        """Holds a lock among the workers of the node."""
        path = self.folder / "locks" / name
        path.parent.mkdir(exist_ok=True)
        with open(path, "a") as file:
            if fcntl:
                fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def file(self, sha256: str, fetch: Callable[[Path], None]) -> Path:
        """Returns the file of a hash; if it is not there, `fetch` writes it to a path."""
        path = self.folder / "files" / sha256
        if path.exists():
            return path
        with self.lock(sha256):
            if path.exists():
                return path
            path.parent.mkdir(exist_ok=True)
            part = path.with_name(f".{sha256}.{os.getpid()}")
            try:
                fetch(part)
                found = digest_of(part)[1]
                if found != sha256:
                    raise OSError(f"{part}: the file that was fetched has SHA-256 {found[:12]}, not {sha256[:12]}")
                # Workers share it through links: nobody may write to it.
                part.chmod(0o444)
                os.replace(part, path)
            finally:
                part.unlink(missing_ok=True)
        return path

    def tree(self, digest: str, files: dict[str, Callable[[], Path]]) -> Path:
        """Returns a folder with files by their names, made once; `files` gives the path of each file in this cache."""
        path = self.folder / "inputs" / digest
        if path.exists():
            return path
        with self.lock(f"tree-{digest}"):
            if path.exists():
                return path
            path.parent.mkdir(exist_ok=True)
            part = Path(tempfile.mkdtemp(prefix=f".{digest[:12]}.", dir=path.parent))
            try:
                for name, file in files.items():
                    to = part / name
                    if not to.resolve().is_relative_to(part.resolve()):
                        raise ClusterError(f"{name}: leads out of the folder of inputs")
                    to.parent.mkdir(parents=True, exist_ok=True)
                    _link(file(), to)
                os.replace(part, path)
            finally:
                shutil.rmtree(part, ignore_errors=True)
        return path

    def scratch(self) -> "Scratch":
        """Returns a folder of this process; those of processes that are gone are removed."""
        folder = self.folder / "scratch"
        folder.mkdir(exist_ok=True)
        with self.lock("scratch"):
            for other in folder.iterdir():
                Scratch.remove_if_left(other)
            return Scratch(Path(tempfile.mkdtemp(prefix=f"{os.getpid()}.", dir=folder)))


class Scratch:
    """A folder that belongs to this process as long as it lives: it holds a lock on a file in it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.held = open(path / ".held", "a")
        if fcntl:
            fcntl.flock(self.held, fcntl.LOCK_EX)

    @staticmethod
    def remove_if_left(path: Path) -> None:
        """Removes a folder whose process is gone."""
        if not fcntl:
            return
        try:
            with open(path / ".held", "a") as held:
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(path, ignore_errors=True)
        except OSError:
            return


def _default() -> Path:
    user = os.getuid() if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    return Path(tempfile.gettempdir()) / f"weather-magician-{user}"


def _link(source: Path, to: Path) -> None:
    try:
        os.link(source, to)
    except OSError:
        # Not every file system has links.
        shutil.copyfile(source, to)
