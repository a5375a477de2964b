"""The command line: what it prints, its exit codes, and one clear line for each bad input."""

from __future__ import annotations

import json
import re
import shutil
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from vtlib import __main__ as cli
from vtlib import bench, store
from vtlib.baselines import MellowTDSettings
from vtlib.domains import DOMAINS
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments import EXPERIMENTS, POOLS, Experiment, schedule, work
from vtlib.experiments import runs as runs_of
from vtlib.sources import Pool
from vtlib.training import Diverged
from vtlib.transfer import Settings

POOL = Pool(
    "tiny-pool",
    RoomsFamily(rooms=2),
    count=2,
    iterations=210,
    limit=210,
    episodes=2,
    settings=MellowTDSettings(epsilon_steps=100, batch=5),
)
TINY = Experiment(
    "tiny",
    POOL,
    RoomsFamily(rooms=2),
    {"NT": MellowTDSettings(epsilon_steps=100, batch=5), "GVT": Settings("gaussian", weights=2)},
    runs=2,
    sources=2,
    iterations=200,
    every=100,
)
RESULTS = ("tiny-pool/sources", "tiny/tasks", "tiny/NT", "tiny/GVT")


@contextmanager
def here(progress):
    """Work that is done in this process, one unit after the other."""
    with ThreadPoolExecutor(1) as executor:
        yield executor


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """One small experiment, computed in this process, with targets that need no planning."""
    monkeypatch.setitem(EXPERIMENTS, TINY.name, TINY)
    monkeypatch.setitem(POOLS, POOL.name, POOL)
    monkeypatch.setattr(cli, "processes", lambda jobs: here)
    planned = replace(DOMAINS[RoomsFamily], optimum=lambda tasks: torch.ones(len(tasks)))
    monkeypatch.setitem(DOMAINS, RoomsFamily, planned)


@pytest.fixture
def tiny(monkeypatch):
    install(monkeypatch)
    for name in EXPERIMENTS.keys() - {"tiny"}:
        monkeypatch.delitem(EXPERIMENTS, name)


