"""From every parametrization of reflectance to every other, with the loss stated.

All ways lead through the curve: a source is anything that gives reflectance for a cosine, a target
is made from reflectances at a few angles, and the loss compares the two curves. Only between
(eta, k) and (r, g) is there a way without a loss of digits, which is taken instead.

- "indices": `Exact(eta, k)`, from r and g;
- "gulbrandsen": `Gulbrandsen(r, g)`, from F0 and the reflectance at cos = 1/7, which rises with g;
- "linear_tint": `LinearTint(r, beta, basis)`, from coefficients, between those of g = 0 and g = 1
  by least squares of the reflectance over cosines;
- "f82": `F82(f0, f82)`, from F0 and the reflectance at cos = 1/7; "f82_tint" is the same with
  `tint` in [0, 1], as OpenPBR stores it;
- "nodes": `NodeColours(f0, f_nodes, basis)`, from F0 and the reflectances at the nodes;
- "coefficients": `Decomposition(coefficients, basis)`, from the same;
- "metallic_base": `MetallicBase(base_colour, metallic)`, from F0.

Parameters have the shape of the source's, channels last if there are any.
"""

from __future__ import annotations

import reprlib
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from ._arguments import without_axes
from ._array import detached, drjit_module, is_drjit, is_recording, ops_for
from ._check import choose, input_error, is_real
from ._edge_tint import TOLERANCE, edge_tint
from ._schlick import schlick
from .basis import Basis, load_basis
from .models import F82, Decomposition, Exact, Gulbrandsen, Model
from .parametrization import F82_COSINE, gulbrandsen_to_ior, ior_to_gulbrandsen
from .representations import DIELECTRIC_F0, LinearTint, MetallicBase, NodeColours, tint_ends

__all__ = ["LARGEST_R", "TARGETS", "Converted", "Loss", "convert", "loss"]

TARGETS = (
    "indices",
    "gulbrandsen",
    "linear_tint",
    "f82",
    "f82_tint",
    "nodes",
    "coefficients",
    "metallic_base",
)

LARGEST_R = 1.0 - 1e-5
"""What stands for a reflectivity of 1 or more, which has no finite index of refraction."""

NoCounterpart = Literal["raise", "nearest"]


class Loss(NamedTuple):
    """How far the converted curve is from the source's, over 0° to 90° in steps of half a degree.

    Attributes
    ----------
    max, rmse : (...) float
        Of the reflectance, one for each channel.
    delta_e_mean, delta_e_max : (...) float or None
        CIEDE2000 of RGB triples, where the last axis has three entries; one for each triple.
    """

    max: Any
    rmse: Any
    delta_e_mean: Any = None
    delta_e_max: Any = None


@dataclass(frozen=True, eq=False)
class Converted:
    """What `convert` returns.

    Attributes
    ----------
    value : Model
        The parameters, which can be called with a cosine.
    loss : Loss or None
        None while Dr.Jit records, when there are no values.
    moved : (...) bool
        Where the source has no counterpart and the nearest one was taken.
    """

    value: Any
    loss: Loss | None
    moved: Any


def convert(
    source: Model,
    to: str,
    *,
    basis: Basis | None = None,
    no_counterpart: NoCounterpart = "raise",
    metallic: float = 1.0,
) -> Converted:
    """Convert one parametrization to another, per channel.

    Parameters
    ----------
    source : model
        Of `models` or `representations`; its parameters (...) may be floats, NumPy arrays or
        Dr.Jit arrays. `Curve` makes a source of any function. RGB triples are the last axis.
    to : one of `TARGETS`
        See the module.
    basis : Basis
        For the targets that have one; default the source's, else `load_basis()`.
    no_counterpart : {"raise", "nearest"}
        About values that the target cannot express: |eta + i k| < 1 or F0 >= 1 as (r, g), curves
        beyond g or beta in [0, 1], a tint above 1, a base colour outside [0, 1], total internal
        reflection in a basis. "nearest" moves the parameter to the end of its range and keeps the
        others.
    metallic : float in (0, 1]
        For "metallic_base".

    Returns
    -------
    Converted
        Differentiable in Dr.Jit wherever the way is smooth: nowhere but at the ends of ranges is
        it not. Towards "indices" and "gulbrandsen", from others than these two, an equation is
        solved on the values and its derivative attached, which does not work while Dr.Jit records.

    Raises
    ------
    InputError
        For a source that is no model, an unknown target, and values without a counterpart unless
        "nearest" is chosen.

    Examples
    --------
    >>> from fresnel_decomp import F82, Exact
    >>> from fresnel_decomp.converters import convert
    >>> gold = Exact([0.183, 0.422, 1.373], [3.424, 2.346, 1.770])
    >>> result = convert(gold, "f82")
    >>> result.value.tint.round(3)
    array([0.983, 1.   , 0.994])
    >>> round(float(result.loss.delta_e_mean), 2)
    0.36
    """
    _check_model(source)
    choose("to", to, TARGETS)
    choose("no_counterpart", no_counterpart, ("raise", "nearest"))
    if not (is_real(metallic, 0.0, 1.0) and metallic > 0.0):
        raise input_error(
            f"metallic={metallic!r}", "a number in (0, 1]", "At 0 the base colour says nothing."
        )
    if basis is None:
        basis = getattr(source, "basis", None) or load_basis()
    make: dict[str, Callable[..., tuple[Any, _Moves]]] = {
        "indices": _indices,
        "gulbrandsen": _gulbrandsen,
        "linear_tint": _linear_tint,
        "f82": _f82,
        "f82_tint": _f82_tint,
        "nodes": _nodes,
        "coefficients": _coefficients,
        "metallic_base": lambda curve, basis: _metallic_base(curve, metallic),
    }
    value, moves = make[to](source, basis)
    if no_counterpart == "raise":
        for words, where, advice in moves:
            if _any(where):
                raise input_error(
                    f"{words}, as '{to}'", "values that it can express", f"{advice}, or choose "
                    "no_counterpart='nearest'."
                )  # fmt: skip
    moved: Any = False
    for _, where, _ in moves:
        moved = where | moved
    return Converted(value, None if is_recording() else loss(source, value), moved)


