"""The models that nothing beats: no other is both cheaper and more accurate."""

from __future__ import annotations

from collections.abc import Sequence

from .._check import input_error

__all__ = ["pareto_front"]


def pareto_front(costs: Sequence[float], errors: Sequence[float], slack: float = 0.0) -> list[int]:
    """Places of the points that no other point beats, from the cheapest to the most accurate.

    A point is beaten where another costs no more and errs no more, and is better in one of them;
    of equal points the first counts. Points with NaN take no part.

    Parameters
    ----------
    costs, errors : sequences of one length
    slack : float >= 0
        Costs that differ by less than this, relative, count as equal: measured times need it, or
        noise would choose between models that run the same code.

    Raises
    ------
    InputError
        For different numbers of costs and errors.

    Examples
    --------
    >>> from fresnel_decomp.report.pareto import pareto_front
    >>> pareto_front([1.0, 0.2, 0.5, 0.6], [0.0, 0.3, 0.1, 0.1])
    [1, 2, 0]
    >>> pareto_front([1.0, 1.01, 2.0], [0.3, 0.2, 0.1], slack=0.02)
    [1, 2]
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
    # of those that cost the same but for the slack the most accurate stays; groups do not chain
    kept: list[int] = []
    start = None
    for place in front:
        if start is not None and costs[place] <= start * (1.0 + slack):
            kept[-1] = place
        else:
            kept.append(place)
            start = costs[place]
    return kept
