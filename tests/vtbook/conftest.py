"""The pages' cells, without what only a reader waits for."""

import pytest


@pytest.fixture(scope="session")
def cells_of(cells_of):
    """The names of a page, but for the runs that it makes, which take seconds."""

    def without_runs(name):
        with pytest.MonkeyPatch.context() as patch:
            for run in ("vtlib.algorithm1.algorithm1", "vtbook.checkpoints.pauses"):
                patch.setattr(run, lambda *_: ())
            return cells_of(name)

    return without_runs
