"""Ctrl-C and the like end a command at once: what is stored is whole, whenever that happens.

Files appear under their names only when they are complete, so only processes have to be tidied up.
"""

# slow modules are imported where they are needed, so that the handlers stand before
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

    Once its work is done they are ignored while Python leaves. In the tenth of a second before,
    in which Python starts, SIGINT prints a traceback.
    """
    _answer(_leave)  # there are no processes to end before the next import
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

    # The tracker prints what it tidies up; begun later, it would let signals in again.
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
