"""Work on many frames in several processes, in order, with a bounded number of frames in memory."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

import cv2

from aw4d.errors import JobError

Task = TypeVar("Task")
Result = TypeVar("Result")


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the parent, which ends the workers
    cv2.setNumThreads(1)  # one process a core already
    threading.Thread(target=_die_with_parent, daemon=True).start()  # a killed parent cannot end them


def ordered_map(function: Callable[[Task], Result], tasks: Iterable[Task], *, workers: int) -> Iterator[Result]:
    """Results of a function on tasks, in the tasks' order.

    Parameters
    ----------
    function
        Defined at a module's top level, so that a fresh process can import it.
    tasks
        Drawn as workers become free: at most two tasks a worker are held at once.
    workers
        Processes; 1 works in this process.

    Raises
    ------
    JobError
        A process died: something killed it, mostly the system for lack of memory.
    """
    if workers <= 1:
        yield from map(function, tasks)
        return
    # Spawned, not forked: Zarr's threads may hold locks at the moment of a fork.
    others = multiprocessing.active_children()
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_start_worker)
    pending: deque[Future[Result]] = deque()
    try:
        for task in tasks:
            pending.append(pool.submit(function, task))
            if len(pending) >= 2 * workers:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    except BaseException as error:  # no one waits for what is in flight: a frame takes seconds
        pool.shutdown(wait=False, cancel_futures=True)
        for worker in multiprocessing.active_children():
            if worker not in others:
                worker.terminate()
        if isinstance(error, BrokenProcessPool):
            raise JobError("a process that worked on frames was killed, perhaps for lack of memory") from error
        raise
    pool.shutdown()
