"""One line of arithmetic: what the paper prints, what its own numbers and formulas give, and whether these agree."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from enum import StrEnum

from aw4d.reproduce.paper import digits_place

Quantity = bool | int | float | str | tuple[int | float, ...] | None


class Verdict(StrEnum):
    """What comes of holding the two side by side."""

    AGREES = "agrees"
    CONTRADICTS = "contradicts"
    UNEXPLAINED = "unexplained"  # no contradiction, but what the paper says does not lead there
    UNPHYSICAL = "not physical"  # the formula as printed breaks a law it stands for
    NOT_PRINTED = "not printed"  # follows from the paper's numbers and is worth knowing


@dataclass(frozen=True, kw_only=True)
class Check:
    """One line.

    Parameters
    ----------
    what
        The quantity.
    where
        Heading of the paper or label of its table.
    printed
        What the paper prints or says; None: nothing.
    gives
        What its own numbers give.
    verdict
        The two compared.
    how
        The arithmetic.
    """

    what: str
    where: str
    printed: Quantity
    gives: Quantity
    verdict: Verdict
    how: str


def compared(what: str, where: str, *, printed: int | Decimal, gives: float, how: str) -> Check:
    """A number that the paper prints: a count must be met, other numbers to the digits that are printed."""
    agrees = rounds_to(gives, printed) if isinstance(printed, Decimal) else gives == printed
    number = float(printed) if isinstance(printed, Decimal) else printed
    return Check(what=what, where=where, printed=number, gives=gives, verdict=same(agrees), how=how)


def follows(what: str, where: str, *, gives: Quantity, how: str) -> Check:
    """A number that the paper does not print and that follows from what it prints."""
    return Check(what=what, where=where, printed=None, gives=gives, verdict=Verdict.NOT_PRINTED, how=how)


def same(agrees: bool) -> Verdict:
    """The verdict on what is printed."""
    return Verdict.AGREES if agrees else Verdict.CONTRADICTS


def rounds_to(value: float, printed: Decimal) -> bool:
    """Whether a value may be printed so: within half of the last digit that is printed.

    >>> rounds_to(0.42535, Decimal("0.425")), rounds_to(0.5794, Decimal("0.580"))
    (True, False)
    """
    return abs(Decimal(value) - printed) <= Decimal(5).scaleb(digits_place(printed) - 1)
