"""Items produced ahead: same items, same order, errors handed over, and no thread left or waited for in vain."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from aw4d.overlap import ahead, mapped_ahead


def test_the_same_items_in_the_same_order() -> None:
    assert list(ahead(iter(range(100)))) == list(range(100))


def test_an_error_is_raised_where_the_items_are_taken() -> None:
    def broken() -> Iterator[int]:
        yield 1
        raise ValueError("two")

    items = ahead(broken())
    assert next(items) == 1
    with pytest.raises(ValueError, match="two"):
        next(items)


def test_closing_stops_the_thread_and_closes_what_it_read_from() -> None:
    closed = []

    def endless() -> Iterator[int]:
        try:
            while True:
                yield 1
        finally:
            closed.append(threading.current_thread())

    before = threading.active_count()
    items = ahead(endless())
    next(items)
    items.close()
    assert threading.active_count() == before
    assert closed
    assert closed != [threading.current_thread()]


def test_a_forgotten_iterator_does_not_make_the_garbage_collector_wait() -> None:
    may_go_on = threading.Event()

    def waits_for_another_thread() -> Iterator[int]:
        yield 1
        may_go_on.wait()

    items = ahead(waits_for_another_thread())
    next(items)
    collector = threading.Thread(target=items.close, daemon=True)
    collector.start()
    collector.join(10)
    stuck = collector.is_alive()
    may_go_on.set()
    assert not stuck


# ---- a function on items ---------------------------------------------------------------------------------------------


def test_results_come_in_the_order_of_the_items() -> None:
    def late(item: int) -> int:
        time.sleep(0.002 * (item % 3))
        return item

    assert list(mapped_ahead(late, range(30))) == list(range(30))


def test_few_items_are_taken_ahead() -> None:
    taken = []

    def items() -> Iterator[int]:
        for item in range(100):
            taken.append(item)
            yield item

    results = mapped_ahead(str, items())
    assert next(results) == "0"
    assert len(taken) <= 4
    results.close()


def test_an_exception_is_raised_in_its_place() -> None:
    def broken(item: int) -> int:
        if item == 2:
            raise ValueError("two")
        return item

    results = mapped_ahead(broken, range(9))
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(ValueError, match="two"):
        next(results)


def test_closing_ends_the_threads() -> None:
    before = threading.active_count()
    results = mapped_ahead(str, range(100))
    next(results)
    results.close()
    assert threading.active_count() == before
