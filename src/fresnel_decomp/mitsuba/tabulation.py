"""Functions of texture-valued parameters, computed when these are set and looked up when shading.

`tabulate((eta, k), function)` calls `function` once on all values that the textures can take: a
single colour, one value per nanometre (spectral variants), one per texel, or those of a
checkerboard's two fields. The lookup that it returns interpolates the *results*, which may be
negative, and carries gradients from them back to the textures' own parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from .._check import InputError, input_error
from ..colour import WAVELENGTH_NM  # Mitsuba's range, every nanometre
from .variants import unpolarized

__all__ = ["Lookup", "children", "direct", "stored_values", "tabulate"]


class Lookup(NamedTuple):
    """What shading evaluates.

    Attributes
    ----------
    evaluate : callable
        `evaluate(si, active)` gives one `UnpolarizedSpectrum` per result of the function.
    tables : list of Dr.Jit arrays and tensors
        What it reads. They carry the gradients: a differentiable operation that evaluates the
        lookup must know them as inputs, or forward mode may run it before they are computed.
    """

    evaluate: Callable[[Any, Any], list[Any]]
    tables: list[Any]


def direct(textures: Sequence[Any]) -> Lookup:
    """The textures' own values, without a table."""
    return Lookup(lambda si, active: [texture.eval(si, active) for texture in textures], [])


def tabulate(textures: dict[str, Any], function: Callable[..., Sequence[Any]]) -> Lookup:
    """Tabulate `function` over all values of `textures`.

    Parameters
    ----------
    textures : dict of name to mi.Texture
        Arguments of `function`. Uniform and spectral textures, bitmaps (those given together must
        agree in resolution, `to_uv`, `filter_type` and `wrap_mode`) and checkerboards of these.
        Beyond the wavelengths that all spectra cover, the value at the end of the range holds.
    function : callable
        Takes one flat Dr.Jit array per texture and returns a sequence of such arrays.

    Raises
    ------
    InputError
        For other textures, bitmaps that disagree, and colour bitmaps in spectral variants.
    """
    board = next((t for t in textures.values() if t.class_name() == "Checkerboard"), None)
    if board is not None:
        return _checkerboard(board, textures, function)
    bitmaps = {n: t for n, t in textures.items() if t.class_name().startswith("BitmapTexture")}
    for name, texture in textures.items():
        # by class: not every texture that varies over the surface says so (mesh attributes do not)
        if name not in bitmaps and not texture.class_name().endswith("Spectrum"):
            raise input_error(
                f"parameter '{name}' is a texture of type {texture.class_name()}",
                "uniform values, spectra, bitmaps and checkerboards",
                "Give the coefficients c0, c1, ... as textures instead: they can be of any type.",
            )
    if bitmaps:
        return _bitmap(bitmaps, textures, function)
    if mi.is_spectral and any(t.class_name() != "UniformSpectrum" for t in textures.values()):
        return _spectral(textures, function)
    values = [_spectrum(v) for v in function(*(_evaluate(t) for t in textures.values()))]
    dr.make_opaque(values)
    return Lookup(lambda si, active: values, values)


def children(node: Any) -> dict[str, Any]:
    """What a node of Mitsuba's scene graph shows to `traverse`, objects included, by name."""
    found = {}

    class Collect(mi.TraversalCallback):
        def put(self, name: str, value: Any, *_: Any) -> None:
            found[name] = value

    node.traverse(Collect())
    return found


def stored_values(texture: Any) -> list[Any]:
    """Numbers between which all values of a texture lie, as flat arrays without gradients.

    They are read rather than looked up where possible, which is cheap. There is one array for each
    part of the texture: the fields of a checkerboard, else the whole; None for parts whose values
    are known only at a surface point (mesh attributes, images of colours in spectral variants).
    """
    kind = texture.class_name()
    if kind == "Checkerboard":
        fields = children(texture)
        return stored_values(fields["color0"]) + stored_values(fields["color1"])
    if kind.startswith("BitmapTexture"):
        data = mi.traverse(texture)["data"]
        if mi.is_spectral and data.shape[2] != 1:
            return [None]
        texels = dr.detach(data.array)
        if dr.is_integral_v(texels):  # an 8-bit image that is kept as such
            texels = mi.TensorXf(texels).array / 255.0
        return [texels]
    if not kind.endswith("Spectrum"):
        return [None]
    if not mi.is_spectral or kind == "UniformSpectrum":
        return [dr.detach(_evaluate(texture))]
    covered = np.clip(WAVELENGTH_NM, *list(texture.wavelength_range()))
    return [dr.detach(_evaluate(texture, wavelengths=covered))]


