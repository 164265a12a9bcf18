"""The one error of this package: input that no metric can use as it is."""

from __future__ import annotations


class MetricError(ValueError):
    """Input of a metric that cannot be used as it is; the message names the thing, what was expected and what came."""
