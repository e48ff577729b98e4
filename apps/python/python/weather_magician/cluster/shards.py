"""Cuts the blocks that are missing into shards: runs of blocks that a node makes one after the other."""

from __future__ import annotations

from typing import Callable, Iterator, Sequence

# Wall seconds that a shard is to take: long beside what starting it takes, short beside what is
# lost when a node dies.
WANTED = 90.0


class Pace:
    """Wall seconds that a frame takes on a slot, as far as shards have told."""

    def __init__(self) -> None:
        self.frames, self.seconds = 0, 0.0

    def tell(self, frames: int, seconds: float) -> None:
        """Counts a shard."""
        self.frames += frames
        self.seconds += seconds

    def frames_in(self, seconds: float) -> int | None:
        """Returns how many frames take so long; None if nothing is known yet."""
        return int(seconds * self.frames / self.seconds) if self.frames and self.seconds > 0 else None


def by_count(missing: Sequence[int], shards: Sequence[range]) -> Iterator[list[int]]:
    """The missing blocks of each shard; shards without any are left out."""
    wanted = set(missing)
    for shard in shards:
        if own := [block for block in shard if block in wanted]:
            yield own


def by_pace(
    missing: Sequence[int], about: Callable[[int], tuple[str, int]], pace: Pace, slots: Callable[[], int]
) -> Iterator[list[int]]:
    """Shards of some 90 s each, of one scene, decided as they are asked for.

    about(block): the scene and the number of frames of a block. The first shards have one block, until the pace is known; towards the end
    shards become shorter, so that all slots end together.
    """
    at = 0
    while at < len(missing):
        scene, frames = about(missing[at])
        most = pace.frames_in(WANTED)
        share = -(-(len(missing) - at) // (2 * max(slots(), 1)))
        shard = [missing[at]]
        while most is not None and len(shard) < share and at + len(shard) < len(missing):
            own, more = about(missing[at + len(shard)])
            if own != scene or frames + more > most:
                break
            frames += more
            shard.append(missing[at + len(shard)])
        yield shard
        at += len(shard)
