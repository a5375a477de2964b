"""Command line: python -m vtlab run | verify | reproduce, and what packages add."""

import argparse
import re
import sys
from collections.abc import Iterable
from concurrent.futures import BrokenExecutor
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np

from vtlab import store
from vtlab.experiment import Experiment, Pool
from vtlab.registry import catalogue, checks, installed, named
from vtlab.reproduce import reproduce
from vtlab.schedule import complete
from vtlab.verify import Verdict, verify
from vtlab.workers import processes
from vtlib.checks import one_line
from vtlib.files import TornResult
from vtlib.training import Diverged


def main(arguments: list[str] | None = None) -> int:
    """Run one command; errors of the user's making are one line and exit code 2."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.command(options))
    except TornResult as error:
        print(f"vtlab: {one_line(error)}; remove it, and run computes it again", file=sys.stderr)
    except OSError as error:
        then = "; once that is mended the same command goes on" if error.errno else ""
        print(f"vtlab: {one_line(error)}{then}", file=sys.stderr)
    except (ValueError, Diverged) as error:
        print(f"vtlab: {one_line(error)}", file=sys.stderr)
    except BrokenExecutor:
        print("vtlab: workers were killed; the same command goes on from here", file=sys.stderr)
    except KeyboardInterrupt:
        print("vtlab: interrupted; run and reproduce go on from here", file=sys.stderr)
        return 130
    return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m vtlab", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="command")
    names = ", ".join([*installed(), *catalogue()])
    run = commands.add_parser("run", help="compute what an experiment still lacks, and store it")
    run.add_argument("experiment", help=f"one of {names}")
    help = "recompute the first iterations of every run, and one whole run of each result"
    epilog = f"Experiments: {names}; and {', '.join(checks())}"
    verify = commands.add_parser("verify", help=help, epilog=epilog)
    verify.add_argument("experiment", nargs="*", help="all when none is named")
    extent = verify.add_mutually_exclusive_group()
    extent.add_argument("--whole", action="store_true", help="all runs, whole")
    extent.add_argument("--quick", action="store_true", help="the first iterations alone")
    reproduce = commands.add_parser("reproduce", help="compute everything anew and compare")
    reproduce.add_argument("--only", action="append", metavar="EXPERIMENT", help="may be repeated")
    reproduce.add_argument("--runs", type=_count, help="only the first so many of each experiment")
    for command, work in ((run, _run), (verify, _verify), (reproduce, _reproduce)):
        command.set_defaults(command=work)
        command.add_argument("--results", type=Path, default=store.results_folder())
    for entry in entry_points(group="vtlab.commands"):
        command = commands.add_parser(entry.name, help=f"from {entry.module}")
        command.set_defaults(command=lambda _, entry=entry: entry.load()())
    for command in (run, reproduce):
        command.add_argument("--jobs", type=_count, help="processes, by default one per core")
    return parser


def _count(text: str) -> int:
    if not re.fullmatch("[1-9][0-9]*", text):
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, got {text!r}")
    return int(text)


def _run(options: argparse.Namespace) -> int:
    experiments = named(options.experiment)
    with processes(options.jobs) as executor:
        complete(experiments, options.results, executor)
    print(f"{options.experiment} is complete under {options.results}")
    return 0


def _experiments(names: Iterable[str]) -> list[Experiment]:
    """The experiments that names stand for, each once."""
    return list({e.name: e for name in names for e in named(name)}.values())


def _verify(options: argparse.Namespace) -> int:
    usual = [*catalogue(), *(() if options.quick else checks())]
    names, root = options.experiment or usual, options.results
    if options.quick and (whole := [name for name in names if name in checks()]):
        only = ", ".join(whole)
        raise ValueError(f"--quick recomputes the first iterations; {only} is recomputed whole")
    experiments = _experiments(name for name in names if name not in checks())
    store.check_readable(root)
    rng = None if options.whole else np.random.default_rng()
    bad = _differing(verify(*experiments, root=root, rng=rng, quick=options.quick))
    bad += sum(checks()[name](root, rng) for name in names if name in checks())
    return 1 if bad else 0


def _reproduce(options: argparse.Namespace) -> int:
    experiments = _experiments(options.only or catalogue())
    store.check_readable(options.results)
    fresh = Path("_build", f"reproduced-{options.runs}" if options.runs else "reproduced")
    with processes(options.jobs) as executor:
        bad = _differing(reproduce(experiments, options.results, fresh, options.runs, executor))
    print(f"{bad} of the results differ")
    return 1 if bad else 0


def _differing(verdicts: Iterable[tuple[Pool | Experiment, str, Verdict]]) -> int:
    """Print each verdict as soon as it is there; how many results are not the same."""
    bad = 0
    for owner, label, verdict in verdicts:
        print(f"{owner.name}/{label}: {verdict.said}", flush=True)
        bad += not verdict.same
    return bad
