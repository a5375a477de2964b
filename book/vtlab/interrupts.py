"""Ctrl-C and the like end a command at once: what is stored is whole, whenever that happens.

An orderly end would wait for workers, which are what one may want to be rid of. Files appear under
their names only when they are complete, so nothing has to be tidied up but processes.
"""

# what takes long to import is imported where it is needed: no handler stands before these are
import atexit
import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterator
from types import FrameType

SIGNALS = signal.SIGINT, signal.SIGTERM
QUIET = "ignore::UserWarning:multiprocessing.resource_tracker"
LINE = b"\nvtlab: interrupted; run and reproduce go on from here\n"


def end_at_once() -> None:
    """From now on SIGINT and SIGTERM end this process, with one line and exit code 128 + signal.

    Not once its work is done: Python takes a good part of a second to leave, and takes its handlers
    away before. Nor can it cover the tenth of a second that Python takes to start, before any line
    of ours runs: SIGINT prints a traceback then.
    """
    _answer(_leave)  # nothing has to be tidied up before what follows is imported
    import multiprocessing

    def tidy_up_and_leave(number: int, frame: FrameType | None) -> None:
        for child in multiprocessing.active_children():
            child.kill()
        _leave(number, frame)

    _answer(tidy_up_and_leave)
    atexit.register(_answer, signal.SIG_IGN)


@contextlib.contextmanager
def for_this_process_alone() -> Iterator[None]:
    """Threads and processes begun meanwhile never see SIGNALS, which may be sent to all."""
    from multiprocessing import resource_tracker

    # It tidies up after the others and says so; begun later, it would let signals in again.
    if QUIET not in sys.warnoptions:
        sys.warnoptions.append(QUIET)
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _answer(handler: Callable[[int, FrameType | None], None] | signal.Handlers) -> None:
    for number in SIGNALS:
        signal.signal(number, handler)


def _leave(number: int, frame: FrameType | None) -> None:
    os.write(2, LINE)
    os._exit(128 + number)
