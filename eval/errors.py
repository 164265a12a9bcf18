"""The errors of this package: input that no metric can use as it is, or that is not all there."""

from __future__ import annotations


class MetricError(ValueError):
    """Input of a metric that cannot be used as it is; the message names the thing, what was expected and what came."""


class MissingError(MetricError):
    """Input that takes something else with it to be used; the message begins with the option that would give it."""
