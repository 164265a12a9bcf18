"""Ctrl-C and SIGTERM: the job unwinds at once and takes away what is half-written."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
stopped = threading.Event()  # set before the job unwinds: nobody waits for a thread that is in the middle of a frame


class Interrupted(BaseException):
    """The user, or the system, ends the job. No `KeyboardInterrupt`, which Typer ends without a word."""


def _stop(number: int, frame: FrameType | None) -> None:
    stopped.set()
    raise Interrupted(signal.Signals(number).name)


@contextmanager
def raised() -> Iterator[None]:
    """In the block both signals raise `Interrupted` in the main thread."""
    before = {number: signal.signal(number, _stop) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
