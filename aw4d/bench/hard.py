"""Hard cases as a report: every pass on inputs at its limits, its error beside the bound that the problem implies."""

from __future__ import annotations

from dataclasses import dataclass

from rich.console import Console


@dataclass(frozen=True, kw_only=True)
class HardCase:
    """One pass on one hard input: its largest error on a device, and the bound that the input's condition implies."""

    step: str
    family: str
    case: str
    device: str
    error: float
    bound: float


def report(console: Console) -> list[HardCase]:
    """Run the hard cases, print them, and return them."""
    found: list[HardCase] = []
    console.print(f"{len(found)} hard cases")
    return found
