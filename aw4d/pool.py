"""Work on many frames in several processes, in order, with a bounded number of frames in memory."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.connection import Connection
from typing import Generic, TypeVar, cast

import cv2

from aw4d.errors import JobError

Task = TypeVar("Task")
Result = TypeVar("Result")


class _Failure:
    """An exception on its way from a worker to the caller."""

    def __init__(self, error: Exception) -> None:
        self.error = error


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(function: Callable[[Task], Result], connection: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the parent, which ends the workers
    cv2.setNumThreads(1)  # one process a core already
    threading.Thread(target=_die_with_parent, daemon=True).start()  # a killed parent cannot end them
    while True:
        task = connection.recv()
        try:
            answer: Result | _Failure = function(task)
        except Exception as error:  # raised where the result is awaited
            answer = _Failure(error)
        connection.send(answer)


class _Worker(Generic[Task, Result]):
    """A process with a pipe of its own: where it dies, even in the middle of a result, the pipe's end is seen.

    `concurrent.futures` has one pipe for all results and waits for ever for the other half of a result.
    """

    def __init__(self, function: Callable[[Task], Result]) -> None:
        # Spawned, not forked: Zarr's threads may hold locks at the moment of a fork.
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(function, theirs), daemon=True)
        self.process.start()
        theirs.close()

    def begin(self, task: Task) -> None:
        try:
            self.connection.send(task)
        except OSError as error:
            raise _killed() from error

    def result(self) -> Result:
        try:
            answer = self.connection.recv()
        except (EOFError, OSError) as error:
            raise _killed() from error
        if isinstance(answer, _Failure):
            raise answer.error
        return cast("Result", answer)

    def end(self) -> None:
        self.process.terminate()  # no one waits for what is in flight: a frame takes seconds
        self.process.join()
        self.connection.close()


def _killed() -> JobError:
    return JobError("a process that worked on frames was killed, perhaps for lack of memory")


def ordered_map(function: Callable[[Task], Result], tasks: Iterable[Task], *, workers: int) -> Iterator[Result]:
    """Results of a function on tasks, in the tasks' order.

    Parameters
    ----------
    function
        Defined at a module's top level, so that a fresh process can import it.
    tasks
        Drawn as workers become free: one task a worker is held at once.
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
    at_work: deque[_Worker[Task, Result]] = deque()  # the one with the earliest task first
    try:
        for task in tasks:
            if len(at_work) < workers:
                at_work.append(_Worker(function))
                at_work[-1].begin(task)
                continue
            result = at_work[0].result()
            at_work[0].begin(task)  # before the caller does its part
            at_work.rotate(-1)
            yield result
        for worker in at_work:
            yield worker.result()
    finally:
        for worker in at_work:
            worker.end()
