"""Progress over all nodes: one line that is written over on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from typing import TextIO

# Seconds between two lines where no terminal is.
PLAIN = 10.0


@dataclass(frozen=True)
class Standing:
    """Where the work stands: steps done and in all (None: unknown), tasks that ended well, nodes, retries, failures."""

    done: int
    steps: int | None
    tasks: int
    nodes: int
    retries: int
    failures: int


class Progress:
    """Writes where the work stands.

    unit: what a step is. parts: what a task is. out: where lines go (default: standard error). clock: seconds, for tests.
    """

    def __init__(self, unit: str = "steps", parts: str = "tasks", out: TextIO | None = None, clock=time.monotonic) -> None:
        self.unit, self.parts, self.clock = unit, parts, clock
        self.out = out or sys.stderr
        self.is_terminal = self.out.isatty()
        self.first: tuple[float, int] | None = None
        self.shown = -PLAIN
        self.last = ""
        self.width = 0

    def line(self, standing: Standing) -> str:
        """Returns a standing in words."""
        now = self.clock()
        if self.first is None and standing.done > 0:
            # Before the first step nodes start and scenes are read: that says nothing of the pace.
            self.first = (now, standing.done)
        of = f"/{standing.steps}" if standing.steps is not None else ""
        words = [f"{standing.done}{of} {self.unit}"]
        if self.first and now > self.first[0] and standing.done > self.first[1]:
            rate = (standing.done - self.first[1]) / (now - self.first[0])
            words.append(f"{rate:.2f}/s" if rate < 10 else f"{rate:.0f}/s")
            if standing.steps is not None:
                words.append(f"{_span((standing.steps - standing.done) / rate)} left")
        words.append(f"{standing.tasks} {self.parts}")
        words.append(_count(standing.nodes, "node"))
        if standing.retries:
            words.append(_count(standing.retries, "retry", "retries"))
        if standing.failures:
            words.append(f"{standing.failures} failed")
        return ", ".join(words)

    def show(self, standing: Standing) -> None:
        """Writes a standing, where no terminal is at most every 10 s."""
        line = self.line(standing)
        if self.is_terminal:
            self.out.write("\r" + line.ljust(self.width))
            self.out.flush()
            self.width = len(line)
        elif self.clock() - self.shown >= PLAIN:
            self._plain(line)
        self.last = line

    def say(self, text: str) -> None:
        """Writes a line of its own."""
        if self.is_terminal:
            text = text.ljust(self.width)
            self.out.write("\r")
            self.width = 0
        self.out.write(text.rstrip() + "\n")
        self.out.flush()

    def end(self) -> None:
        """Ends the line."""
        if self.is_terminal and self.width:
            self.out.write("\n")
            self.out.flush()
        elif self.last and not self.is_terminal:
            self._plain(self.last)
        self.first, self.width, self.last = None, 0, ""

    def _plain(self, line: str) -> None:
        self.shown = self.clock()
        self.out.write(line + "\n")
        self.out.flush()


def _count(number: int, one: str, many: str | None = None) -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _span(seconds: float) -> str:
    seconds = int(seconds + 0.5)
    hours, minutes = seconds // 3600, seconds // 60 % 60
    if hours:
        return f"{hours} h {minutes:02} min"
    return f"{minutes} min {seconds % 60:02} s" if minutes else f"{seconds} s"