def loss(source: Model, value: Model) -> Loss:
    """How far one model is from another of the same shape; see `Loss`.

    Dr.Jit arrays are compared by value, without gradients and without colours, since they have no
    axis for the channels.

    Raises
    ------
    InputError
        For something that is no model.

    Examples
    --------
    >>> from fresnel_decomp import Exact, Schlick
    >>> from fresnel_decomp.converters import loss
    >>> round(float(loss(Exact(1.5), Schlick(0.04)).max), 3)
    0.036
    """
    _check_model(source)
    _check_model(value)
    drjit_input = any(is_drjit(x) for model in (source, value) for x in _parameters(model))
    source, value = _in_numpy(source), _in_numpy(value)
    dimensions = max(np.ndim(source(1.0)), np.ndim(value(1.0)))
    cos_theta = np.sin(np.radians(np.linspace(90.0, 0.0, 181)))
    cos_theta = cos_theta.reshape(-1, *[1] * dimensions)
    a, b = np.broadcast_arrays(source(cos_theta), value(cos_theta))
    error = np.abs(a - b)
    largest, rmse = error.max(axis=0), np.sqrt((error * error).mean(axis=0))
    if error.ndim < 2 or error.shape[-1] != 3 or drjit_input:
        return Loss(largest, rmse)
    from .colour import delta_e_2000

    delta_e = delta_e_2000(a, b)
    return Loss(largest, rmse, delta_e.mean(axis=0), delta_e.max(axis=0))


# --- to each target ------------------------------------------------------------------------------

_Moves = list[tuple[str, Any, str]]
"""What has no counterpart, in words; where that is so; what to do about it."""


def _indices(source: Any, basis: Basis) -> tuple[Exact, _Moves]:
    if isinstance(source, Exact):
        return source, []
    model, moves = _gulbrandsen(source, basis)
    return Exact(*gulbrandsen_to_ior(model.r, model.g)), moves


def _gulbrandsen(source: Any, basis: Basis) -> tuple[Gulbrandsen, _Moves]:
    if isinstance(source, Gulbrandsen):
        return source, []
    if isinstance(source, Exact):
        r, g = ior_to_gulbrandsen(source.eta, source.k)
        # the closest representable r is 1 for indices beyond about 1e8
        moves = [("|eta + i k| < 1", g > 1.0 + TOLERANCE, "Take 'coefficients'")]
        return Gulbrandsen(_clip(r, 0.0, LARGEST_R), _clip(g, 0.0, 1.0)), moves
    r, moves = _reflectivity(source(1.0))
    g, beyond = edge_tint(r, source(F82_COSINE))
    moves.append(
        ("a reflectance at cos = 1/7 beyond g = 0 or g = 1", beyond, "Take 'coefficients'")
    )
    return Gulbrandsen(r, g), moves


def _linear_tint(source: Any, basis: Basis) -> tuple[LinearTint, _Moves]:
    if isinstance(source, LinearTint) and source.basis is basis:
        return source, []
    curve, moves = _coefficients(source, basis)
    c = _columns(curve.coefficients)
    r, more = _reflectivity(c[0])
    untinted, tinted = (_columns(end) for end in tint_ends(r, basis))
    # least squares of the reflectance over cosines; b_0 and b_1 have the same coefficients
    gram = _gram(basis)
    change = [b - a for a, b in zip(untinted[2:], tinted[2:], strict=True)]
    rest = [x - a for x, a in zip(c[2:], untinted[2:], strict=True)]
    square, product = _inner(gram, change, change), _inner(gram, change, rest)
    ops = ops_for(square, product)
    known = square > 1e-12  # at r = 0 all beta are one curve
    beta = product / ops.select(known, square, 1.0)
    beta = ops.select(known, beta, 0.0)
    beyond = (beta < -TOLERANCE) | (beta > 1.0 + TOLERANCE)
    moves += [*more, ("a curve beyond g = 0 or g = 1", beyond, "Take 'coefficients'")]
    return LinearTint(r, _clip(beta, 0.0, 1.0), basis), moves