def _channels() -> int:
    """Independent values in one evaluation of a texture that does not depend on wavelength."""
    return 1 if mi.is_spectral else dr.size_v(mi.UnpolarizedSpectrum)


def _spectrum(channels: Any) -> Any:
    """An `UnpolarizedSpectrum` from a flat array of its channels."""
    jit = dr.is_jit_v(mi.Float)
    values = [dr.gather(mi.Float, channels, i) if jit else channels[i] for i in range(_channels())]
    return unpolarized(values)


def _evaluate(texture: Any, uv: Any = ((0.5, 0.5),), wavelengths: Any = (550.0,)) -> Any:
    """Values at `uv` (n, 2) and `wavelengths` (n or 1), flat, the channel index fastest."""
    uv, wavelengths = np.broadcast_arrays(np.asarray(uv), np.asarray(wavelengths)[:, None])[:2]
    array = dr.array_t(mi.TensorXf)

    def interaction(uv: Any, wavelength: Any, size: int) -> Any:
        si = dr.zeros(mi.SurfaceInteraction3f, size)
        si.uv = uv
        if mi.is_spectral:
            si.wavelengths = type(si.wavelengths)(wavelength)
        return si

    if not dr.is_jit_v(mi.Float):
        flat = []
        for point, wavelength in zip(uv.tolist(), wavelengths[:, 0].tolist(), strict=True):
            value = texture.eval(interaction(mi.Point2f(point), wavelength, 1))
            flat += list(value)[: _channels()]
        return array(flat)
    size = len(uv)
    si = interaction(mi.Point2f(uv.T.astype(np.float32)), mi.Float(wavelengths[:, 0]), size)
    value = texture.eval(si) + dr.zeros(mi.UnpolarizedSpectrum, size)
    return value[0] if mi.is_spectral else dr.ravel(value)


