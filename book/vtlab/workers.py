"""Processes of this machine that compute for us."""

import contextlib
import multiprocessing
import os
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from typing import Any

from vtlab.interrupts import for_this_process_alone


@contextlib.contextmanager
def processes(jobs: int | None = None) -> Iterator[Executor]:
    """So many processes of this machine, one per processor that this one may use if not given.

    They end with this process, however it ends, and at once where an error ends the work.
    """
    before, spawn = multiprocessing.active_children(), multiprocessing.get_context("spawn")
    with for_this_process_alone():
        executor = _Processes(jobs or processors(), spawn, _end_with_parent)
    with executor:
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


class _Processes(ProcessPoolExecutor):
    def submit(self, *arguments: Any, **named: Any) -> Future[Any]:
        """Submit; the process that this may begin never sees an interrupt."""
        with for_this_process_alone():
            return super().submit(*arguments, **named)


def _end_with_parent() -> None:
    """In a process that computes: end as soon as its parent has, which may have been killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
