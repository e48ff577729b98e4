"""A set in a store that fsspec knows: S3, Google Cloud Storage, Azure, SFTP, a folder.

Blocks are made on the disks of nodes and moved whole: files first, the marker last. What lies in a store without a marker does not count and is
written over. Between runs the folder `.work` of the set holds what the plan reads; a merge removes it.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from pathlib import Path
from typing import Any, Iterable, Iterator

import fsspec

from .cache import NodeCache
from .inputs import Inputs
from .runner import ClusterError

DONE = "done"
WORK = ".work"
# Files that are moved in one call: fsspec moves them side by side where the store can.
TOGETHER = 256
# Stores on which a file appears before it is whole: there markers are renamed into place.
RENAMING = {"file", "local", "sftp", "ssh", "smb", "hdfs", "webhdfs"}
# Schemes of stores that live in one process.
OF_ONE_PROCESS = {"memory"}


def is_url(out: str) -> bool:
    """Returns true if an output is a store, and not a folder by its path."""
    return re.match(r"[a-zA-Z][a-zA-Z0-9+.-]+:", out) is not None


class SetStore:
    """A set in a store.

    url: as fsspec reads it. options: further arguments of fsspec's file system. Errors of the store are OSError, since another attempt may
    go well.
    """

    def __init__(self, url: str, options: dict[str, Any] | None = None) -> None:
        self.url = url.rstrip("/")
        self.scheme = url.partition(":")[0].lower()
        options = dict(options or {})
        if self.scheme in ("file", "local"):
            options.setdefault("auto_mkdir", True)
        try:
            self.fs, root = fsspec.core.url_to_fs(url, **options)
        except (ImportError, ValueError, TypeError) as error:
            raise ClusterError(f"{url}: {' '.join(str(error).split())}") from None
        self.root = root.rstrip("/")

    def path(self, name: str) -> str:
        """Returns the store's path of a file of the set."""
        return f"{self.root}/{name}"

    def read(self, name: str) -> bytes | None:
        """Returns the bytes of a file; None if it is not there."""
        with _Told(self, name):
            try:
                return self.fs.cat_file(self.path(name))
            except FileNotFoundError:
                return None

    def write(self, name: str, data: bytes) -> None:
        """Writes a small file: it appears whole."""
        with _Told(self, name):
            path = self.path(name)
            if self.scheme not in RENAMING:
                self.fs.pipe_file(path, data)
                return
            part = f"{path}.{os.getpid()}.part"
            self.fs.makedirs(path.rpartition("/")[0], exist_ok=True)
            self.fs.pipe_file(part, data)
            self.fs.mv(part, path)

    def put(self, folder: Path, names: Iterable[str]) -> None:
        """Copies files of a folder to the same names in the set."""
        names = list(names)
        for at in range(0, len(names), TOGETHER):
            some = names[at : at + TOGETHER]
            with _Told(self, some[0]):
                self.fs.put([str(folder / name) for name in some], [self.path(name) for name in some])

    def fetch(self, name: str, to: Path) -> None:
        """Copies a file of the set to a path."""
        with _Told(self, name):
            self.fs.get_file(self.path(name), str(to))

    def sizes(self, folder: str = "") -> dict[str, int]:
        """Returns the lengths of all files of the set, or of a folder of it, by their names."""
        with _Told(self, folder):
            # Another machine writes here: what an earlier look saw does not count.
            self.fs.invalidate_cache()
            try:
                found = self.fs.find(self.path(folder).rstrip("/"), detail=True)
            except FileNotFoundError:
                return {}
            return {path[len(self.root) + 1 :]: about["size"] for path, about in found.items()}

    def remove(self, name: str) -> None:
        """Removes a file or a folder of the set."""
        with _Told(self, name):
            try:
                self.fs.rm(self.path(name), recursive=True)
            except FileNotFoundError:
                return

    def sha256(self, name: str) -> str:
        """Returns the SHA-256 of a file's bytes in the store."""
        hash = hashlib.sha256()
        with _Told(self, name), self.fs.open(self.path(name), "rb") as file:
            while part := file.read(1 << 20):
                hash.update(part)
        return hash.hexdigest()

    # Blocks.

    def marker(self, block: int, plan: str) -> dict | None:
        """Returns the marker of a block; None if there is none, or it is not whole.

        plan: the digest of the plan. Raises ClusterError if the marker is of another plan.
        """
        name = marker_name(block)
        text = self.read(name)
        return None if text is None else self._marker(text, name, block, plan)

    def markers(self, blocks: int, plan: str) -> Iterator[tuple[int, dict, bytes]]:
        """Yields number, marker and the marker's bytes of each block that is done: whole, of this plan, and with all of its files."""
        sizes = self.sizes()
        names = [name for name in map(marker_name, range(blocks)) if name in sizes]
        for at in range(0, len(names), TOGETHER):
            some = names[at : at + TOGETHER]
            with _Told(self, some[0]):
                texts = self.fs.cat([self.path(name) for name in some])
            for name in some:
                block, text = int(Path(name).stem), texts[self.path(name)]
                marker = self._marker(text, name, block, plan)
                if marker and all(sizes.get(file["path"]) == file["bytes"] for file in marker["files"]):
                    yield block, marker, text

    def unmark(self, blocks: Iterable[int]) -> None:
        """Removes the markers of blocks, so that they are made again."""
        there = self.sizes(DONE)
        for name in map(marker_name, blocks):
            if name in there:
                self.remove(name)

    def _marker(self, text: bytes, name: str, block: int, plan: str) -> dict | None:
        try:
            marker = json.loads(text)
            own = (marker["plan"], marker["block"])
            for file in marker["files"]:
                _ = file["path"] + file["sha256"], int(file["bytes"])
        except (ValueError, KeyError, TypeError):
            return None
        if own != (plan, block):
            raise ClusterError(f"{self.url}/{name}: is of another plan; give another store with --out, or remove this one")
        return marker

    def put_block(self, folder: Path, block: int) -> dict:
        """Moves a block that was made in a folder: its files, then its marker. Returns the marker."""
        text = (folder / marker_name(block)).read_bytes()
        marker = json.loads(text)
        names = [file["path"] for file in marker["files"]]
        self.put(folder, names)
        self.write(marker_name(block), text)
        for name in (*names, marker_name(block)):
            (folder / name).unlink(missing_ok=True)
        return marker

    # What the plan reads.

    def put_inputs(self, inputs: Inputs) -> str:
        """Copies the files of a plan to the store, each once by its hash; returns the name of their list."""
        rows = {file.name: file.sha256 for file in inputs.files}
        text = json.dumps({"plan": inputs.plan, "files": rows}, indent=1, sort_keys=True).encode()
        digest = hashlib.sha256(text).hexdigest()
        there = self.sizes(f"{WORK}/files")
        for file in inputs.files:
            name = f"{WORK}/files/{file.sha256}"
            if there.get(name) != file.bytes:
                with _Told(self, name):
                    self.fs.put_file(str(file.path), self.path(name))
                there[name] = file.bytes
        self.write(f"{WORK}/inputs/{digest}.json", text)
        return digest

    def plan_on(self, cache: NodeCache, digest: str) -> Path:
        """Returns the path of the plan on this node; what it reads is fetched if it is not in the cache."""
        name = f"{WORK}/inputs/{digest}.json"
        listed = cache.file(digest, lambda to: self.fetch(name, to))
        rows = json.loads(listed.read_bytes())

        def file(sha256: str):
            return lambda: cache.file(sha256, lambda to: self.fetch(f"{WORK}/files/{sha256}", to))

        return cache.tree(digest, {name: file(sha256) for name, sha256 in rows["files"].items()}) / rows["plan"]


class _Told:
    """Turns what a store raises into an OSError with the name of the file: each store has exceptions of its own."""

    def __init__(self, store: SetStore, name: str) -> None:
        self.where = f"{store.url}/{name}"

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind, error, trace) -> bool:
        if error is None or not isinstance(error, Exception) or isinstance(error, (ClusterError, FileNotFoundError)):
            return False
        raise OSError(f"{self.where}: {' '.join(str(error).split()) or type(error).__name__}") from error


def marker_name(block: int) -> str:
    """Returns the name of a block's marker in its set."""
    return f"{DONE}/{block:06}.json"
