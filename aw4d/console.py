"""Where results and progress are printed: stdout and stderr."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

Item = TypeVar("Item")

out_console = Console()
err_console = Console(stderr=True)


def bar() -> Progress:
    """A progress bar on stderr."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=err_console)


def watched(items: Iterable[Item], description: str, total: int) -> Iterator[Item]:
    """Pass items on and draw a bar."""
    with bar() as drawn:
        yield from drawn.track(items, total=total, description=description)
