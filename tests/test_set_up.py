"""Setting up: what is missing is done, what is broken is made anew, and failures are named."""

import json
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

FILES = "requirements.txt", "requirements-checks.txt", "vtlib/native/posterior.cpp"


@pytest.fixture
def setting_up(extension, tmp_path, monkeypatch):
    """Set parts up in a small checkout, where only `broken` fails; what was run for that."""
    module, commands, broken = extension("set_up"), [], []
    for name in FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("torch==2.4\n")
    venv = tmp_path / ".venv"

    def run(*command, **_):
        commands.append(" ".join(command))
        if "-m venv" in commands[-1]:
            (venv / "bin").mkdir(parents=True, exist_ok=True)
            (venv / "bin" / "python").touch()
            (venv / "pyvenv.cfg").touch()
        return not any(text in commands[-1] for text in broken)

    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "run", run)

    def set_up(*parts):
        commands.clear()
        module.set_up(venv, parts)
        return commands

    return SimpleNamespace(do=set_up, root=tmp_path, broken=broken)


def test_only_what_is_missing_or_has_changed_is_done(setting_up):
    made, torch, requirements, packages, kernels = setting_up.do("book", "kernels")
    assert "-m venv" in made
    assert "torch==2.4" in torch
    assert "--require-hashes" in requirements
    assert "-e" in packages
    assert "vtlab.native" in kernels
    assert setting_up.do("book", "kernels") == []
    assert "requirements-checks.txt" in " ".join(setting_up.do("book", "kernels", "checks"))
    (setting_up.root / "vtlib/native/posterior.cpp").write_text("changed")
    assert len(setting_up.do("book", "kernels", "checks")) == 1


def test_an_environment_that_was_copied_interrupted_or_broken_is_made_anew(setting_up):
    setting_up.do("book")
    note = setting_up.root / ".venv" / "set-up.json"
    note.write_text(json.dumps({**json.loads(note.read_text()), "folder": "/another/.venv"}))
    assert "-m venv" in setting_up.do("book")[0]
    note.unlink()  # an interrupt right after the environment was there
    assert "-m venv" in setting_up.do("book")[0]
    (setting_up.root / ".venv" / "bin" / "python").unlink()
    assert "-m venv" in setting_up.do("book")[0]


def test_a_folder_that_is_no_environment_is_left_alone(setting_up):
    (setting_up.root / ".venv").mkdir()
    with pytest.raises(SystemExit, match="is no Python environment"):
        setting_up.do("book")


@pytest.mark.parametrize(
    ("broken", "named"), [("-m venv", "apt install"), ("--require-hashes", "could not install")]
)
def test_what_fails_is_named_and_the_next_command_tries_again(setting_up, broken, named):
    setting_up.broken.append(broken)
    with pytest.raises(SystemExit, match=named):
        setting_up.do("book")
    setting_up.broken.clear()
    assert "-m venv" in setting_up.do("book")[0]


def test_pytorchs_own_index_and_kernels_can_be_done_without(setting_up):
    setting_up.broken += ["download.pytorch.org", "vtlab.native"]
    assert "--require-hashes" in setting_up.do("book", "kernels")[2]
    setting_up.broken.clear()
    (kernels,) = setting_up.do("book", "kernels")
    assert "vtlab.native" in kernels


def test_two_commands_wait_for_each_other(extension, tmp_path, capsys):
    alone, lock = extension("set_up").alone, tmp_path / "folder" / "lock"

    def work():
        with alone(lock, "works"):
            return True

    with ThreadPoolExecutor() as threads:
        with alone(lock, "works"):
            second = threads.submit(work)
            with pytest.raises(TimeoutError):
                second.result(0.5)
        assert second.result()
    assert capsys.readouterr().out.startswith("==> Another command works: waiting for it")
