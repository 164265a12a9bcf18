"""What a run did not measure, and why: nothing is left out silently."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """Something that was not measured."""

    what: str
    why: str
