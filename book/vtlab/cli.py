"""Command line: python -m vtlab run | verify | reproduce, and what packages add."""

import argparse
import re
import secrets
import sys
from collections.abc import Callable, Iterable
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
import torch
from distributed import KilledWorker

from vtlab import store
from vtlab.experiment import Experiment
from vtlab.heads import verify_heads
from vtlab.registry import checks, installed, known, named
from vtlab.reproduce import differing, report, reproduce
from vtlab.schedule import complete
from vtlab.whole import Whole, verify
from vtlib import __version__
from vtlib.checks import one_line
from vtlib.files import TornResult
from vtlib.training import Diverged


def main(arguments: list[str] | None = None) -> int:
    """Run one command; errors of the user's making are one line and exit code 2."""
    options = _parser().parse_args(arguments)
    torch.set_num_threads(1)
    try:
        return int(options.command(options))
    except (ValueError, OSError, TornResult, Diverged) as error:
        print(f"vtlab: {one_line(error)}", file=sys.stderr)
    except KilledWorker:
        print("vtlab: workers were killed; the same command goes on from here", file=sys.stderr)
    return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m vtlab", description=__doc__)
    parser.add_argument("--version", action="version", version=f"vtlab {__version__}")
    commands = parser.add_subparsers(required=True, metavar="command")
    count = _like("[1-9][0-9]*", "a whole number of at least 1", int)
    names = ", ".join([*installed(), *known()])
    run = commands.add_parser("run", help="compute what an experiment still lacks, and store it")
    run.add_argument("experiment", help=f"one of {names}")
    told = "recompute one whole run of every stored result, drawn at random"
    ours = f"Experiments: {names}; and {', '.join(checks())}"
    verify = commands.add_parser("verify", help=told, epilog=ours)
    verify.add_argument("experiment", nargs="*", help="all when none is named")
    how = verify.add_mutually_exclusive_group()
    how.add_argument("--whole", action="store_true", help="all runs, whole")
    how.add_argument("--heads", action="store_true", help="the first iterations of all runs")
    told = "draw the runs that this number drew before"
    seed = _like("[0-9]+", "a whole number of at least 0", int)
    how.add_argument("--seed", type=seed, help=told)
    again = commands.add_parser("reproduce", help="compute everything anew and compare")
    again.add_argument("--only", action="append", metavar="EXPERIMENT", help="may be repeated")
    told = "only the first so many of each experiment"
    again.add_argument("--runs", type=count, help=told)
    told = "where to compute it: _build/reproduced, or _build/reproduced-N with --runs N"
    again.add_argument("--fresh", type=Path, help=told)
    for command, work in ((run, _run), (verify, _verify), (again, _reproduce)):
        command.set_defaults(command=work)
    for one in entry_points(group="vtlab.commands"):
        more = commands.add_parser(one.name, help=f"from {one.module}")
        more.set_defaults(command=lambda _, one=one: one.load()())
    for command in (run, verify, again):
        command.add_argument("--results", type=Path, default=store.results_folder())
    for command in (run, again):
        where = command.add_mutually_exclusive_group()
        told = "processes; one per core if not given"
        where.add_argument("--jobs", type=count, help=told)
        told, address = "of a Dask cluster to use instead", "an address such as tcp://host:8786"
        scheduler = _like("(tcp|tls|inproc)://[^ ]+", address)
        where.add_argument("--scheduler", metavar="ADDRESS", type=scheduler, help=told)
        told = "where posteriors and their networks are kept: cpu, or cuda"
        device = _like("cpu|cuda(:[0-9]{1,3})?", "cpu, cuda or cuda:N")
        command.add_argument("--device", type=device, default="cpu", help=told)
    return parser


def _like(pattern: str, told: str, kind: type = str) -> Callable[[str], Any]:
    def matching(text: str) -> Any:
        if not re.fullmatch(pattern, text):
            raise argparse.ArgumentTypeError(f"must be {told}, got {text!r}")
        return kind(text)

    return matching


def _workers(options: argparse.Namespace) -> dict[str, Any]:
    count, device = torch.cuda.device_count(), torch.device(options.device)
    if not options.scheduler and device.type == "cuda" and (device.index or 0) >= count:
        raise ValueError(f"--device: torch finds {count} CUDA cards here, got {options.device}")
    return {name: getattr(options, name) for name in ("jobs", "scheduler", "device")}


def _run(options: argparse.Namespace) -> int:
    complete(named(options.experiment), options.results, **_workers(options))
    print(f"{options.experiment} is complete under {options.results}")
    return 0


def _chosen(names: Iterable[str]) -> list[Experiment]:
    """The experiments that names stand for, each once."""
    return list({e.name: e for name in names for e in named(name)}.values())


def _verify(options: argparse.Namespace) -> int:
    usual = [*known(), *(() if options.heads else checks())]
    names, root = options.experiment or usual, options.results
    if options.heads and (whole := [name for name in names if name in checks()]):
        raise ValueError(f"--heads must not be asked of {', '.join(whole)}, which has none")
    experiments = _chosen(name for name in names if name not in checks())
    store.check_readable(root)
    rng = None if options.whole or options.heads else _drawing(options)
    computed, bad = verify_heads if options.heads else partial(verify, rng=rng), 0
    for owner, label, found in computed(*experiments, root=root):
        said = _told_of_heads(found) if options.heads else _told(found)
        print(f"{owner.name}/{label}: {said}", flush=True)
        bad += len(found.wrong)
    bad += sum(checks()[name](root, rng) for name in names if name in checks())
    return 1 if bad else 0


def _drawing(options: argparse.Namespace) -> np.random.Generator:
    """What draws a run of each result, and is printed so that it can draw them again."""
    seed = secrets.randbits(32) if options.seed is None else options.seed
    print(f"one run of each result, drawn with --seed {seed}", flush=True)
    return np.random.default_rng(seed)


def _told(found: Whole) -> str:
    said = [f"{found.alike} verified whole"] if found.alike else []
    said += [f"{m} verified until rounding parts it at {t:,}" for m, t in found.parted.items()]
    said += [f"{m} DIFFERS: {what}" for m, what in found.wrong.items()]
    return ", ".join(said)


def _told_of_heads(found: Whole) -> str:
    said = f"differs in {sorted(found.wrong)}" if found.wrong else "heads verified"
    return said + (f", {list(found.parted)} until rounding parted them" if found.parted else "")


def _reproduce(options: argparse.Namespace) -> int:
    experiments = _chosen(options.only or known())
    store.check_readable(options.results)
    beside = f"reproduced-{options.runs}" if options.runs else "reproduced"
    fresh = options.fresh or Path("_build", beside)
    comparisons = reproduce(experiments, options.results, fresh, options.runs, **_workers(options))
    for line in report(comparisons):
        print(line)
    return 1 if differing(comparisons) else 0
