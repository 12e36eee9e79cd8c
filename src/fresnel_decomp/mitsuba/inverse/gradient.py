"""Gradient descent with the gradients of Mitsuba's path replay integrator (`prb`).

What descends is the misfit across two renderings a and b, sum w (I_a - t)(I_b - t): its expectation
has no part of the renderings' noise, so that its minimum is not drawn to darkness, where there is
less of it. Both keep their random numbers in all iterations. So it is one smooth function, with
its very own gradient: quasi-Newton methods can build on that, and a run is repeatable.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from ..._check import InputError, input_error
from ..comparison import render_passes
from .images import RANGES, Images, half_seed
from .observed import Observed

__all__ = [
    "Descent",
    "NonFiniteGradientError",
    "at_the_end",
    "descend",
    "loss_and_gradient",
]

Array = NDArray[np.float64]

_REAL_ENDS = {("k", 0), ("r", 0), ("g", 0), ("g", 1)}
"""Ends of ranges where materials are: those that absorb nothing, black, and white at 82°."""

_UNITS = {"eta": 1.0, "k": 1.0, "alpha": 0.1}
"""Lengths that count alike, for the first step."""

_UNIT = 0.2  # of everything else

_PLATEAU = 0.03
"""Where one standard error costs 1: a fall of the misfit by less ends the descent."""


class NonFiniteGradientError(ArithmeticError):
    """A derivative that is not a finite number; the message names its parameter."""


@dataclass(frozen=True, eq=False)
class Descent:
    """Where the descent ended.

    Attributes
    ----------
    values : (n, 3) float
    alpha : float
    loss : float
    fall : float
        How much lower the misfit is than where it began; one standard error costs 1.
    iterations : int
        Evaluations of the gradient.
    converged : bool
        Whether the misfit no longer fell, rather than there being too many iterations.
    """

    values: Array
    alpha: float
    loss: float
    fall: float
    iterations: int
    converged: bool


def loss_and_gradient(
    images: Images,
    observed: Observed,
    values: Array,
    alpha: float,
    *,
    spp: int,
    seed: int,
    roughness: bool = False,
) -> tuple[float, dict[str, Array]]:
    """Weighted mean squared error across two renderings, and its gradient by `prb`.

    Parameters
    ----------
    images : Images
    observed : Observed
    values : (n, 3) float
    alpha : float
    spp, seed : int
        `spp` are for each of the two renderings.
    roughness : bool
        Differentiate by alpha too. `prb` holds sampled directions fixed, unlike the loss itself,
        so that this derivative is that of the loss only in expectation.

    Returns
    -------
    loss : float
        Less than 0 where noise is all there is.
    gradient : dict
        (3,) per name of a parameter, () for "alpha".

    Raises
    ------
    NonFiniteGradientError
        Naming the parameter.
    """
    images.put(values, alpha)
    names = [*images.names, "alpha"] if roughness else list(images.names)
    total = 0.0
    gradient = {name: np.zeros(() if name == "alpha" else 3) for name in names}
    scale = 1.0 / observed.count
    at = 0
    for i, (scene, parameters, keys) in enumerate(
        zip(images.scenes, images.parameters, images.keys, strict=True)
    ):
        width, height = images.sizes[i]
        pixels = slice(at, at + width * height)
        at += width * height
        leaves = {}
        for name in names:
            value = dr.detach(parameters[keys[name]])
            leaves[name] = type(value)(value)
            dr.enable_grad(leaves[name])
            parameters[keys[name]] = leaves[name]
        parameters.update()
        integrator = mi.load_dict({"type": "prb", **images.integrators[i]})
        shape = (height, width, 3)
        target = mi.TensorXf(observed.values[pixels].reshape(shape).astype(np.float32))
        # its square root: light may be so strong that weights leave float32
        weight = np.sqrt(scale * observed.weight[pixels])
        root = mi.TensorXf(weight.reshape(shape).astype(np.float32))
        errors, product = [], 0.0
        passes = [render_passes(scene, spp, half_seed(seed, half, i)) for half in (0, 1)]
        for half in (0, 1):
            image = 0.0
            for (samples, own), (_, other) in zip(passes[half], passes[1 - half], strict=True):
                image = image + (samples / spp) * mi.render(
                    scene, parameters, integrator=integrator, spp=samples, seed=own,
                    seed_grad=other,
                )  # fmt: skip
            errors.append(root * (dr.detach(image) - target))
            # the error of one rendering times the derivative of the other
            product = product + errors[half] * (root * image)
        # once, as going backward takes apart what both have in common: from colours to coefficients
        dr.backward(dr.sum(product, axis=None))
        total += float(np.sum(np.array(errors[0] * errors[1], np.float64)))
        images.samples += 6 * spp * width * height  # each: the image, its replay, its derivative
        for name in names:
            part = np.array(dr.grad(leaves[name]), np.float64).reshape(gradient[name].shape)
            if not np.isfinite(part).all():
                value = alpha if name == "alpha" else values[images.names.index(name)]
                raise NonFiniteGradientError(
                    f"the derivative of image {i} by '{name}' is {part.round(6)} at {name} = "
                    f"{np.round(value, 6)}; accepted: finite ones. Start from within the range of "
                    f"'{name}', not at its end, and look for textures with NaN."
                )
            gradient[name] = gradient[name] + part
            parameters[keys[name]] = dr.detach(leaves[name])
        parameters.update()
    return total, gradient


def descend(
    images: Images,
    observed: Observed,
    values: Array,
    alpha: float,
    *,
    spp: int,
    seed: int,
    roughness: bool,
    iterations: int,
    record: Callable[[Array, float], None] | None = None,
) -> Descent:
    """Quasi-Newton descent within the parameters' ranges (L-BFGS-B, Zhu et al. 1997).

    Parameters
    ----------
    images, observed, spp, seed, roughness
        As for `loss_and_gradient`.
    values, alpha
        Where it starts.
    iterations : int
        Gradients, at most.
    record : callable, optional
        Called after each gradient with the best values and alpha so far, as those just tried may
        be a step of the line search that is taken back.
    """
    if not dr.is_diff_v(mi.Float):
        raise input_error(
            f"gradient descent in {mi.variant()}",
            "llvm_ad and cuda_ad variants",
            "Take route='linear', which needs no derivatives, or set another variant.",
        )
    n = len(images.names)
    names = [*images.names, "alpha"] if roughness else list(images.names)
    units = np.repeat([_UNITS.get(name, _UNIT) for name in names], [_count(name) for name in names])
    ranges = [RANGES.get(name, (None, None)) for name in names for _ in range(_count(name))]
    count, begun, best = 0, -np.inf, (np.inf, np.array(values, np.float64), float(alpha))

    def function(scaled: Array) -> tuple[float, Array]:
        nonlocal count, begun, best
        if count == iterations:
            raise _EnoughError
        count += 1
        flat = scaled * units
        x, a = flat[: 3 * n].reshape(n, 3), float(flat[-1]) if roughness else float(alpha)
        try:
            loss, gradient = loss_and_gradient(
                images, observed, x, a, spp=spp, seed=seed, roughness=roughness
            )
        except InputError:  # an index that no basis follows, in the middle of the ranges: a wall
            if count == 1:
                raise
            return begun + 10.0 * abs(begun - best[0]) + 1.0, np.zeros_like(scaled)
        if count == 1:
            begun = loss
        if loss < best[0]:
            best = loss, x.copy(), a
        if record is not None:
            record(*best[1:])
        return loss, units * np.concatenate([np.atleast_1d(gradient[name]) for name in names])

    begin = np.concatenate([best[1].ravel(), [alpha] if roughness else []]) / units
    enough = False
    try:
        scipy.optimize.minimize(
            function,
            begin,
            jac=True,
            method="L-BFGS-B",
            bounds=[
                tuple(None if end is None else end / unit for end in pair)
                for pair, unit in zip(ranges, units, strict=True)
            ],
            options={
                "ftol": _PLATEAU / observed.count,
                "gtol": 0.0,
                "maxcor": 20,
            },
        )
    except _EnoughError:
        enough = True
    fall = (begun - best[0]) * observed.count
    return Descent(best[1], best[2], best[0], fall, count, not enough)


def at_the_end(names: Sequence[str], values: Array) -> list[str]:
    """Which of `values` (n, 3) have run to the end of a range where no material is expected."""
    found = []
    for name, row in zip(names, values, strict=True):
        ends = [end for i, end in enumerate(RANGES.get(name, ())) if (name, i) not in _REAL_ENDS]
        if any(np.any(np.abs(row - end) <= 1e-6 * end) for end in ends):
            found.append(name)
    return found


class _EnoughError(Exception):
    """As many gradients as were allowed."""


def _count(name: str) -> int:
    """Of numbers that a parameter has."""
    return 1 if name == "alpha" else 3
