"""Nodes and pole of a regression, by Nelder and Mead's simplex around its convex programmes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from ._programmes import Problem
from .regression import Design, Training

__all__ = ["search"]


def search(
    training: Training,
    start: Design,
    weights: Mapping[str, float] | None,
    evaluations: int = 240,
    report: Callable[[int, float], object] = lambda count, value: None,
) -> Design:
    """Nodes and pole near those of `start` with the least objective, on thinned curves.

    Parameters
    ----------
    training : Training
    start : Design
    weights : mapping or None
        With weights the objective is that of `regress`; without, that of `least_largest_error`.
    evaluations : int
        After which Nelder and Mead's simplex stops.
    report : callable
        Told the number of evaluations and the objective.

    Returns
    -------
    Design with nodes rounded to four digits and the pole to three
    """
    from scipy.optimize import minimize

    uses: dict[str, float] = dict.fromkeys(start.bounds, 1.0) if weights is None else dict(weights)
    keep: dict[str, set[int]] = {name: set() for name in training.sets}
    x = np.append(start.nodes, np.log(start.pole))
    count = 0

    def at(x: np.ndarray) -> Design:
        return replace(start, nodes=tuple(x[:-1].tolist()), pole=float(np.exp(x[-1])))

    def value(problem: Problem, tolerance: float) -> float:
        if weights is None:
            return problem.least_maximum(start.bounds, tolerance)[0]
        solution, reached = problem.least_squares(start.bounds, tolerance)
        if reached > 1.0 + 3.0 * tolerance:  # first become feasible
            return 1e6 * problem.least_maximum(start.bounds, tolerance)[0]
        return problem.mean_square(solution)

    def on_thinned(x: np.ndarray) -> float:
        nonlocal count
        gaps = np.diff(np.sort([0.0, *x[:-1], np.pi / 2]))
        if gaps.min() < 2e-3 or not 1e-2 < np.exp(x[-1]) < 10.0:
            return np.inf
        found = value(Problem(thin, at(x), uses), 3e-3)
        count += 1
        report(count, found)
        return found

    for step in (1.0, 0.5, 0.25):
        whole = Problem(training, at(x), uses)
        value(whole, 1e-2)
        for name, i, _ in whole.chosen:
            keep[name].add(i)
        thin = training.thinned(keep)
        steps = step * np.diag([0.02] * len(start.nodes) + [0.2])
        x = minimize(
            on_thinned, x, method="Nelder-Mead",
            options={"initial_simplex": np.vstack([x, x + steps]), "maxfev": evaluations // 3,
                     "xatol": 1e-4, "fatol": 1e-6},
        ).x  # fmt: skip
    nodes = tuple(float(f"{node:.4f}") for node in x[:-1])
    return replace(start, nodes=nodes, pole=float(f"{np.exp(x[-1]):.3g}"))
