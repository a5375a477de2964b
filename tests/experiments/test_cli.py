"""The command line: what it prints, its exit codes, and one clear line for each bad input."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from attrs import evolve
from distributed import KilledWorker
from hypothesis import given, settings
from hypothesis import strategies as st

from vtbook.experiments import EXPERIMENTS, THESIS
from vtlib import __version__, bench, cli
from vtlib.experiments import run, schedule, store
from vtlib.experiments.ledger import recorded

RESULTS = ("tiny-pool/sources", "tiny/tasks", "tiny/NT", "tiny/GVT")


@pytest.fixture(scope="module", autouse=True)
def small(tiny, here):
    """Two of the tiny algorithms are all that is known, and a worker in this process computes."""
    some = evolve(tiny, algorithms={label: tiny.algorithms[label] for label in ("NT", "GVT")})
    cluster = schedule._cluster
    with pytest.MonkeyPatch.context() as monkeypatch:
        for name in list(EXPERIMENTS):
            monkeypatch.delitem(EXPERIMENTS, name)
        monkeypatch.setitem(EXPERIMENTS, "tiny", some)
        monkeypatch.setattr(schedule, "_cluster", lambda jobs, _, bar: cluster(jobs, here, bar))
        yield some


def main(*arguments: object) -> int:
    return cli.main([str(x) for x in arguments])


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line with which a command ends that was refused."""
    capsys.readouterr()
    assert main(*arguments) == 2
    error = capsys.readouterr().err
    *bar, line = error.splitlines()
    assert all("left" in shown for shown in bar if shown), error
    assert line.startswith("vtlib: ")
    return line


def rewrite(path: Path, **changes: np.ndarray) -> None:
    """Store a result with other arrays, as somebody would who knows its digest."""
    arrays, note = store.read(path)
    store.remove(path)
    store.save(path, {**arrays, **changes}, note)


def test_run_says_where_the_results_are_and_touches_what_is_complete(stored, capsys):
    before = {p: p.stat().st_mtime_ns for p in stored.rglob("*")}
    assert main("run", "tiny", "--results", stored) == 0
    assert capsys.readouterr().out == f"tiny is complete under {stored}\n"
    assert {p: p.stat().st_mtime_ns for p in stored.rglob("*")} == before


def test_verify_names_what_differs(stored, capsys):
    for names in (["tiny", "tiny"], []):
        assert main("verify", *names, "--whole", "--results", stored) == 0
        said = "[0, 1, 2] verified whole"
        assert capsys.readouterr().out == "".join(f"{name}: {said}\n" for name in RESULTS)
    prints = store.read(stored / "tiny/GVT")[0]["fingerprints"]
    prints[1, 0, 2] += 0.1
    rewrite(stored / "tiny/GVT", fingerprints=prints)
    assert main("verify", "tiny", "--heads", "--results", stored) == 1
    lines = capsys.readouterr().out.splitlines()
    said = {name: "differs in [1]" if "GVT" in name else "heads verified" for name in RESULTS}
    assert lines == [f"{x}: {said[x]}" for x in RESULTS]
    assert main("verify", "tiny", "--whole", "--results", stored) == 1
    line = next(x for x in capsys.readouterr().out.splitlines() if "tiny/GVT" in x)
    assert re.fullmatch(
        r"tiny/GVT: \[0, 2\] verified whole, "
        r"1 DIFFERS: fingerprints at iteration 1 is [-.\d]+, anew [-.\d]+",
        line,
    )


def test_verify_draws_a_run_of_each_result_and_can_draw_it_again(small, stored, capsys):
    assert main("verify", "tiny", "--record", "--results", stored) == 0
    first, *lines = capsys.readouterr().out.splitlines()
    seed = re.fullmatch(r"one run of each result, drawn with --seed (\d+)", first)[1]
    assert main("verify", "tiny", "--results", stored, "--seed", seed) == 0
    assert capsys.readouterr().out.splitlines() == [first, *lines]
    drawn = {
        line.rsplit(": ", 1)[0]: re.search(r"\[(\d)\] verified whole", line)[1] for line in lines
    }
    assert {x["result"]: x["member"] for x in recorded(store.results_of(small), stored)} == drawn


