"""What repeated measurements say: their median, and how far they scatter."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

__all__ = ["median_and_spread"]


def median_and_spread(values: Sequence[float]) -> tuple[float, float]:
    """Median, and half the distance between the quartiles.

    Examples
    --------
    >>> median_and_spread([1.0, 2.0, 3.0])
    (2.0, 0.5)
    """
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
    return middle, 0.5 * (high - low)
