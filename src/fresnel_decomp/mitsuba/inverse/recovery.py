"""One call, three routes: what a uniform metal is made of, from images of it under known light."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._check import choose, input_error, is_real, is_whole
from ...basis import Basis, load_basis
from ...inverse_fit import PRIOR_DEVIATION, Solution, least_squares
from .calibration import calibrate, fit_channels
from .gradient import Descent, at_the_end, descend
from .images import KINDS, RANGES, Images, Setup, derived_seed, names_of, require_rgb
from .linear import LinearFit, Unknowns, solve_images
from .observed import Observed, observe
from .result import Recovered, Step, coefficients, indices
from .roughness import refine_roughness, search_roughness, solve_jointly

__all__ = ["ROUTES", "recover"]

Array = NDArray[np.float64]

ROUTES = ("linear", "gradient", "hybrid")

_SEARCH_SPP = 16
_WEIGHINGS = 5  # at most, until the descent no longer cares
_DIFFERENCES = {"eta": 0.02, "k": 0.02}  # steps of the last derivative; .01 else


def recover(
    images: Any,
    scenes: Setup | Sequence[Setup],
    parameters: str = "nodes",
    *,
    route: str = "linear",
    alpha: float | None = None,
    roughness: str | None = None,
    start: Mapping[str, Any] | None = None,
    basis: Basis | None = None,
    fresnel: str | None = None,
    distribution: str = "ggx",
    noise: Any = None,
    bounds: tuple[float, float] | None = (0.0, 1.05),
    spp: int | None = None,
    seed: int = 0,
    iterations: int | None = None,
    progress: Callable[[Step], None] | None = None,
) -> Recovered:
    """Recover a conductor from images of it under known light.

    Parameters
    ----------
    images : (height, width, 3) float array, or a sequence of them
        Linear RGB.
    scenes : callable, or one for each image
        Takes the dictionary of a BSDF and returns that of the scene in which the image was made,
        for `mi.load_dict`: camera, light and all other objects known. Its integrator says how
        often light may bounce (`max_depth`); Russian roulette is switched off.
    parameters : {"nodes", "coefficients", "indices", "gulbrandsen"}
        f0, f1, ... (reflectance at 0° and at the nodes; it is 1 at 90°), c0, c1, ... (without that
        condition, hence with one unknown more), (eta, k), or (r, g).
    route : {"linear", "gradient", "hybrid"}
        "linear": render the basis, solve, and from node colours find (eta, k) or (r, g). For known
        roughness. "hybrid": the same inside a search for roughness, then all together
        (Gauss-Newton). "gradient": quasi-Newton descent (L-BFGS-B) on the parameters themselves.
    alpha : float in [.005, 1], optional
        Roughness, or where its search starts (default .1).
    roughness : {"known", "unknown"}, optional
        "known" takes `alpha` as it is. Default "known" where `alpha` is given, but for "hybrid",
        which is for unknown roughness.
    start : mapping of names to numbers or (3,) arrays, optional
        Default .5, eta = 1.5, k = 3. Where "gradient" begins; what the images say nothing about
        keeps it. "alpha" in it counts before `alpha`, so that an interrupted descent goes on from
        the `values` of its last `Step`.
    basis : Basis, optional
        Default `load_basis()`.
    fresnel : {"decomposition", "exact"}, optional
        How (eta, k) and (r, g) make curves; default "exact" but for "gradient", where the fitted
        curves are what can be descended on (see the study). Node colours and coefficients are
        always decompositions.
    distribution : {"ggx", "beckmann"}
    noise : float, or arrays like the images, optional
        Standard deviation of each pixel. By default it is estimated from the images' residuals,
        spread over the pixels as the noise of our own renderings is.
    bounds : (low, high) or None
        Of the recovered curves between 0° and 90°, for the linear solves only. Metals stay below 1,
        but their colours need not (gold's red is 1.022), and a basis overshoots: hence 1.05.
    spp : int, optional
        Samples per pixel of our renderings, half of them in each of two; default 128, for
        "gradient" 32, taken anew for each gradient.
    seed : int
        Same seed, same result. It should not be the images' own.
    iterations : int, optional
        At most; default 6 linearisations, 200 gradients.
    progress : callable, optional
        Called with a `Step` after every iteration.

    Returns
    -------
    Recovered

    Raises
    ------
    InputError
        For images that do not fit the scenes, scenes without the conductor, or bad options.
    NonFiniteGradientError
        For a derivative that is not a number; it names the parameter.

    Notes
    -----
    Light that meets the conductor at most once makes images linear in f_i and c_i: one
    linearisation is the answer. With interreflection they are polynomials; `linear` then iterates,
    and `converged` says whether it ended. Node colours are calibrated: what least squares makes of
    the nearest exact conductor, whose node colours are known, is subtracted.

    Examples
    --------
    >>> import mitsuba as mi
    >>> mi.set_variant("scalar_rgb")
    >>> from fresnel_decomp.mitsuba import register
    >>> from fresnel_decomp.mitsuba.comparison import render_scene
    >>> from fresnel_decomp.mitsuba.inverse import recover
    >>> from fresnel_decomp.mitsuba.scenes import lit_object
    >>> register()
    >>> scene = lambda bsdf: lit_object(bsdf, {"type": "constant"}, size=12)
    >>> gold = {"type": "roughconductor", "material": "Au", "alpha": 0.1, "distribution": "ggx"}
    >>> image = render_scene(mi.load_dict(scene(gold)), spp=64, seed=1)
    >>> result = recover(image, scene, alpha=0.1, spp=32)
    >>> result.converged, result.values["f0"].round(1)
    (True, array([1. , 0.8, 0.3]))
    """
    choose("parameters", parameters, KINDS)
    choose("route", route, ROUTES)
    choose("distribution", distribution, ("ggx", "beckmann"))
    basis = basis or load_basis()
    exact_able = parameters in ("indices", "gulbrandsen")
    fresnel = fresnel or ("exact" if exact_able and route != "gradient" else "decomposition")
    choose("fresnel", fresnel, ("decomposition", "exact"))
    start = dict(start or {})
    alpha = start.pop("alpha", alpha)
    if roughness is None:
        roughness = "unknown" if alpha is None or route == "hybrid" else "known"
    choose("roughness", roughness, ("known", "unknown"))
    _check(parameters, route, alpha, roughness, fresnel, spp, seed, iterations)
    alpha = 0.1 if alpha is None else float(alpha)
    setups = [scenes] if callable(scenes) else list(scenes)
    names = names_of(parameters, basis.terms)
    first = _start(names, start)
    make: dict[str, Any] = {"distribution": distribution}
    if route == "gradient":
        made = Images(setups, parameters, basis, fresnel=fresnel, **make)
    else:
        made = Images(setups, "coefficients", basis, **make)
    observed = observe(images, made.sizes, noise)
    run = _Run(made, observed, parameters, basis, fresnel, distribution, seed, progress)
    if route == "gradient":
        return run.descent(first, alpha, roughness, spp or 32, iterations or 200)
    return run.linear(route, setups, first, alpha, roughness, bounds, spp or 128, iterations or 6)


def _check(
    parameters: str, route: str, alpha: Any, roughness: str, fresnel: str, spp: Any, seed: Any,
    iterations: Any,
) -> None:  # fmt: skip
    require_rgb()
    if fresnel == "exact" and parameters in ("nodes", "coefficients"):
        raise input_error(
            f"fresnel='exact' with parameters='{parameters}'",
            "'indices' or 'gulbrandsen'",
            "Reflectances do not determine an index of refraction.",
        )
    if route == "linear" and roughness == "unknown":
        raise input_error(
            "route='linear' with unknown roughness",
            "'hybrid' or 'gradient', or a number for alpha",
            "Images are not linear in roughness.",
        )
    if roughness == "known" and (alpha is None or route == "hybrid"):
        raise input_error(
            f"route='{route}', alpha={alpha} with known roughness",
            "'linear' or 'gradient' with a number for alpha",
            "With 'hybrid', alpha is where the search starts.",
        )
    if alpha is not None and not is_real(alpha, *RANGES["alpha"]):
        raise input_error(
            f"alpha={alpha!r}", "a number from 0.005 to 1", "Leave it out if you do not know it."
        )
    for name, value, least in (("spp", spp, 2), ("seed", seed, 0), ("iterations", iterations, 1)):
        if value is not None and not is_whole(value, least):
            raise input_error(f"{name}={value!r}", f"an integer >= {least}", "See `recover`.")


def _start(names: Sequence[str], given: Mapping[str, Any] | None) -> Array:
    """(n, 3) starting values."""
    default = {"eta": 1.5, "k": 3.0}
    values = {name: np.full(3, default.get(name, 0.5)) for name in names}
    for name, value in (given or {}).items():
        choose("start", name, names)
        low, high = RANGES.get(name, (-np.inf, np.inf))
        array = np.asarray(value, np.float64)
        if array.shape not in ((), (3,)) or not np.all((array >= low) & (array <= high)):
            raise input_error(
                f"start {name}={np.round(array, 6)}",
                f"a number or three, in [{low:g}, {high:g}]",
                "Three numbers stand for red, green and blue.",
            )
        values[name] = np.broadcast_to(array, 3).astype(np.float64)
    return np.stack([values[name] for name in names])


class _Run:
    """One call of `recover`."""

    def __init__(
        self, images: Images, observed: Observed, kind: str, basis: Basis, fresnel: str,
        distribution: str, seed: int, progress: Callable[[Step], None] | None,
    ) -> None:  # fmt: skip
        self.images, self.observed, self.kind, self.basis = images, observed, kind, basis
        self.fresnel, self.distribution, self.seed = fresnel, distribution, seed
        self.progress, self.history = progress, []
        self.others: list[Images] = []
        self.begun = time.perf_counter()

    history: list[Step]

    def _record(self, names: Sequence[str], x: Array, alpha: float) -> None:
        values = {name: row.copy() for name, row in zip(names, x, strict=True)}
        samples = self.images.samples + sum(other.samples for other in self.others)
        step = Step(time.perf_counter() - self.begun, samples, values | {"alpha": alpha})
        self.history.append(step)
        if self.progress is not None:
            self.progress(step)

    # --- linear and hybrid ---

    def linear(
        self, route: str, setups: Sequence[Setup], first: Array, alpha: float, roughness: str,
        bounds: tuple[float, float] | None, spp: int, iterations: int,
    ) -> Recovered:  # fmt: skip
        nodes = self.kind != "coefficients"
        inner = names_of("nodes" if nodes else "coefficients", self.basis.terms)
        start = np.full((len(inner), 3), 0.5) if nodes and self.kind != "nodes" else first
        unknowns = Unknowns.of(self.basis, nodes, bounds, start)
        options: dict[str, Any] = {
            "unknowns": unknowns,
            "record": lambda x, a: self._record(inner, x, a),
        }
        alpha_error, tried = 0.0, 0
        if roughness == "unknown":
            search = self.seed_for(0)
            alpha, tried = search_roughness(
                self.images, self.observed, spp=min(spp, _SEARCH_SPP), seed=search, alpha=alpha,
                **options,
            )  # fmt: skip
            alpha, alpha_error, fit = refine_roughness(
                self.images, self.observed, alpha, spp=spp, seed=self.seed_for(1),
                turns=iterations, **options,
            )  # fmt: skip
        else:
            fit = solve_images(
                self.images, self.observed, alpha, spp=spp, seed=self.seed_for(1),
                iterations=iterations, **options,
            )  # fmt: skip
        x = fit.x
        if nodes:
            exact = Images(
                setups, "indices", self.basis, fresnel="exact", distribution=self.distribution
            )
            self.others.append(exact)
            x = calibrate(
                exact, fit, self.observed, alpha, spp=spp, seed=self.seed_for(1),
                limits=unknowns.limits,
            )  # fmt: skip
            self._record(inner, x, alpha)
        values, errors = self._named(x, fit, inner, first)
        message = "" if fit.converged else "Not converged: raise iterations or spp."
        shown = self.images
        rows = coefficients(values, self.basis).T
        if self.fresnel == "exact":
            shown, rows = exact, np.stack(indices(values))
        half = max(1, spp // 2)
        seen = np.stack([shown.render(rows, alpha, half, own) for own in self.half_seeds()])
        return self._finish(
            route, values, errors, alpha, alpha_error, seen, fit.model.visible,
            tried + fit.iterations, fit.converged, message,
            np.array([s.constrained for s in fit.channels]),
        )  # fmt: skip

    def _named(
        self, x: Array, fit: LinearFit, inner: Sequence[str], first: Array
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Values and standard errors of the parameters asked for."""
        if self.kind in ("nodes", "coefficients"):
            errors = np.stack([s.standard_errors for s in fit.channels], axis=1)
            return (
                dict(zip(inner, x, strict=True)),
                dict(zip(inner, errors, strict=True)),
            )
        fits = fit_channels(x, fit.channels, self.kind, self.basis, first)
        names = names_of(self.kind, self.basis.terms)
        values = np.stack([f.values for f in fits], axis=1)
        errors = np.sqrt(np.stack([np.diag(f.covariance) for f in fits], axis=1))
        self._record(names, values, self.history[-1].values["alpha"])
        return (
            dict(zip(names, values, strict=True)),
            dict(zip(names, errors, strict=True)),
        )

    # --- gradient ---

    def descent(
        self, start: Array, alpha: float, roughness: str, spp: int, iterations: int
    ) -> Recovered:
        names = self.images.names
        free = roughness == "unknown"
        half = max(1, spp // 2)
        # the descent's own, so that Newton's step is 0 where its misfit is least
        seeds = self.half_seeds()
        x, done = start, 0
        for _ in range(_WEIGHINGS):  # noise is seen where it starts, and better where it ends
            self._weigh([self.images.render(x, alpha, half, own) for own in seeds])
            found: Descent = descend(
                self.images, self.observed, x, alpha, spp=half, seed=self.seed_for(1),
                roughness=free, iterations=iterations - done,
                record=lambda x, a: self._record(names, x, a),
            )  # fmt: skip
            x, alpha, done = found.values, found.alpha, done + found.iterations
            if not found.converged or found.fall < 0.1 or done == iterations:
                break
        halves: list[list[Array]] = [[], [], []]
        steps = np.array([_DIFFERENCES.get(name, 0.01) for name in names])
        inward = _inward(names, x, steps)
        for own in seeds:
            halves[0].append(self.images.render(x, alpha, half, own))
            halves[1].append(self.images.derivative(inward, alpha, half, own, steps))
            if free:
                halves[2].append(self.images.roughness_derivative(x, alpha, half, own))
        seen, columns = np.stack(halves[0]), np.stack(halves[1])
        visible = np.any(columns != 0.0, axis=(0, 2, 3))
        newton, errors, alpha_step, alpha_error = self._local(seen, columns, halves[2], visible, x)
        for i, name in enumerate(names):  # at the end of a range there is no going on
            low, high = RANGES.get(name, (-np.inf, np.inf))
            newton[i] = np.clip(x[i] + newton[i], low, high) - x[i]
        far = np.any(np.abs(newton) > 4.0 * errors + 0.02)
        far |= abs(alpha_step) > 4.0 * alpha_error + 0.1 * alpha
        ended = at_the_end(names, x)
        # what the descent left undone is unknown too
        errors, alpha_error = np.hypot(errors, newton), float(np.hypot(alpha_error, alpha_step))
        message = ""
        if not found.converged:
            message = "Not converged: raise iterations, or start elsewhere."
        elif far:
            message = (
                "Stuck: Newton's step is far longer than the standard errors. Start elsewhere."
            )
        elif ended:
            message = f"Stuck: {' and '.join(ended)} ran to the end of the range. Start elsewhere."
        return self._finish(
            "gradient", dict(zip(names, x, strict=True)), dict(zip(names, errors, strict=True)),
            alpha, alpha_error, seen, visible, done, found.converged and not far and not ended,
            message, np.zeros(3, bool),
        )  # fmt: skip

    def _weigh(self, seen: Sequence[Array]) -> None:
        mean = 0.5 * (seen[0] + seen[1])
        self.observed.weigh(seen[0] - seen[1], self.observed.values - mean)

    def _local(
        self, seen: Array, columns: Array, shared: list[Array], visible: Array, x: Array
    ) -> tuple[Array, Array, float, float]:
        """Newton's step from `x` (n, 3), standard errors, and both of alpha."""
        n = len(x)
        zero = np.zeros((n, 3))
        if shared:
            joint = solve_jointly(
                columns, seen, np.stack(shared), self.observed, visible, np.zeros(3 * n + 1)
            )
            errors = joint.standard_errors
            step = joint.x[:-1].reshape(3, n).T
            return step, errors[:-1].reshape(3, n).T, float(joint.x[-1]), float(errors[-1])
        weight = np.where(visible[:, None], self.observed.weight, 0.0)
        solutions: list[Solution] = [
            least_squares(
                columns[:, :, i], seen[:, :, i], self.observed.values[:, i], weight[:, i],
                zero[:, i],
            )
            for i in range(3)
        ]  # fmt: skip
        step = np.stack([s.x for s in solutions], axis=1)
        return step, np.stack([s.standard_errors for s in solutions], axis=1), 0.0, 0.0

    # --- both ---

    def seed_for(self, purpose: int) -> int:
        return derived_seed(self.seed, 77, purpose)

    def half_seeds(self) -> list[int]:
        """Those of the two renderings of the last solve."""
        return [derived_seed(self.seed_for(1), half) for half in (0, 1)]

    def _finish(
        self, route: str, values: dict[str, Any], errors: dict[str, Any], alpha: float,
        alpha_error: float, predicted: Array, visible: Array, iterations: int, converged: bool,
        message: str, constrained: NDArray[np.bool_],
    ) -> Recovered:  # fmt: skip
        noise, residual = self.observed.noise_and_residual(predicted.mean(axis=0), visible)
        identified = {
            name: np.asarray(errors[name]) < PRIOR_DEVIATION * _width(name) for name in errors
        }
        unknown = [name for name, known in identified.items() if not np.all(known)]
        if unknown and not message:
            message = (
                f"The images say little about {', '.join(unknown)}: see standard_errors. Add views "
                "or lights" + (", or start elsewhere." if route == "gradient" else ".")
            )
        samples = self.images.samples + sum(other.samples for other in self.others)
        return Recovered(
            self.kind,
            route,
            values | {"alpha": alpha},
            errors | {"alpha": alpha_error},
            identified | {"alpha": bool(alpha_error < PRIOR_DEVIATION)},
            coefficients(values, self.basis),
            alpha,
            residual,
            noise,
            iterations,
            samples,
            time.perf_counter() - self.begun,
            converged,
            message,
            constrained,
            self.fresnel,
            self.basis,
            self.distribution,
            tuple(self.history),
        )


def _width(name: str) -> float:
    """How far a parameter may reasonably range."""
    return {"eta": 5.0, "k": 8.0}.get(name, 1.0)


def _inward(names: Sequence[str], x: Array, steps: Array) -> Array:
    """The point next to `x` whose neighbours at `steps` are in range."""
    moved = x.copy()
    for i, name in enumerate(names):
        low, high = RANGES.get(name, (-np.inf, np.inf))
        moved[i] = np.clip(x[i], low + 1.001 * steps[i], high - 1.001 * steps[i])
    return moved
