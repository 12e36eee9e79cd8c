"""The models that nothing beats: no other is both cheaper and more accurate."""

from __future__ import annotations

from collections.abc import Sequence

from .._check import input_error

__all__ = ["pareto_front"]


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
    >>> from fresnel_decomp.report.pareto import pareto_front
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
    front: list[int] = []
    least = float("inf")
    for _, error, place in sorted(points):
        if error < least or not front:
            front.append(place)
            least = error
    return front