@pytest.fixture(scope="module")
def computed(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("computed")
    with pytest.MonkeyPatch.context() as monkeypatch:
        install(monkeypatch)
        assert cli.main(["run", "tiny", "--results", str(root), "--jobs", "1"]) == 0
    return root


@pytest.fixture
def stored(tiny, computed, tmp_path) -> Path:
    return shutil.copytree(computed, tmp_path / "stored")


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """The one line with which a command ends that was refused."""
    capsys.readouterr()
    assert cli.main([str(x) for x in arguments]) == 2
    error = capsys.readouterr().err
    *bar, line = error.splitlines()
    assert all("left" in shown for shown in bar if shown), error
    assert line.startswith("vtlib: ")
    return line


def rewrite(root: Path, name: str, **change: np.ndarray) -> None:
    """Replace arrays of a stored result, as somebody would who changed it on purpose."""
    arrays, note = store.load(root / name)
    store.remove(root / name)
    store.save(root / name, {**arrays, **change}, note)


def test_run_stores_every_result_and_says_where(computed, tiny, tmp_path, capsys):
    assert {str(p.relative_to(computed).with_suffix("")) for p in computed.rglob("*.npz")} == set(
        RESULTS
    )
    before = {p: p.stat().st_mtime_ns for p in computed.rglob("*")}
    assert cli.main(["run", "tiny", "--results", str(computed)]) == 0
    assert capsys.readouterr().out == f"tiny is complete under {computed}\n"
    assert {p: p.stat().st_mtime_ns for p in computed.rglob("*")} == before


def test_verify_says_so_of_each_result(stored, capsys):
    for names in (["tiny"], [], ["tiny", "tiny"]):
        assert cli.main(["verify", *names, "--results", str(stored)]) == 0
        out = capsys.readouterr().out
        assert out == "".join(f"{name}: verified\n" for name in RESULTS)


@pytest.mark.parametrize("name", ["tiny/GVT", "tiny-pool/sources"])
def test_verify_names_what_differs(stored, capsys, name):
    prints = store.load(stored / name)[0]["fingerprints"].copy()
    prints[1, 0, 2] += 0.1
    rewrite(stored, name, fingerprints=prints)
    assert cli.main(["verify", "tiny", "--results", str(stored)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"{x}: {'differs in [1]' if x == name else 'verified'}" for x in RESULTS]


def test_verify_names_tasks_that_differ(stored, capsys):
    rewrite(stored, "tiny/tasks", sources=np.array([[0, 1], [1, 1]]))
    assert cli.main(["verify", "tiny", "--results", str(stored)]) == 1
    assert re.search(r"tiny/tasks: differs in \[(0, )?1\]", capsys.readouterr().out)


def test_verify_notices_another_optimum(stored):
    rewrite(stored, "tiny/tasks", optimum=np.full(2, 0.5, dtype=np.float32))
    assert cli.main(["verify", "tiny", "--results", str(stored)]) == 1


def test_reproduce_computes_anew_and_compares(stored, tmp_path, capsys):
    fresh = tmp_path / "fresh"
    store.remove(stored / "tiny/NT")
    arguments = ["reproduce", "--only", "tiny", "--fresh", fresh, "--results", stored]
    assert cli.main([str(x) for x in arguments]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1::2][0] == "  sources: identical"
    assert re.fullmatch(r"tiny: \d+ s of one core, \d+ MB at most in a process", lines[2])
    assert "  tasks: identical" in lines
    assert "  NT: nothing stored to compare with" in lines
    assert "  GVT: identical" in lines
    assert lines[-1].startswith("4 results compared, none differs")
    assert all(store.exists(fresh / name) for name in RESULTS)


def test_reproduce_names_what_differs(stored, tmp_path, capsys):
    rewrite(stored, "tiny/tasks", sources=np.array([[0, 1], [1, 1]]))
    arguments = ["reproduce", "--only", "tiny", "--fresh", tmp_path / "f", "--results", stored]
    assert cli.main([str(x) for x in arguments]) == 1
    out = capsys.readouterr().out
    assert "  tasks: other tasks, permutation test p = 0.0000: DIFFERENT" in out
    assert "1 DIFFER" in out


def test_reproduce_with_fewer_runs_compares_those(stored, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = ["reproduce", "--only", "tiny", "--runs", "1", "--results", stored]
    assert cli.main([str(x) for x in arguments]) == 0
    assert "4 results compared, none differs" in capsys.readouterr().out
    fresh = tmp_path / "_build" / "reproduced-1"
    assert len(store.load(fresh / "tiny/GVT")[0]["run"]) == 1


@pytest.mark.parametrize(
    "command", [["run", "romos"], ["verify", "romos"], ["reproduce", "--only", "romos"]]
)
def test_an_unknown_experiment_is_refused_before_any_work(tiny, tmp_path, capsys, command):
    line = refused(capsys, *command, "--results", tmp_path / "results")
    assert line == "vtlib: unknown experiment 'romos'; known are tiny"
    assert not any(tmp_path.iterdir())


def test_one_unknown_among_known_ones_is_refused_before_any_work(stored, capsys, monkeypatch):
    monkeypatch.setattr(cli, "check_heads", None)
    monkeypatch.setattr(cli, "reproduce", None)
    refused(capsys, "verify", "tiny", "romos", "--results", stored)
    refused(capsys, "reproduce", "--only", "tiny", "--only", "romos", "--results", stored)


@pytest.mark.parametrize("jobs", ["-3", "0", "2.5", "many", "", "²"])
@pytest.mark.parametrize("command", [["run", "tiny"], ["reproduce"]])
def test_jobs_must_be_a_positive_number(tiny, capsys, command, jobs):
    with pytest.raises(SystemExit) as ended:
        cli.main([*command, "--jobs", jobs])
    assert ended.value.code == 2
    *usage, line = capsys.readouterr().err.strip().splitlines()
    assert usage[0].startswith("usage: python -m vtlib")
    assert "argument --jobs: " in line
    assert line.endswith(jobs) or repr(jobs) in line


@pytest.mark.parametrize("arguments", [[], ["rune"], ["run"], ["verify", "--result"]])
def test_a_command_that_is_none_ends_with_its_usage(tiny, capsys, arguments):
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    assert ended.value.code == 2
    assert "error: " in capsys.readouterr().err.splitlines()[-1]


def test_help_names_the_commands_and_experiments(tiny, capsys):
    with pytest.raises(SystemExit) as ended:
        cli.main(["--help"])
    assert ended.value.code == 0
    out = capsys.readouterr().out
    assert all(command in out for command in ("run", "verify", "reproduce", "bench"))
    with pytest.raises(SystemExit):
        cli.main(["run", "--help"])
    assert "one of tiny" in capsys.readouterr().out


@pytest.mark.parametrize("missing", ["everything", "tiny-pool/sources", "tiny/NT"])
def test_verify_without_results(stored, capsys, missing):
    if missing == "everything":
        shutil.rmtree(stored)
    else:
        store.remove(stored / missing)
    line = refused(capsys, "verify", "tiny", "--results", stored)
    assert "no stored result at" in line
    assert missing in ("everything", *(x for x in RESULTS if str(stored / x) in line))


def tear(root: Path, name: str, how: str) -> None:
    npz, note = root / f"{name}.npz", root / f"{name}.json"
    if how == "npz cut":
        npz.write_bytes(npz.read_bytes()[:-10])
    elif how == "npz missing":
        npz.unlink()
    elif how == "json cut":
        note.write_bytes(note.read_bytes()[:-10])
    else:
        stored = json.loads(note.read_text())
        stored["config"]["runs" if "runs" in stored["config"] else "count"] += 1
        note.write_text(json.dumps(stored))


TEARS = ["npz cut", "npz missing", "json cut", "another configuration"]


@pytest.mark.parametrize("how", TEARS)
@pytest.mark.parametrize("name", ["tiny-pool/sources", "tiny/tasks", "tiny/GVT"])
def test_verify_refuses_a_torn_result(stored, capsys, name, how):
    tear(stored, name, how)
    assert str(stored / name) in refused(capsys, "verify", "tiny", "--results", stored)


@pytest.mark.parametrize("how", TEARS)
@pytest.mark.parametrize("name", ["tiny-pool/sources", "tiny/GVT"])
def test_run_does_not_call_a_torn_result_complete(stored, capsys, name, how):
    tear(stored, name, how)
    assert str(stored / name) in refused(capsys, "run", "tiny", "--results", stored)


def test_run_refuses_a_torn_pool_that_its_runs_need(stored, capsys):
    tear(stored, "tiny-pool/sources", "npz cut")
    store.remove(stored / "tiny/GVT")
    line = refused(capsys, "run", "tiny", "--results", stored)
    assert str(stored / "tiny-pool/sources") in line
    assert not store.exists(stored / "tiny/GVT")


def test_a_pool_that_is_not_finite_is_refused(stored, capsys):
    weights = store.load(stored / "tiny-pool/sources")[0]["weights"].copy()
    weights[0, 0] = np.nan
    rewrite(stored, "tiny-pool/sources", weights=weights)
    store.remove(stored / "tiny/GVT")
    line = refused(capsys, "run", "tiny", "--results", stored)
    assert line == "vtlib: weights of tiny-pool must be finite, got NaN or infinity"


def test_a_diverged_run_is_one_line(stored, capsys, monkeypatch):
    store.remove(stored / "tiny/NT")

    def diverge(*_):
        raise Diverged("run 1 of tiny, NT diverged: its weights are not finite at iteration 100")

    monkeypatch.setattr(runs_of, "run_batch", diverge)
    assert "run 1 of tiny, NT diverged" in refused(capsys, "run", "tiny", "--results", stored)


def test_results_that_are_no_folder_are_refused(tiny, capsys, tmp_path):
    (tmp_path / "results").write_text("")
    refused(capsys, "run", "tiny", "--results", tmp_path / "results")


def test_a_leftover_of_a_kill_does_not_stop_a_run(stored, capsys):
    store.remove(stored / "tiny/NT")
    litter = stored / work.PARTS / "tiny" / ".NT-000-001.npz.k1ll3d"
    litter.parent.mkdir(parents=True)
    litter.write_bytes(b"half")
    assert cli.main(["run", "tiny", "--results", str(stored)]) == 0
    assert cli.main(["verify", "tiny", "--results", str(stored)]) == 0


def test_a_finished_run_leaves_no_parts_even_after_a_kill(stored):
    litter = stored / work.PARTS / "tiny" / ".NT-000-001.npz.k1ll3d"
    litter.parent.mkdir(parents=True)
    litter.write_bytes(b"half")
    assert cli.main(["run", "tiny", "--results", str(stored)]) == 0
    assert not (stored / work.PARTS).exists()


def test_an_error_in_a_process_of_its_own_is_one_line_without_a_traceback(
    tmp_path, capfd, monkeypatch
):
    install(monkeypatch)
    monkeypatch.setattr(cli, "processes", schedule.processes)
    # an experiment whose runs diverge at once, in whatever process
    wild = replace(TINY, algorithms={"NT": replace(TINY.algorithms["NT"], alpha=1e38)})
    monkeypatch.setitem(EXPERIMENTS, "tiny", wild)
    assert cli.main(["run", "tiny", "--results", str(tmp_path), "--jobs", "1"]) == 2
    error = capfd.readouterr().err
    assert "vtlib: run 0 of tiny, NT diverged" in error.splitlines()[-1]
    assert "Traceback" not in error
    assert store.exists(tmp_path / "tiny-pool/sources")


def test_a_killed_process_is_one_line(tiny, capsys, tmp_path, monkeypatch):
    def broken(*_, **__):
        raise BrokenExecutor("a process died")

    monkeypatch.setattr(cli, "complete", broken)
    assert "a process was killed" in refused(capsys, "run", "tiny", "--results", tmp_path)


def test_jobs_and_a_scheduler_exclude_each_other(tiny, capsys):
    with pytest.raises(SystemExit) as ended:
        cli.main(["run", "tiny", "--jobs", "2", "--scheduler", "tcp://localhost:1"])
    assert ended.value.code == 2
    assert "not allowed with argument" in capsys.readouterr().err


@pytest.mark.parametrize("device", ["gpu", "cuda:", "cuda:-1", "cuda:²", "meta", ""])
def test_a_device_of_another_kind_is_named(tiny, capsys, device):
    with pytest.raises(SystemExit) as ended:
        cli.main(["run", "tiny", "--device", device])
    assert ended.value.code == 2
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert line.endswith(f"argument --device: must be cpu, cuda or cuda:N, got {device!r}")


@pytest.mark.parametrize("command", [["run", "tiny"], ["reproduce"]])
def test_a_device_that_is_not_there_is_refused_before_any_work(tiny, capsys, monkeypatch, command):
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    for function in ("complete", "reproduce"):
        monkeypatch.setattr(cli, function, None)
    line = refused(capsys, *command, "--device", "cuda:2")
    assert line == "vtlib: --device must be among the 2 of CUDA here, got cuda:2"


@pytest.mark.parametrize("command", [["run", "tiny", "--results"], ["reproduce", "--fresh"]])
def test_runs_that_transfer_are_computed_on_the_device(tiny, tmp_path, monkeypatch, command):
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: f"a card called {device}")
    given, run_batch = {}, runs_of.run_batch

    def spy(experiment, label, runs, pool, progress, device):
        given[label] = device
        return run_batch(experiment, label, runs, pool, progress)

    monkeypatch.setattr(runs_of, "run_batch", spy)
    cli.main([*command, str(tmp_path), "--device", "cuda:1"])
    assert given == {"NT": "cpu", "GVT": "cuda:1"}
    for name in RESULTS:
        device = store.provenance(tmp_path / name)["machine"].get("device")
        assert device == ("a card called cuda:1" if name == "tiny/GVT" else None)


def test_bench_prints_its_table(monkeypatch, capsys):
    monkeypatch.setattr(bench, "milliseconds", lambda batch: 1.0)
    monkeypatch.setattr(bench, "shares", lambda batch: dict.fromkeys(bench.PARTS, 0.25))
    monkeypatch.setattr(bench, "sgemm_rate", lambda: 1e9)
    assert cli.main(["bench"]) == 0
    assert "1-MGVT" in capsys.readouterr().out
