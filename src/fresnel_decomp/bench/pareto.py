"""Which model is best for a budget: the models that nothing beats, by cost and error.

One staircase serves figures, tables and sentences, so that they cannot contradict each other.
It is made of numbers as they are printed (`counted`): what reads the same counts as the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from .._check import input_error

__all__ = [
    "best_within",
    "clearly_less",
    "counted",
    "front",
    "pareto_front",
    "tied",
    "two_digits",
]

Row = dict[str, Any]


class _Point(NamedTuple):
    row: Row
    cost: float
    error: float


SIGNIFICANCE = 0.05
"""How often rounds of two equal models may call one of them the faster."""


def pareto_front(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Places of the points that no other point beats, from the cheapest to the most accurate.

    A point is beaten where another costs no more and errs no more, and is better in one of them;
    of equal points the first counts. Points with NaN take no part.

    Raises
    ------
    InputError
        For different numbers of costs and errors.

    Examples
    --------
    >>> from fresnel_decomp.bench.pareto import pareto_front
    >>> pareto_front([1.0, 0.2, 0.5, 0.6], [0.0, 0.3, 0.1, 0.1])
    [1, 2, 0]
    """
    if len(costs) != len(errors):
        raise input_error(
            f"{len(costs)} costs and {len(errors)} errors", "one of each a point", "Pair them."
        )
    points = [
        (cost, error, place)
        for place, (cost, error) in enumerate(zip(costs, errors, strict=True))
        if cost == cost and error == error
    ]
    found: list[int] = []
    least = math.inf
    for _, error, place in sorted(points):
        if error < least or not found:
            found.append(place)
            least = error
    return found


def two_digits(value: float) -> float:
    """The nearest number with two digits that are not leading zeros.

    Examples
    --------
    >>> two_digits(0.01849), two_digits(1.118)
    (0.018, 1.1)
    """
    return float(f"{value:.1e}")


def counted(row: Row, column: str) -> float | None:
    """A number of a row as it is printed and compared; None where there is none.

    Errors have two digits; ratios of times two decimals, or two digits below 0.1; bytes and
    operations are what they are.

    Examples
    --------
    >>> row = {"d_max": 0.01394, "bsdf_ratio": 0.7037, "bytes": 128}
    >>> [counted(row, column) for column in ("d_max", "bsdf_ratio", "bytes", "operations")]
    [0.014, 0.7, 128.0, None]
    """
    value = row.get(column)
    if value is None or value != value:
        return None
    if column in ("bytes", "operations"):
        return float(value)
    if column.endswith("_ratio") and value >= 0.1:
        return round(float(value), 2)
    return two_digits(value)


def front(rows: Sequence[Row], cost: str, error: str, integrates: bool) -> list[Row]:
    """The models that nothing beats, from the cheapest to the most accurate.

    Parameters
    ----------
    rows : of a benchmark
    cost, error : columns
    integrates : bool
        Only models that can be integrated over rough surfaces ahead of time.
    """
    points = _points(rows, cost, error, integrates)
    places = pareto_front([point.cost for point in points], [point.error for point in points])
    return [points[place].row for place in places]


def best_within(steps: Sequence[Row], cost: str, budget: float) -> Row | None:
    """The model of a front that a budget buys: the last that costs no more, or None."""
    best = None
    for row in steps:
        price = counted(row, cost)
        if price is not None and price <= budget:
            best = row
    return best


def tied(rows: Sequence[Row], cost: str, error: str, integrates: bool) -> list[Row]:
    """Models beside the front that noise alone may have kept off it.

    Nothing that is clearly cheaper (`clearly_less`) is as accurate as they are. Costs that are
    counted instead of measured have no noise, so that nothing is tied.
    """
    if not cost.endswith("_ratio"):
        return []
    steps = front(rows, cost, error, integrates)
    points = _points(rows, cost, error, integrates)
    return [
        point.row
        for point in points
        if not any(point.row is step for step in steps)
        and not any(
            other.error <= point.error and clearly_less(other.row, point.row, cost)
            for other in points
        )
    ]


def clearly_less(first: Row, second: Row, cost: str) -> bool:
    """Whether the first costs less than the second by more than noise explains.

    Where both have as many rounds ("{kind}_ratios", to the built-in of the same round) the median
    is less and so are so many rounds that a sign test at 5 % tells them apart, for which it takes
    five rounds. Else the ratios are apart by more than both spreads. Bytes and operations have no
    noise.

    Examples
    --------
    >>> fast = {"bsdf_ratio": 0.70, "bsdf_spread": 0.02}
    >>> slow = {"bsdf_ratio": 0.75, "bsdf_spread": 0.04}
    >>> clearly_less(fast, slow, "bsdf_ratio")
    False
    >>> clearly_less(fast, slow | {"bsdf_ratio": 0.77}, "bsdf_ratio")
    True
    """
    if not first[cost] < second[cost]:
        return False
    if not cost.endswith("_ratio"):
        return True
    rounds = cost + "s"
    pairs = [(row.get(rounds) or []) for row in (first, second)]
    if pairs[0] and len(pairs[0]) == len(pairs[1]):
        less = sum(a < b for a, b in zip(*pairs, strict=True))
        more = sum(a > b for a, b in zip(*pairs, strict=True))
        return less > more and _tail(less + more, less) <= SIGNIFICANCE
    spread = cost.removesuffix("_ratio") + "_spread"
    return bool(first[cost] + first[spread] + second[spread] < second[cost])


def _tail(count: int, least: int) -> float:
    """Chance that of `count` fair coins at least so many show heads."""
    return sum(math.comb(count, heads) for heads in range(least, count + 1)) / 2.0**count


def _points(rows: Sequence[Row], cost: str, error: str, integrates: bool) -> list[_Point]:
    """Those of which both numbers are known."""
    found = []
    for row in rows:
        x, y = counted(row, cost), counted(row, error)
        if x is not None and y is not None and (row["integrates"] or not integrates):
            found.append(_Point(row, x, y))
    return found
