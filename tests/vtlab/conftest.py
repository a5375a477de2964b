"""What a small experiment comes to, which may be changed, and a worker in this process."""

import contextlib
import shutil
from concurrent.futures import ThreadPoolExecutor

import pytest

from vtlab import schedule, store, units


@pytest.fixture(scope="session")
def here():
    """An executor whose one worker is a thread of this process: what is changed here is there."""
    with ThreadPoolExecutor(1) as executor:
        yield executor


@contextlib.contextmanager
def in_twos():
    """Batches of two runs, so that three of them are cut. Elsewhere there are ten."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(units, "BATCH", 2)
        yield


@pytest.fixture(scope="module", autouse=True)
def two_at_a_time():
    with in_twos():
        yield


@pytest.fixture(scope="session")
def computed(tiny, here, tmp_path_factory):
    root = tmp_path_factory.mktemp("computed")
    with in_twos():
        schedule.complete([tiny], root, here)
    return root


@pytest.fixture
def stored(computed, tmp_path):
    return shutil.copytree(computed, tmp_path / "stored")


@pytest.fixture
def rewrite(stored):
    """Store a result with other arrays, or without one, as somebody who knows its digest would."""

    def change(name, **changes):
        arrays, note = store.read(stored / name)
        store.remove(stored / name)
        kept = {key: x for key, x in {**arrays, **changes}.items() if x is not None}
        store.save(stored / name, kept, note)

    return change