def test_reproduce_computes_anew_and_names_what_differs(stored, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = ["reproduce", "--only", "tiny", "--results", stored]
    assert main(*arguments, "--fresh", tmp_path / "fresh") == 0
    lines = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"tiny: \d+ s of one core, \d+ MB at most in a process", lines[2])
    assert lines.count("  sources: identical") == lines.count("  GVT: identical") == 1
    assert lines[-1].startswith("4 results compared, none differs")
    chosen = store.read(stored / "tiny/tasks")[0]["sources"]
    rewrite(stored / "tiny/tasks", sources=chosen[:, ::-1])
    assert main(*arguments, "--runs", 1) == 1
    out = capsys.readouterr().out
    assert "  tasks: DIFFERENT: 1 of 1 differ, number 0 first: sources is " in out
    assert "1 DIFFER" in out
    fresh = tmp_path / "_build" / "reproduced-1"
    assert len(store.read(fresh / "tiny/GVT")[0]["run"]) == 1


def test_reproduce_knows_the_thesis_own_figures(stored, tmp_path, capsys, monkeypatch):
    assert {"rooms-evaluation", "cartpole-equations", "mountain-car", "maze-8"} <= set(THESIS)
    assert "rooms-ingredients" not in THESIS
    monkeypatch.setattr(cli, "THESIS", ["tiny"])
    arguments = ["reproduce", "--only", "thesis", "--only", "tiny", "--results", stored]
    assert main(*arguments, "--fresh", tmp_path / "fresh") == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("4 results compared, none differs")


COMMANDS = (["run"], ["verify"], ["reproduce", "--only"])


@settings(deadline=None, derandomize=True, max_examples=25)
@given(st.text(max_size=20).filter(lambda text: text != "tiny" and not text.startswith("-")))
@pytest.mark.parametrize("command", COMMANDS)
def test_an_unknown_experiment_is_refused_before_any_work(command, name):
    with pytest.MonkeyPatch.context() as monkeypatch:
        lines = []
        monkeypatch.setattr("builtins.print", lambda line, **_: lines.append(line))
        assert main(*command, name) == 2
    assert lines == [f"vtlib: unknown experiment {name!r}; known are tiny"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "required"),
        (["rune"], "invalid choice"),
        (["run"], "required"),
        (["verify", "--result"], "expected one argument"),
        (["run", "tiny", "--jobs", "2", "--scheduler", "tcp://localhost:1"], "not allowed with"),
        *(
            (["run", "tiny", f"--jobs={jobs}"], f"a whole number of at least 1, got {jobs!r}")
            for jobs in ("-3", "0", "2.5", "", "²")
        ),
        (["reproduce", "--runs", "0"], "must be a whole number of at least 1, got '0'"),
        *(
            (["run", "tiny", "--device", device], f"must be cpu, cuda or cuda:N, got {device!r}")
            for device in ("gpu", "cuda:", "cuda:-1", "cuda:²", "meta", "")
        ),
    ],
)
def test_arguments_that_are_none_end_with_the_usage(capsys, arguments, said):
    with pytest.raises(SystemExit) as ended:
        main(*arguments)
    assert ended.value.code == 2
    *usage, line = capsys.readouterr().err.strip().splitlines()
    assert usage[0].startswith("usage: python -m vtlib")
    assert said in line


def test_help_names_the_commands_and_experiments(capsys):
    for arguments, words in (((), ("run", "verify", "reproduce", "bench")), (("run",), ("tiny",))):
        with pytest.raises(SystemExit) as ended:
            main(*arguments, "--help")
        assert ended.value.code == 0
        out = capsys.readouterr().out
        assert all(word in out for word in words)


def test_verify_names_a_result_that_is_not_there(stored, capsys):
    store.remove(stored / "tiny/tasks")
    line = refused(capsys, "verify", "tiny", "--results", stored)
    assert line == f"vtlib: no stored result at {stored / 'tiny/tasks'}"


def tear(root: Path, name: str, how: str) -> None:
    npz, note = root / f"{name}.npz", root / f"{name}.json"
    if how == "npz cut":
        npz.write_bytes(npz.read_bytes()[:-10])
    elif how == "npz missing":
        npz.unlink()
    elif how == "json cut":
        note.write_bytes(note.read_bytes()[:-10])
    elif how == "nested deeply":
        note.write_text(
            note.read_text().replace('"config": {', f'"config": {"[" * 900}{"]" * 900}, "c": {{')
        )
    else:
        stored = json.loads(note.read_text())
        stored["config"]["runs" if "runs" in stored["config"] else "count"] += 1
        note.write_text(json.dumps(stored))


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("tiny-pool/sources", "npz cut"),
        ("tiny/tasks", "npz missing"),
        ("tiny/GVT", "json cut"),
        ("tiny/NT", "nested deeply"),
        ("tiny-pool/sources", "another configuration"),
        ("tiny/tasks", "another configuration"),
        ("tiny/GVT", "another configuration"),
    ],
)
def test_a_torn_result_is_refused_and_left_as_it_is(stored, capsys, name, how):
    tear(stored, name, how)
    before = {p: p.read_bytes() for p in stored.rglob("*.*")}
    for command in (
        ("verify", "--results"),
        ("run", "tiny", "--results"),
        ("reproduce", "--fresh"),
    ):
        assert str(stored / name) in refused(capsys, *command, stored)
    assert {p: p.read_bytes() for p in stored.rglob("*.*")} == before


