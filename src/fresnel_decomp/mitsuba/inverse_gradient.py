"""Gradient descent: Adam, with the gradients of Mitsuba's path replay integrator (`prb`).

The images of an iteration and their derivative have random numbers of their own, so that the
gradient of the squared error has no bias; both keep theirs over all iterations, so that one smooth
function descends, and a run is repeatable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from .._check import input_error
from .inverse_images import Images, Observed, derived_seed

__all__ = ["Descent", "NonFiniteGradientError", "descend", "loss_and_gradient"]

Array = NDArray[np.float64]

RANGES = {
    "eta": (0.02, 20.0),
    "k": (0.0, 20.0),
    "r": (0.0, 1.0 - 1e-4),
    "g": (0.0, 1.0),
    "alpha": (0.005, 1.0),
}
"""Where values are kept; reflectances and coefficients are free."""

_STEPS = {"eta": 0.1, "k": 0.1, "alpha": 0.01}
_STEP = 0.02  # of everything else


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
    iterations : int
    converged : bool
        Whether steps had become too small to matter, rather than too many.
    """

    values: Array
    alpha: float
    loss: float
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
    shared_samples: bool = False,
) -> tuple[float, dict[str, Array]]:
    """Weighted mean squared error, and its gradient by `prb`.

    Parameters
    ----------
    images : Images
    observed : Observed
    values : (n, 3) float
    alpha : float
    spp, seed : int
    roughness : bool
        Differentiate by alpha too.
    shared_samples : bool
        Use the images' own samples for their derivative. Then the gradient is that of this very
        loss, but biased as an estimate: noise of the one is noise of the other.

    Returns
    -------
    loss : float
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
    scale = 1.0 / float(np.sum(observed.weight * observed.brightness**2))
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
        own = derived_seed(seed, i)
        other = derived_seed(seed, i, 1)
        shape = (height, width, 3)
        target = mi.TensorXf(observed.values[pixels].reshape(shape).astype(np.float32))
        weight = mi.TensorXf((scale * observed.weight[pixels]).reshape(shape).astype(np.float32))
        seeds = (other, own) if shared_samples else (own, other)
        image = mi.render(
            scene, parameters, integrator=integrator, spp=spp, seed=seeds[0], seed_grad=seeds[1]
        )
        seen = dr.detach(image)
        if shared_samples:  # Mitsuba refuses equal seeds, for the bias's sake
            with dr.suspend_grad():
                seen = mi.render(scene, integrator=integrator, spp=spp, seed=own)
        error = seen - target
        dr.backward(dr.sum(2.0 * weight * error * image, axis=None))
        total += float(np.sum(np.array(weight * dr.square(error), np.float64)))
        images.samples += 3 * spp * width * height  # the image, its replay, and its derivative
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
    step: float = 1.0,
    record: Any = None,
) -> Descent:
    """Adam (Kingma and Ba 2015), with steps halved where the loss no longer falls.

    Parameters
    ----------
    images, observed, spp, seed, roughness
        As for `loss_and_gradient`.
    values, alpha
        Where it starts.
    iterations : int
        At most.
    step : float
        Factor on the steps: .02 for reflectances and tints, .1 for eta and k, .01 for alpha.
    record : callable, optional
        Called with values and alpha after each iteration.
    """
    if not dr.is_diff_v(mi.Float):
        raise input_error(
            f"gradient descent in {mi.variant()}",
            "llvm_ad and cuda_ad variants",
            "Take route='linear', which needs no derivatives, or set another variant.",
        )
    names = [*images.names, "alpha"] if roughness else list(images.names)
    rates = {name: step * _STEPS.get(name, _STEP) for name in names}
    adam = mi.ad.Adam(lr=1.0)
    x, a = np.array(values, np.float64), float(alpha)
    for name in names:
        adam[name] = mi.Float(a) if name == "alpha" else mi.Float(x[images.names.index(name)])
        adam.set_learning_rate({name: rates[name]})
    best, best_at, since, factor = np.inf, (x.copy(), a), 0, 1.0
    done = 0
    while done < iterations:
        done += 1
        loss, gradient = loss_and_gradient(
            images, observed, x, a, spp=spp, seed=seed, roughness=roughness
        )
        since = since + 1 if loss > best * (1.0 - 1e-3) else 0
        if loss < best:
            best, best_at = loss, (x.copy(), a)
        if since >= 12:
            factor, since = 0.5 * factor, 0
            if factor < 0.02:
                break
            adam.set_learning_rate({name: factor * rate for name, rate in rates.items()})
        for name in names:
            dr.set_grad(adam[name], mi.Float(np.atleast_1d(gradient[name])))
        adam.step()
        for name in names:
            low, high = RANGES.get(name, (-np.inf, np.inf))
            value = np.clip(np.array(adam[name], np.float64), low, high)
            adam[name] = mi.Float(value)
            if name == "alpha":
                a = float(value[0])
            else:
                x[images.names.index(name)] = value
        if record is not None:
            record(x, a)
    return Descent(best_at[0], best_at[1], best, done, factor < 0.02)
