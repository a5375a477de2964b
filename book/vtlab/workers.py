"""Processes of this machine that compute for us."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor


@contextlib.contextmanager
def processes(jobs: int | None = None) -> Iterator[Executor]:
    """So many processes of this machine, one per processor that this one may use if not given.

    They end with this process, however it ends, and at once where an error or Ctrl-C ends the work.
    """
    before, spawn = multiprocessing.active_children(), multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs or processors(), spawn, _end_with_parent) as executor:
        try:
            yield executor
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            for child in set(multiprocessing.active_children()).difference(before):
                child.kill()
            raise


def processors() -> int:
    """The number of processors that this process may use."""
    known = hasattr(os, "sched_getaffinity")  # not everywhere
    return len(os.sched_getaffinity(0)) if known else os.cpu_count() or 1


def _end_with_parent() -> None:
    """In a process that computes: leave Ctrl-C to its parent, and end as soon as that has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