def _tensor(values: Sequence[Any], shape: tuple[int, ...]) -> Any:
    """The tensor of `shape` + (channels of all values,)."""
    parts = [mi.TensorXf(value, (*shape, len(value) // int(np.prod(shape)))) for value in values]
    if dr.is_jit_v(mi.Float):
        return dr.concat(parts, axis=len(shape))
    return mi.TensorXf(np.concatenate([np.array(part) for part in parts], axis=len(shape)))


def _spectral(textures: dict[str, Any], function: Any) -> Lookup:
    ranges = np.array([list(texture.wavelength_range()) for texture in textures.values()])
    covered = np.clip(WAVELENGTH_NM, ranges[:, 0].max(), ranges[:, 1].min())
    values = function(*(_evaluate(t, wavelengths=covered) for t in textures.values()))
    table = mi.Texture1f(_tensor(values, covered.shape), use_accel=False)
    first, count = float(WAVELENGTH_NM[0]), len(WAVELENGTH_NM)

    def evaluate(si: Any, active: Any) -> list[Any]:
        rows = [table.eval((w - (first - 0.5)) / count, active) for w in si.wavelengths]
        return [unpolarized(column) for column in zip(*rows, strict=True)]

    return Lookup(evaluate, [table.tensor()])


def _bitmap(bitmaps: dict[str, Any], textures: dict[str, Any], function: Any) -> Lookup:
    first = next(iter(bitmaps.values()))
    matrix = _to_uv(first)
    width, height = (int(n) for n in first.resolution())
    for name, texture in bitmaps.items():
        if tuple(texture.resolution()) != (width, height) or np.any(_to_uv(texture) != matrix):
            raise _disagree(bitmaps, f"'{name}' has another resolution or to_uv than the first")
    if mi.is_spectral:
        for name, texture in textures.items():
            if (name in bitmaps and mi.traverse(texture)["data"].shape[2] != 1) or (
                name not in bitmaps and texture.class_name() != "UniformSpectrum"
            ):
                raise input_error(
                    f"in {mi.variant()}, '{name}' varies both with wavelength and over the surface",
                    "bitmaps of one channel, with uniform values beside them",
                    "Use an RGB variant for colour bitmaps.",
                )

    def centres(shift: tuple[float, float]) -> np.ndarray:
        """Surface coordinates of all texel centres, moved by `shift` texels."""
        y, x = np.mgrid[:height, :width].reshape(2, -1) + 0.5
        image = np.stack([(x + shift[0]) / width, (y + shift[1]) / height, np.ones_like(x)])
        return (np.linalg.inv(matrix) @ image)[:2].T

    def table(values: Sequence[Any], filter_mode: Any, wrap_mode: Any) -> Any:
        tensor = _tensor(values, (height, width))
        texture = mi.Texture2f(tensor, False, True, filter_mode, wrap_mode)
        (a, b, u0), (c, d, v0) = matrix[:2].tolist()

        def at(uv: Any, active: Any = True) -> Any:
            u, v = dr.fma(a, uv.x, dr.fma(b, uv.y, u0)), dr.fma(c, uv.x, dr.fma(d, uv.y, v0))
            return texture.eval(mi.Point2f(u, v), active)

        return at, texture.tensor()

    texels = {name: _evaluate(texture, centres((0.0, 0.0))) for name, texture in textures.items()}
    with dr.suspend_grad():
        modes = _modes(bitmaps, texels, centres, table)
    stored, tensor = table(function(*texels.values()), *modes)

    def evaluate(si: Any, active: Any) -> list[Any]:
        values, n = list(stored(si.uv, active)), _channels()
        return [unpolarized(values[i : i + n]) for i in range(0, len(values), n)]

    return Lookup(evaluate, [tensor])


def _modes(bitmaps: dict[str, Any], texels: dict[str, Any], centres: Any, table: Any) -> Any:
    """Filter and wrap mode of the bitmaps, found by trial: Mitsuba does not tell them.

    Each pair of modes is compared with the texture a quarter texel off the centres, inside and one
    period outside the image; modes that nothing distinguishes give the same lookups.
    """
    filters, wraps = dr.FilterMode, dr.WrapMode
    modes = list(
        product((filters.Linear, filters.Nearest), (wraps.Repeat, wraps.Clamp, wraps.Mirror))
    )
    errors = np.zeros(len(modes))
    for name, texture in bitmaps.items():
        width, height = (int(n) for n in texture.resolution())
        shifts = [(0.25, 0.25), (width + 0.25, 0.25), (0.25, height + 0.25)]
        step = max(1, width * height // 4096)
        uv = np.concatenate([centres(shift)[::step] for shift in shifts])
        values, seen = dr.detach(texels[name]), np.array(_evaluate(texture, uv))
        scale = np.ptp(np.array(values)) or 1.0
        for i, mode in enumerate(modes):
            found = _values(table([values], *mode)[0], uv)
            errors[i] = max(errors[i], np.abs(found - seen).max() / scale)
    best = int(np.argmin(errors))
    if errors[best] > 0.02:  # hardware interpolation has 8-bit weights
        raise _disagree(bitmaps, "no filter_type and wrap_mode fits them all")
    return modes[best]


def _values(at: Any, uv: np.ndarray) -> np.ndarray:
    """A table's values at `uv`, flat, the channel index fastest."""
    if dr.is_jit_v(mi.Float):
        return np.array(at(mi.Point2f(uv.T.astype(np.float32)))).T.ravel()
    return np.array([list(at(mi.Point2f(point))) for point in uv.tolist()]).ravel()


def _disagree(bitmaps: dict[str, Any], why: str) -> InputError:
    return input_error(
        f"the bitmaps {' and '.join(bitmaps)} do not fit together: {why}",
        "bitmaps of one resolution, to_uv, filter_type and wrap_mode",
        "Resample them, or give the coefficients c0, c1, ... as textures.",
    )


def _checkerboard(board: Any, textures: dict[str, Any], function: Any) -> Lookup:
    def fields(texture: Any) -> tuple[Any, Any]:
        same = texture.class_name() == "Checkerboard" and not np.any(_to_uv(texture) != matrix)
        inner = children(texture) if same else {}
        return inner.get("color0", texture), inner.get("color1", texture)

    matrix = _to_uv(board)
    pairs = {name: fields(texture) for name, texture in textures.items()}
    lookups = [tabulate({n: pair[i] for n, pair in pairs.items()}, function) for i in (0, 1)]
    to_uv = mi.ScalarTransform3f(matrix)
    which = mi.load_dict({"type": "checkerboard", "color0": 0.0, "color1": 1.0, "to_uv": to_uv})

    def evaluate(si: Any, active: Any) -> list[Any]:
        second = which.eval(si, active)[0] > 0.5  # not eval_1: it swaps the two colours (3.9.1)
        zero, one = (lookup.evaluate(si, active) for lookup in lookups)
        return [dr.select(second, b, a) for a, b in zip(zero, one, strict=True)]

    return Lookup(evaluate, lookups[0].tables + lookups[1].tables)


def _to_uv(texture: Any) -> np.ndarray:
    return np.array(mi.traverse(texture)["to_uv"].matrix)