def test_a_run_that_diverges_is_one_line_without_a_traceback(small, stored, capfd, monkeypatch):
    wild = evolve(small, algorithms={"NT": evolve(small.algorithms["NT"], alpha=1e38)})
    monkeypatch.setitem(EXPERIMENTS, "tiny", wild)
    store.remove(stored / "tiny/NT")
    assert main("run", "tiny", "--results", stored) == 2
    error = capfd.readouterr().err
    assert re.search("vtlib: run [0-2] of tiny, NT diverged", error.splitlines()[-1])
    assert "Traceback" not in error


def test_results_that_are_no_folder_are_refused(capsys, tmp_path):
    (tmp_path / "results").write_text("mine")
    for command in (("run", "tiny", "--results"), ("reproduce", "--only", "tiny", "--fresh")):
        refused(capsys, *command, tmp_path / "results")
    assert (tmp_path / "results").read_text() == "mine"


@pytest.mark.parametrize("command", [["verify"], ["reproduce"], ["verify", "tiny", "--heads"]])
def test_results_to_compare_with_that_are_not_there_are_named_at_once(capsys, tmp_path, command):
    line = refused(capsys, *command, "--results", tmp_path / "mistyped")
    assert line == (
        f"vtlib: there is no folder {tmp_path / 'mistyped'}: "
        "the book's results are book/results of its repository"
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", [["run", "tiny", "--results"], ["reproduce", "--fresh"]])
def test_a_folder_that_is_read_only_or_full_is_named_at_once(
    capsys, tmp_path, stored, monkeypatch, command
):
    monkeypatch.setattr(schedule, "compute", None)
    beside = () if command[0] == "run" else ("--results", stored)

    def read_only(**_):
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(store.tempfile, "TemporaryFile", read_only)
        line = refused(capsys, *command, tmp_path / "new", *beside)
    assert line == f"vtlib: results cannot be written to {tmp_path / 'new'}: Permission denied"
    monkeypatch.setattr(store.shutil, "disk_usage", lambda _: SimpleNamespace(free=3 << 20))
    line = refused(capsys, *command, tmp_path / "new", *beside)
    assert line == f"vtlib: results need 64 MB, {tmp_path / 'new'} has 3 MB left"


def test_the_version_is_told(capsys):
    with pytest.raises(SystemExit) as ended:
        main("--version")
    assert (ended.value.code, capsys.readouterr().out) == (0, f"vtlib {__version__}\n")


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (KilledWorker("unit", None, 3), 2, "workers were killed; the same command goes on"),
        (OSError(28, "No space left"), 2, "No space left"),
    ],
)
def test_what_ends_a_command_is_one_line(capsys, monkeypatch, error, code, said):
    def broken(*_, **__):
        raise error

    monkeypatch.setattr(cli, "complete", broken)
    assert main("run", "tiny") == code
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("command", [["run", "tiny"], ["reproduce"]])
def test_a_device_that_is_not_there_is_refused_before_any_work(capsys, monkeypatch, command):
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    for function in ("complete", "reproduce"):
        monkeypatch.setattr(cli, function, None)
    line = refused(capsys, *command, "--device", "cuda:2")
    assert line == "vtlib: --device must be among the 2 of CUDA here, got cuda:2"


def test_only_runs_that_transfer_are_computed_on_the_device(stored, monkeypatch):
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: f"a card called {device}")
    given, real = {}, run.run_batch

    def spy(experiment, label, runs, weights, progress, device):
        given[label] = device
        return real(experiment, label, runs, weights, progress)

    monkeypatch.setattr(run, "run_batch", spy)
    for name in RESULTS[1:]:
        store.remove(stored / name)
    assert main("run", "tiny", "--results", stored, "--device", "cuda:1") == 0
    assert given == {"NT": "cpu", "GVT": "cuda:1"}
    for name in RESULTS:
        device = store.provenance(stored / name)["machine"].get("device")
        assert device == ("a card called cuda:1" if name == "tiny/GVT" else None)


def test_bench_is_a_command(monkeypatch):
    monkeypatch.setattr(bench, "main", lambda: 7)
    assert main("bench") == 7