def _f82(source: Any, basis: Basis) -> tuple[F82, _Moves]:
    return F82(source(1.0), source(F82_COSINE)), []


def _f82_tint(source: Any, basis: Basis) -> tuple[F82, _Moves]:
    f0, f82 = source(1.0), source(F82_COSINE)
    tint = f82 / schlick(f0, F82_COSINE)
    moves: _Moves = [
        ("an F82 tint above 1", tint > 1.0 + TOLERANCE, "Take 'f82'"),
        ("an F82 tint below 0", tint < -TOLERANCE, "Take 'f82'"),
    ]
    return F82.from_tint(f0, _clip(tint, 0.0, 1.0)), moves


def _nodes(source: Any, basis: Basis) -> tuple[NodeColours, _Moves]:
    f0 = source(1.0)
    values = [source(float(np.cos(node))) for node in basis.nodes]
    if not is_drjit(f0, *values):
        f0, *values = np.broadcast_arrays(f0, *values)
        f0, values = f0[()], np.stack(values, axis=-1)  # type: ignore[assignment]
    return NodeColours(f0, values, basis), _poor_fit(source, basis)


def _coefficients(source: Any, basis: Basis) -> tuple[Decomposition, _Moves]:
    if isinstance(source, Decomposition) and source.basis is basis and source.substitute is None:
        return source, []
    if isinstance(source, LinearTint | NodeColours) and source.basis is basis:
        return Decomposition(source.coefficients, basis), []
    nodes, moves = _nodes(source, basis)
    return Decomposition(nodes.coefficients, basis), moves


def _metallic_base(source: Any, metallic: float) -> tuple[MetallicBase, _Moves]:
    f0 = source(1.0)
    colour = (f0 - DIELECTRIC_F0 * (1.0 - metallic)) / metallic
    beyond = (colour < -TOLERANCE) | (colour > 1.0 + TOLERANCE)
    moves: _Moves = [("a base colour outside [0, 1]", beyond, "Take 'coefficients'")]
    return MetallicBase(_clip(colour, 0.0, 1.0), metallic), moves


# --- steps on the way ----------------------------------------------------------------------------


def _poor_fit(source: Any, basis: Basis) -> _Moves:
    if not isinstance(source, Exact) or is_recording():
        return []
    exact = _in_numpy(source)
    where = basis.poor_fit(exact.eta, exact.k)
    return [("total internal reflection, which no basis follows", where, "Keep 'indices'")]


def _reflectivity(f0: Any) -> tuple[Any, _Moves]:
    beyond = (f0 >= 1.0) | (f0 < 0.0)
    moves: _Moves = [("F0 outside [0, 1)", beyond, "Take 'coefficients' or 'nodes'")]
    return _clip(f0, 0.0, LARGEST_R), moves


def _gram(basis: Basis) -> np.ndarray:
    """Mean products of b_2, b_3, ... over cosines."""
    functions = basis((np.arange(512) + 0.5) / 512.0)[:, 2:]
    return functions.T @ functions / len(functions)


def _inner(gram: np.ndarray, a: list[Any], b: list[Any]) -> Any:
    return sum(float(gram[i, j]) * (x * y) for i, x in enumerate(a) for j, y in enumerate(b))


def _columns(coefficients: Any) -> list[Any]:
    """One array for each coefficient."""
    if isinstance(coefficients, tuple | list):
        return list(coefficients)
    values = np.asarray(coefficients)
    return [values[..., i] for i in range(values.shape[-1])]


def _clip(value: Any, low: float, high: float) -> Any:
    if is_drjit(value):
        dr = drjit_module()
        assert dr is not None
        # not dr.clip: it has no gradient at the ends themselves
        return dr.select(value < low, low, dr.select(value > high, high, value))
    return without_axes(np.clip(value, low, high), True)


def _any(where: Any) -> bool:
    if is_drjit(where) and is_recording():
        return False
    return bool(np.any(detached(where)))


def _check_model(model: Any) -> None:
    if isinstance(model, type) or not (is_dataclass(model) and callable(model)):
        raise input_error(
            f"{reprlib.repr(model)} as a model of reflectance",
            "an object of `models` or `representations`, such as Exact(eta, k) or Schlick(f0)",
            "Wrap a function of the cosine in Curve(function).",
        )


def _parameters(model: Any) -> list[Any]:
    found: list[Any] = []
    for field in fields(model):
        value = getattr(model, field.name)
        found += value if isinstance(value, tuple | list) else [value]
    return found


def _in_numpy(model: Any) -> Any:
    """The model with NumPy arrays in place of Dr.Jit arrays."""
    changed = {}
    for field in fields(model):
        value = getattr(model, field.name)
        if isinstance(value, tuple | list) and is_drjit(*value):
            changed[field.name] = np.stack(
                np.broadcast_arrays(*(np.asarray(detached(x), np.float64) for x in value)), axis=-1
            )
        elif is_drjit(value):
            changed[field.name] = np.asarray(detached(value), np.float64)
        elif isinstance(value, list | np.ndarray):
            changed[field.name] = np.asarray(value, np.float64)
    return type(model)(
        **{f.name: changed.get(f.name, getattr(model, f.name)) for f in fields(model)}
    )
