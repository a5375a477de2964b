"""The command line: what it prints, its exit codes, and one clear line for each bad input."""

import contextlib
import re
from concurrent.futures import BrokenExecutor
from unittest.mock import Mock

import numpy as np
import pytest
from attrs import evolve

from vtbook.experiments import EXPERIMENTS, THESIS
from vtlab import cli, registry, schedule, store
from vtlab.registry import installed

RESULTS = ("tiny-pool/sources", "tiny/tasks", "tiny/NT", "tiny/GVT")


@pytest.fixture(scope="module", autouse=True)
def small(tiny, here):
    """Two of the tiny algorithms are all that is known, and a worker in this process computes."""
    some = evolve(tiny, algorithms={label: tiny.algorithms[label] for label in ("NT", "GVT")})
    with pytest.MonkeyPatch.context() as monkeypatch:
        for user in (registry, cli):
            monkeypatch.setattr(user, "installed", lambda: {"mine": {"tiny": some}})
        monkeypatch.setattr(cli, "processes", lambda jobs: contextlib.nullcontext(here))
        yield some


def main(*arguments) -> int:
    return cli.main([str(x) for x in arguments])


def refused(capsys, *arguments) -> str:
    """The one line with which a refused command ends."""
    assert main(*arguments) == 2
    error = capsys.readouterr().err
    *bar, line = error.splitlines()
    assert all("left" in shown for shown in bar if shown), error
    assert line.startswith("vtlab: ")
    return line


def test_verify_names_what_differs(stored, rewrite, capsys):
    for arguments in ("tiny mine --whole", "--quick"):
        assert main("verify", *arguments.split(), "--results", stored) == 0
        assert capsys.readouterr().out == "".join(f"{name}: 3 of 3 equal\n" for name in RESULTS)
    greedy = store.read(stored / "tiny/GVT")[0]["greedy"]
    greedy[1, 3] += 0.1
    rewrite("tiny/GVT", greedy=greedy)
    assert main("verify", "tiny", "--quick", "--results", stored) == 0
    assert capsys.readouterr().out.endswith("tiny/GVT: 3 of 3 equal\n")
    assert main("verify", "tiny", "--whole", "--results", stored) == 1
    assert capsys.readouterr().out.endswith("tiny/GVT: DIFFERS in greedy of [1]\n")


def test_verify_draws_a_run_of_each_result(stored, capsys):
    assert main("verify", "tiny", "--results", stored) == 0
    counts = {name: 3 if name == "tiny/tasks" else 1 for name in RESULTS}
    lines = [f"{name}: {n} of {n} equal" for name, n in counts.items()]
    assert capsys.readouterr().out.splitlines() == lines


def test_reproduce_computes_anew_and_names_what_differs(
    stored, rewrite, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    arguments = ["reproduce", "--only", "mine", "--only", "tiny", "--results", stored]
    assert main(*arguments) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    assert lines == [f"{name}: 3 of 3 equal" for name in RESULTS]
    assert last == "0 of the results differ"
    rewrite("tiny/GVT", greedy=np.full((3, 11), 0.95, np.float32))
    store.remove(stored / "tiny/NT")
    assert main(*arguments, "--runs", 1) == 1
    *lines, last = capsys.readouterr().out.splitlines()
    nothing = "tiny/NT: nothing stored to compare with"
    assert {"tiny/GVT: DIFFERS in greedy of [0]", nothing} <= {*lines}
    assert last == "1 of the results differ"
    assert {p.name for p in (tmp_path / "_build").iterdir()} == {"reproduced", "reproduced-1"}
    line = refused(capsys, "reproduce", "--results", tmp_path / "_build" / "reproduced")
    assert "compared with others than themselves" in line


def test_the_book_offers_its_experiments_and_help_names_those_that_are_known(capsys):
    assert installed() == {"book": EXPERIMENTS, "thesis": THESIS}
    with pytest.raises(SystemExit, match="0"):
        main("verify", "--help")
    assert "mine, tiny; and guide" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["", "Tiny", "a\nb", "\u2028"])
