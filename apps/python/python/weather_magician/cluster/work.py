"""What nodes do with blocks: make them, move them, compare them."""

from __future__ import annotations

import os
import re
import shutil
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Callable

from .cache import NodeCache
from .runner import ClusterError
from .store import DONE, SetStore

# Numbers of errors of the system that another attempt meets again: no such file, no permission,
# exists, no folder, a folder.
LASTING = {2, 13, 17, 20, 21}


@dataclass(frozen=True)
class RemoteSet:
    """Where a node finds a set in a store: its URL, the list of what the plan reads, fsspec's options, the node's cache."""

    url: str
    inputs: str
    options: dict | None
    cache: str | None


@dataclass(frozen=True)
class BlockWork:
    """Makes blocks on a node. Called with a list of numbers of blocks; returns its node and its warnings."""

    plan: str
    out: str | None
    digest: str
    device: str
    threads: int
    batch: Callable
    remote: RemoteSet | None = None

    def __call__(self, blocks: list[int], report: Callable[[int], None]) -> dict:
        opened = _opened(self)
        done = 0
        for block in blocks:
            first, end = opened.batch.block(block)["frames"]
            # An earlier attempt at this shard may have made it.
            if not opened.is_done(block):
                try:
                    opened.batch.make(block, lambda frames, *of: report(done + min(frames, end - first)))
                except Exception as error:
                    raise _retried(error) from error
                opened.move(block)
            done += end - first
            report(done)
        return {"node": socket.gethostname(), "warnings": opened.batch.take_warnings()}


@dataclass(frozen=True)
class VerifyWork:
    """Compares the files of blocks in a store with their markers. Returns the names of up to 100 that differ."""

    url: str
    options: dict | None
    digest: str

    def __call__(self, blocks: list[int], report: Callable[[int], None]) -> list[str]:
        store, wrong = SetStore(self.url, self.options), []
        for number, block in enumerate(blocks):
            marker = store.marker(block, self.digest)
            for file in marker["files"] if marker else ():
                try:
                    is_right = store.sha256(file["path"]) == file["sha256"]
                except FileNotFoundError:
                    is_right = False
                if not is_right:
                    wrong.append(file["path"])
            report(number + 1)
        return wrong[:100]


class _Opened:
    """A plan that is open in a process: its scene stays in memory from one shard to the next."""

    def __init__(self, work: BlockWork) -> None:
        remote = work.remote
        plan, out = work.plan, work.out
        self.store = self.scratch = None
        self.digest = work.digest
        node = socket.gethostname()
        if remote:
            cache = NodeCache(remote.cache)
            self.store = SetStore(remote.url, remote.options)
            plan = str(self.store.plan_on(cache, remote.inputs))
            self.scratch = cache.scratch()
            out = str(self.scratch.path)
        elif not os.path.exists(plan):
            raise ClusterError(f"{plan}: is not on node {node}: put it into a folder that all nodes share, or give a store with --out")
        elif not os.path.isdir(os.path.join(out, DONE)):
            raise ClusterError(f"{out}: is not on node {node}: give a folder that all nodes share, or a store such as s3://bucket/set")
        self.out = Path(out)
        self.batch = work.batch(plan, out, device=work.device, threads=work.threads)
        if self.batch.digest != work.digest:
            raise ClusterError(f"{plan}: node {node} reads another plan than the driver: the same files and the same version must be there")

    def is_done(self, block: int) -> bool:
        if self.store:
            return self.store.marker(block, self.digest) is not None
        return self.batch.marker(block) is not None

    def move(self, block: int) -> None:
        if self.store:
            self.store.put_block(self.out, block)

    def close(self) -> None:
        if self.scratch:
            shutil.rmtree(self.scratch.path, ignore_errors=True)


# The plan that is open in this process, by what it was opened with.
_OPEN: dict[str, _Opened] = {}


def _opened(work: BlockWork) -> _Opened:
    key = repr(work)
    if key not in _OPEN:
        for opened in _OPEN.values():
            opened.close()
        _OPEN.clear()
        try:
            _OPEN[key] = _Opened(work)
        except (OSError, ClusterError):
            raise
        except Exception as error:
            raise _retried(error) from error
    return _OPEN[key]


def _retried(error: Exception) -> Exception:
    """Returns an error of the disk as an OSError, which is tried again; any other as it is."""
    number = re.search(r"\(os error (\d+)\)", str(error))
    if number and int(number[1]) not in LASTING:
        return OSError(str(error))
    return error
