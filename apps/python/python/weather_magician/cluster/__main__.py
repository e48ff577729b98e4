"""`python -m weather_magician.cluster`: makes the data set of a plan on a Ray cluster."""

from __future__ import annotations

import argparse
import re
import sys

UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}


def memory(text: str) -> int:
    """Returns bytes of `8GiB`, `8G` or `8000000000`."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?)(?:i?B)?", text.strip(), re.IGNORECASE)
    if not found:
        raise argparse.ArgumentTypeError(f"`{text}`: write bytes, or as 8GiB")
    return int(float(found[1]) * UNITS[found[2].upper()])


def above_zero(text: str) -> int:
    """Returns a number from 1 on."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"`{text}`: write a number from 1 on")
    return int(text)


def option(text: str) -> tuple[str, str]:
    """Returns the parts of KEY=VALUE."""
    key, sign, value = text.partition("=")
    if not key or not sign:
        raise argparse.ArgumentTypeError(f"`{text}`: write KEY=VALUE")
    return key, value


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = argparse.ArgumentParser(
        prog="python -m weather_magician.cluster",
        description="Make a data set by a plan on all nodes of a Ray cluster. Blocks that are done are kept; run it again to go on.",
    )
    made.add_argument("plan", help="the plan (TOML), as for `weather-magician batch`")
    made.add_argument("-o", "--out", metavar="FOLDER|URL", help="a folder that all nodes share [default: named after the plan], or a store: s3://bucket/set, gs://...")
    made.add_argument("--address", default="auto", help="auto (the cluster of this machine, else this machine alone), local, or HOST:PORT of a head [default: auto]")
    made.add_argument("--shards", type=above_zero, metavar="N", help="parts of the work [default: as many as take 90 s each]")
    made.add_argument("--cpus-per-shard", type=above_zero, metavar="N", help="CPUs and threads of a part [default: up to 4]")
    made.add_argument("--gpus-per-shard", type=float, metavar="N", help="GPUs of a part, also 0.5 [default: 1 with --device gpu, else 0]")
    made.add_argument("--memory", type=memory, metavar="BYTES", help="memory that a part holds, such as 8GiB [default: not counted]")
    made.add_argument("--device", default="cpu", help="device that renders: cpu, gpu, or gpu:NAME [default: cpu]")
    made.add_argument("--retries", type=int, default=5, metavar="N", help="how often a part is begun again whose process, node or disk failed [default: 5]")
    made.add_argument("--cache", metavar="FOLDER", help="with a store: folder on each node for scenes and for blocks that are being made [default: in TMPDIR]")
    made.add_argument("--store-option", type=option, action="append", default=[], metavar="KEY=VALUE", help="an argument of fsspec's file system, such as endpoint_url=http://...; several times")
    end = made.add_mutually_exclusive_group()
    end.add_argument("--verify", action="store_true", help="compare the hashes of all files at the end")
    end.add_argument("--no-merge", action="store_true", help="write no tables, manifest and summary")
    return made


def main(arguments: list[str] | None = None) -> int:
    """Runs the command; returns the exit status."""
    args = parser().parse_args(arguments)
    try:
        # After the options, so that --help needs no Ray.
        from .plans import run_plan
        from .runner import ClusterError, line_of
    except ImportError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    try:
        report = run_plan(
            args.plan,
            args.out,
            address=args.address,
            shards=args.shards,
            cpus=args.cpus_per_shard,
            gpus=args.gpus_per_shard,
            memory=args.memory,
            device=args.device,
            retries=args.retries,
            verify=args.verify,
            merge=not args.no_merge,
            cache=args.cache,
            storage_options=dict(args.store_option),
        )
    except KeyboardInterrupt:
        print("stopped: whole blocks are kept; run it again to go on", file=sys.stderr)
        return 130
    except Exception as error:
        if not isinstance(error, (ClusterError, OSError)) and type(error).__module__.partition(".")[0] not in ("weather_magician", "ray"):
            raise
        print(f"error: {line_of(error)}", file=sys.stderr)
        return 1
    for warning in report.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    for failure in report.failures:
        print(f"failed: {failure.task} on {failure.node}: {failure.line}", file=sys.stderr)
    outcome = report.outcome
    if report.made:
        share = 100.0 * outcome.work_seconds / (outcome.seconds * max(outcome.slots, 1))
        print(
            f"{report.out}: {report.made} of {report.blocks} blocks made, {report.kept} kept, {report.frames} frames, {outcome.seconds:.1f} s, "
            f"{report.frames / outcome.seconds:.2f} frames/s, {outcome.slots} at a time, working {share:.0f} % of the time, {outcome.retries} retries"
        )
    else:
        print(f"{report.out}: {report.kept} of {report.blocks} blocks done already")
    if report.failures:
        rest = ", and the rest was not begun" if outcome.not_begun else ""
        print(f"error: {len(report.failures)} shards failed{rest}; run it again to go on", file=sys.stderr)
        return 1
    if report.merged:
        merged = report.merged
        print(f"{report.out}: {merged['clips']} clips, {merged['frames']} frames, {merged['readings']} readings, {merged['bytes'] / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
