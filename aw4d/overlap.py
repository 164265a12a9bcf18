"""Working ahead in threads, so that decode, compute and encode overlap."""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

from aw4d.interrupts import stopped

T = TypeVar("T")
Result = TypeVar("Result")
THREAD = "ahead"
_DEPTH = 2  # items ahead: enough to hide jitter, and memory stays flat


class _Failure:
    """An exception on its way from the thread to the consumer."""

    def __init__(self, error: BaseException) -> None:
        self.error = error


class _End:
    """The producer is done."""


class _Producer(threading.Thread, Generic[T]):
    """Fills a bounded queue from an iterable until it ends, fails, or is told to stop."""

    def __init__(self, items: Iterable[T]) -> None:
        super().__init__(daemon=True, name=THREAD)
        self.items = items
        self.queue: queue.Queue[T | _Failure | _End] = queue.Queue(maxsize=_DEPTH)
        self.stop = threading.Event()

    def run(self) -> None:
        """Produce; the last thing put is an end or a failure."""
        try:
            for item in self.items:
                if not self._put(item):
                    return
            self._put(_End())
        except BaseException as error:  # handed over whole: the consumer raises it
            self._put(_Failure(error))
        finally:
            if isinstance(self.items, Generator):  # here, not wherever the garbage collector finds it
                self.items.close()

    def _put(self, item: T | _Failure | _End) -> bool:
        while not self.stop.is_set():
            try:
                self.queue.put(item, timeout=0.1)
                return True
            except queue.Full:
                continue
        return False


def ahead(items: Iterable[T]) -> Generator[T, None, None]:
    """The same items in the same order, produced by a thread; its exception is raised here.

    Closing the iterator early stops the thread.
    """
    producer = _Producer(items)
    consumer = threading.current_thread()
    producer.start()
    try:
        while True:
            item = producer.queue.get()
            if isinstance(item, _End):
                return
            if isinstance(item, _Failure):
                raise item.error
            yield item
    finally:
        producer.stop.set()
        # The garbage collector closes a forgotten iterator in any thread, also in one that the producer waits for.
        if threading.current_thread() is consumer:
            while producer.is_alive() and not stopped.is_set():
                producer.join(0.1)


def mapped_ahead(function: Callable[[T], Result], items: Iterable[T]) -> Generator[Result, None, None]:
    """Results of a function on items, in order, by two threads a few items ahead: while one waits, the other works.

    A function's exception is raised here; closing the iterator early stops the threads.
    """
    consumer = threading.current_thread()
    pool = ThreadPoolExecutor(_DEPTH)
    pending: deque[Future[Result]] = deque()
    try:
        for item in items:
            pending.append(pool.submit(function, item))
            if len(pending) > _DEPTH:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:
        pool.shutdown(wait=threading.current_thread() is consumer, cancel_futures=True)  # see `ahead`
