"""Command line: python -m vtlib run | verify | reproduce | bench."""

from __future__ import annotations

import argparse
import os
import re
import sys
from concurrent.futures import BrokenExecutor
from pathlib import Path

import torch

from vtlib import bench, store
from vtlib.checks import one_line
from vtlib.experiments import EXPERIMENTS, named
from vtlib.experiments.reproduce import differing, first_runs, report, reproduce
from vtlib.experiments.schedule import Workers, cluster, complete, processes
from vtlib.experiments.verify import check_heads, results_of
from vtlib.training import Diverged


def main(arguments: list[str] | None = None) -> int:
    """Run one command; errors of the user's making are one line and exit code 2."""
    options = _parser().parse_args(arguments)
    torch.set_num_threads(1)
    try:
        return int(options.command(options))
    except (ValueError, OSError, store.TornResult, Diverged) as error:
        print(f"vtlib: {one_line(error)}", file=sys.stderr)
        return 2
    except BrokenExecutor:
        print("vtlib: a process was killed; the same command goes on from here", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("vtlib: interrupted; the same command goes on from here", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m vtlib", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="command")
    run = commands.add_parser("run", help="compute what an experiment still lacks, and store it")
    run.add_argument("experiment", help=f"one of {', '.join(EXPERIMENTS)}")
    run.set_defaults(command=_run)
    verify = commands.add_parser("verify", help="recompute the head of every stored run")
    verify.add_argument("experiment", nargs="*", help="all when none is named")
    verify.set_defaults(command=_verify)
    again = commands.add_parser("reproduce", help="compute everything anew and compare")
    again.add_argument("--only", action="append", metavar="EXPERIMENT", help="may be repeated")
    again.add_argument("--runs", type=_positive, help="only the first so many of each experiment")
    again.add_argument(
        "--fresh",
        type=Path,
        help="where to compute it: _build/reproduced, or _build/reproduced-N with --runs N",
    )
    again.set_defaults(command=_reproduce)
    for command in (run, verify, again):
        command.add_argument("--results", type=Path, default=store.results_folder())
    for command in (run, again):
        where = command.add_mutually_exclusive_group()
        where.add_argument("--jobs", type=_positive, help="processes; one per core if not given")
        where.add_argument(
            "--scheduler", metavar="ADDRESS", help="of a Dask cluster to use instead"
        )
        command.add_argument(
            "--device",
            type=_device,
            default="cpu",
            help="where posteriors and their networks are kept: cpu, or cuda",
        )
    speed = commands.add_parser("bench", help="milliseconds per run and iteration on one core")
    speed.set_defaults(command=lambda options: bench.main())
    return parser


def _positive(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, got {text!r}")
    return int(text)


def _device(text: str) -> str:
    if not re.fullmatch("cpu|cuda(:[0-9]{1,3})?", text):
        raise argparse.ArgumentTypeError(f"must be cpu, cuda or cuda:N, got {text!r}")
    return text


def _workers(options: argparse.Namespace) -> Workers:
    if options.scheduler:
        return cluster(options.scheduler)
    count, device = torch.cuda.device_count(), torch.device(options.device)
    if device.type == "cuda" and (device.index or 0) >= count:
        raise ValueError(f"--device must be among the {count} of CUDA here, got {options.device}")
    return processes(options.jobs or os.cpu_count() or 1)


def _run(options: argparse.Namespace) -> int:
    experiments = [named(options.experiment)]
    complete(experiments, options.results, _workers(options), device=options.device)
    print(f"{options.experiment} is complete under {options.results}")
    return 0


def _verify(options: argparse.Namespace) -> int:
    names = options.experiment or list(EXPERIMENTS)
    bad = 0
    for owner, label in dict.fromkeys(pair for name in names for pair in results_of(name)):
        wrong, parted = check_heads(owner, label, options.results)
        bad += len(wrong)
        outcome = f"differs in {wrong}" if wrong else "verified"
        if parted:
            outcome += f", {parted} until rounding parted them"
        print(f"{owner}/{label}: {outcome}", flush=True)
    return 1 if bad else 0


def _reproduce(options: argparse.Namespace) -> int:
    experiments = [named(name) for name in dict.fromkeys(options.only or EXPERIMENTS)]
    fresh = options.fresh or Path("_build/reproduced")
    if options.runs:
        experiments = [first_runs(e, options.runs) for e in experiments]
        fresh = options.fresh or Path(f"_build/reproduced-{options.runs}")
    workers = _workers(options)
    comparisons = reproduce(experiments, options.results, fresh, workers, options.device)
    for line in report(comparisons):
        print(line)
    return 1 if differing(comparisons) else 0


if __name__ == "__main__":
    sys.exit(main())
