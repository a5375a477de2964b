"""Setting up: what is missing is done, what is broken is made anew, and failures are named."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

EXTENSIONS = Path(__file__).resolve().parents[1] / "book" / "_ext"
REQUIREMENTS = "requirements.txt", "pyproject.toml", "book/pyproject.toml"
OK = SimpleNamespace(returncode=0, stdout="", stderr="")


@pytest.fixture
def setting_up(extension, tmp_path, monkeypatch):
    """The module over a small checkout, and what it runs: every command succeeds but `broken`."""
    module, commands = extension("set_up"), []
    for name in (*REQUIREMENTS, "requirements-checks.txt", "vtlib/native/posterior.cpp"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("torch==2.4\n")
    environment = module.Environment(tmp_path / ".venv")

    def run(command, variables=None):
        commands.append(" ".join(command))
        if "-m venv" in commands[-1]:
            (environment.folder / "bin").mkdir(parents=True)
            (environment.folder / "pyvenv.cfg").touch()
            Path(environment.python).touch()
        elif not Path(environment.python).exists():
            raise FileNotFoundError(command[0])
        failing = [error for text, error in broken.items() if text in commands[-1]]
        return SimpleNamespace(returncode=1, stdout="", stderr=failing[0]) if failing else OK

    broken = {}
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "run", run)

    def set_up(*parts):
        commands.clear()
        module.set_up(environment, list(parts))
        return [x for x in commands if "venv" in x.split() or "install" in x or "native" in x]

    return SimpleNamespace(module=module, root=tmp_path, broken=broken, do=set_up)


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
    (setting_up.root / ".venv" / "unrelated~").touch()
    assert setting_up.do("book", "kernels", "checks") == []


def test_an_environment_that_was_copied_moved_or_interrupted_is_made_anew(setting_up):
    setting_up.do("book")
    note = setting_up.root / ".venv" / "set-up.json"
    note.write_text(json.dumps({**json.loads(note.read_text()), "folder": "/another/.venv"}))
    assert "-m venv" in setting_up.do("book")[0]
    note.write_text('{"folder": ')  # a torn note
    assert "-m venv" in setting_up.do("book")[0]
    note.unlink()  # an interrupt right after the environment was there
    assert "-m venv" in setting_up.do("book")[0]
    (setting_up.root / ".venv" / "bin" / "python").unlink()
    assert "-m venv" in setting_up.do("book")[0]


def test_a_folder_that_is_no_environment_is_left_alone(setting_up):
    (setting_up.root / ".venv").mkdir()
    with pytest.raises(setting_up.module.Failed, match="is no Python environment"):
        setting_up.do("book")


def test_a_python_without_its_installer_is_named_and_the_next_one_succeeds(setting_up):
    setting_up.broken["-m venv"] = "ensurepip is not available"
    with pytest.raises(setting_up.module.Failed, match="apt install"):
        setting_up.do("book")
    setting_up.broken.clear()
    assert "-m venv" in setting_up.do("book")[0]


def test_where_pytorchs_own_index_fails_the_ordinary_build_is_installed(setting_up, capsys):
    setting_up.broken["download.pytorch.org"] = "Connection to download.pytorch.org timed out"
    assert "--require-hashes" in setting_up.do("book")[2]
    assert "own index does not give it" in capsys.readouterr().out
    setting_up.broken["--require-hashes"] = "No space left on device"
    (setting_up.root / "requirements.txt").write_text("torch==2.5\n")
    with pytest.raises(setting_up.module.Failed, match="No space left on device"):
        setting_up.do("book")


def test_without_kernels_the_book_is_set_up_and_the_next_command_tries_again(setting_up, capsys):
    setting_up.broken["vtlab.native"] = "posterior.cpp:1:2: error: no\n; torch computes instead"
    setting_up.do("book", "kernels", "checks")
    assert "error: no\n; torch computes instead" in capsys.readouterr().out
    setting_up.broken.clear()
    assert [x.split()[-1] for x in setting_up.do("book", "kernels")] == ["vtlab.native"]


def test_of_the_users_settings_for_pip_only_those_of_the_network_hold(
    extension, tmp_path, monkeypatch
):
    module = extension("set_up")
    settings = "[global]\nindex-url = https://mirror.example.org/simple\n[install]\nuser = true\n"
    (tmp_path / "pip.conf").write_text(settings)
    for name in [name for name in os.environ if name.startswith("PIP_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("PIP_CONFIG_FILE", str(tmp_path / "pip.conf"))
    monkeypatch.setenv("PIP_TARGET", str(tmp_path))
    environment = module.Environment(Path(sys.prefix))
    options = environment.read_network()
    assert "--index-url=https://mirror.example.org/simple" in options
    assert not [option for option in options if "user" in option or "target" in option]
    ours = module.run([sys.executable, "-m", "pip", "config", "list"]).stdout
    assert "user" not in ours
    assert "target" not in ours


def test_two_commands_wait_for_each_other(tmp_path):
    code = "import sys; from set_up import alone\nwith alone(__import__('pathlib').Path("
    code += f"{str(tmp_path / 'folder' / 'lock')!r}), 'works'): print('in', flush=True); input()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "cwd": EXTENSIONS}
    with (
        subprocess.Popen([sys.executable, "-c", code], **pipes) as first,
        subprocess.Popen([sys.executable, "-c", "input()\n" + code], **pipes) as second,
    ):
        assert first.stdout.readline() == "in\n"
        second.stdin.write("\n\n")
        second.stdin.flush()
        assert second.stdout.readline().startswith("==> Another command works: waiting for it")
        first.communicate("\n")
        assert second.stdout.readline() == "in\n"
