"""Files that are written at once, whatever stops the writing."""

import os
from unittest.mock import Mock

import pytest

from vtlib.files import write_bytes


def test_a_file_is_replaced_and_what_a_killed_process_left_of_it_is_removed(tmp_path):
    path, other = tmp_path / "x[1].npz", tmp_path / ".x1.npz.abc.half"
    (tmp_path / ".x[1].npz.abc.half").write_bytes(b"cut")
    other.write_bytes(b"another file's")
    for data in (b"old", b"new"):
        write_bytes(path, data)
        assert path.read_bytes() == data
    assert path.stat().st_mode & 0o777 == 0o644
    assert {*tmp_path.iterdir()} == {path, other}


@pytest.mark.parametrize("step", ["fsync", "chmod", "replace"])
@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_an_error_leaves_the_old_file_and_no_litter(tmp_path, monkeypatch, step, error):
    path = tmp_path / "x"
    path.write_bytes(b"old")
    monkeypatch.setattr(os, step, Mock(side_effect=error(28, "No space left on device")))
    with pytest.raises(error) as raised:
        write_bytes(path, b"new")
    assert getattr(raised.value, "filename", str(path)) == str(path)
    assert path.read_bytes() == b"old"
    assert [*tmp_path.iterdir()] == [path]