def test_an_unknown_experiment_is_refused_before_any_work(capsys, name):
    near = "mine" if "iny" not in name else "tiny"
    for command in (["run"], ["verify"], ["reproduce", "--only"]):
        line = refused(capsys, *command, name)
        assert line == f"vtlab: unknown experiment {name!r}, {near} perhaps; run --help lists all"


COUNT = "must be a whole number of at least 1, got"
BAD = {
    "": "required",
    "run": "required",
    "reproduce --runs 0": f"{COUNT} '0'",
    **{f"run tiny --jobs={x}": f"{COUNT} {x!r}" for x in ("-3", "0", "2.5", "", "²")},
}


@pytest.mark.parametrize(("arguments", "reason"), BAD.items())
def test_arguments_that_are_none_end_with_the_usage(capsys, arguments, reason):
    with pytest.raises(SystemExit, match=r"^2$"):
        main(*arguments.split())
    *usage, line = capsys.readouterr().err.strip().splitlines()
    assert usage[0].startswith("usage: python -m vtlab")
    assert reason in line


def test_a_missing_or_torn_result_is_refused_and_left_as_it_is(stored, capsys, monkeypatch):
    path = stored / "tiny/GVT.json"
    monkeypatch.chdir(stored.parent)
    path.write_bytes(path.read_bytes().replace(b'"runs": 3', b'"runs": 4'))
    before = {p: p.read_bytes() for p in stored.rglob("*.*")}
    for command in ("verify", "run tiny", "reproduce"):
        line = refused(capsys, *command.split(), "--results", stored)
        assert str(path.with_suffix("")) in line
        assert line.endswith("; remove it, and run computes it again")
    assert not (stored.parent / "_build").exists()  # nothing was computed in vain
    assert {p: p.read_bytes() for p in stored.rglob("*.*")} == before
    store.remove(stored / "tiny/GVT")
    line = refused(capsys, "verify", "tiny", "--results", stored)
    assert line == f"vtlab: no stored result at {stored / 'tiny/GVT'}"


def test_a_run_that_diverges_is_one_line_without_a_traceback(small, stored, capfd, monkeypatch):
    wild = evolve(small, algorithms={"NT": evolve(small.algorithms["NT"], alpha=1e38)})
    monkeypatch.setattr(registry, "installed", lambda: {"mine": {"tiny": wild}})
    store.remove(stored / "tiny/NT")
    assert main("run", "tiny", "--results", stored) == 2
    error = capfd.readouterr().err
    assert re.search("vtlab: run [0-2] of tiny, NT diverged", error.splitlines()[-1])
    assert "Traceback" not in error


def test_results_that_are_not_there_and_a_quick_check_of_the_guide_are_refused(capsys, tmp_path):
    for command in ("verify", "reproduce"):
        line = refused(capsys, command, "--results", tmp_path / "mistyped")
        assert line.startswith(f"vtlab: there is no folder {tmp_path / 'mistyped'}: ")
    assert not list(tmp_path.iterdir())
    line = refused(capsys, "verify", "tiny", "guide", "--quick")
    assert line == "vtlab: --quick recomputes the first iterations; guide is recomputed whole"


def test_a_folder_that_cannot_take_results_is_named_at_once(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(schedule, "compute", None)
    command = "run", "tiny", "--results"
    (tmp_path / "file").write_text("mine")
    refused(capsys, *command, tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"
    read_only = PermissionError(13, "Permission denied")
    monkeypatch.setattr(store.tempfile, "TemporaryFile", Mock(side_effect=read_only))
    line = refused(capsys, *command, tmp_path / "new")
    assert line == f"vtlab: results cannot be written to {tmp_path / 'new'}: Permission denied"


FULL = "[Errno 28] No space left on device"


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (BrokenExecutor(), "workers were killed; the same command goes on from here"),
        (OSError(28, FULL[11:]), f"{FULL}; once that is mended the same command goes on"),
    ],
)
def test_killed_workers_and_a_full_disk_end_a_command(capsys, monkeypatch, error, line):
    monkeypatch.setattr(cli, "complete", Mock(side_effect=error))
    assert refused(capsys, "run", "tiny") == f"vtlab: {line}"
