"""The full-screen pass that `bench_gpu.py` times: a G-buffer, material textures, the shaders.

Every pixel shows a surface: balls on a floor, from smooth at the left to rough at the right. The
G-buffer is made with NumPy and not traced, so that a GPU without ray tracing will do. The shader is
`split_sum.shade` of the library, with the light and the preintegrated table in textures. All that
it computes is computed again in NumPy, in float64, by code that shares no texture with it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fresnel_decomp import AlbedoTable, Basis, conductor, load_basis, load_material
from fresnel_decomp.parametrization import gulbrandsen_to_ior, ior_to_gulbrandsen
from fresnel_decomp.subjects import from_gulbrandsen

Array = NDArray[Any]

EDGE_TINT = {"r": (0.44, 0.44, 0.44), "g": (0.0, 1.0, 0.0)}
"""The uniform material: Gulbrandsen's parameters of the talk's Figure 2."""
METALS = ("Au", "Cu", "Be", "Cr", "W", "TiN")
"""What the textures are mixed of."""

_EYE = np.array([0.0, 3.7, 5.6])
_TARGET = np.array([0.0, 0.25, 0.15])
_HALF_WIDTH = np.tan(np.radians(23.0))  # of the picture, at distance 1
_RADIUS, _SPACING = 0.5, 1.12
_COLUMNS, _ROWS = 6, 7
_TILES = 0.17  # textures a unit of length


# --- what is seen --------------------------------------------------------------------------------


def _camera() -> tuple[Array, Array, Array]:
    """Unit vectors to the right, up, and forward."""
    forward = (_TARGET - _EYE) / np.linalg.norm(_TARGET - _EYE)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward), forward


@dataclass(frozen=True, eq=False)
class Screen:
    """What a deferred renderer has of every pixel, in rows from the top left.

    Attributes
    ----------
    width, height : int
    normal : (n, 3) float32
    alpha : (n,) float32
    uv : (n, 2) float32, texture coordinates, which repeat
    """

    width: int
    height: int
    normal: Array
    alpha: Array
    uv: Array

    @property
    def view(self) -> Array:
        """(n, 3) float64 unit vectors to the camera, which no G-buffer stores."""
        return -_rays(self.width, self.height)


def _rays(width: int, height: int) -> Array:
    x = (2.0 * (np.arange(width) + 0.5) / width - 1.0) * _HALF_WIDTH
    y = (1.0 - 2.0 * (np.arange(height) + 0.5) / height) * _HALF_WIDTH * height / width
    right, up, forward = _camera()
    rays = (x[:, None] * right + y[:, None, None] * up + forward).reshape(-1, 3)
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def make_screen(width: int, height: int) -> Screen:
    """The G-buffer of rows of balls on a floor that fills the picture."""
    rays = _rays(width, height)
    if rays[:, 1].max() >= -0.05:
        raise ValueError(f"{width} x {height}: the floor does not fill so tall a picture")
    distance = -_EYE[1] / rays[:, 1]
    normal = np.broadcast_to([0.0, 1.0, 0.0], rays.shape).copy()
    floor = _EYE + distance[:, None] * rays
    rough = 0.32 + 0.12 * np.sin(3.1 * floor[:, 0]) * np.sin(2.7 * floor[:, 2])
    for column in range(_COLUMNS):
        for row in range(_ROWS):
            x, z = (i - 0.5 * (n - 1) for i, n in ((column, _COLUMNS), (row, _ROWS)))
            centre = np.array([_SPACING * x, _RADIUS, _SPACING * (z - 0.5)])
            towards = rays @ (_EYE - centre)
            root = towards**2 - ((_EYE - centre) @ (_EYE - centre) - _RADIUS**2)
            near = -towards - np.sqrt(np.maximum(root, 0.0))
            hit = (root > 0.0) & (near < distance)
            distance[hit] = near[hit]
            normal[hit] = (_EYE + near[hit, None] * rays[hit] - centre) / _RADIUS
            rough[hit] = 0.06 + 0.88 * column / (_COLUMNS - 1)
    point = _EYE + distance[:, None] * rays
    uv = _TILES * point[:, [0, 2]]
    normal, alpha, uv = (v.astype(np.float32) for v in (normal, rough**2, uv))
    return Screen(width, height, normal, alpha, uv)


# --- what it is made of --------------------------------------------------------------------------


def _mixture(size: int) -> Array:
    """(size, size, metals) float64 weights that sum to 1: patches with soft edges, which tile."""
    random = np.random.default_rng(5)
    place = 2.0 * np.pi * (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(place, place)
    heights = []
    for _ in METALS:
        waves = 0.0
        for _ in range(6):
            turns = random.integers(-3, 4, 2)
            waves = waves + np.cos(turns[0] * u + turns[1] * v + 2.0 * np.pi * random.random())
        heights.append(waves)
    grown = np.exp(4.0 * np.stack(heights, axis=-1))
    return grown / grown.sum(axis=-1, keepdims=True)


@dataclass(frozen=True, eq=False)
class Materials:
    """The uniform material and the textures, as each model stores them.

    A mixture of metals has the mixture of their reflectances, and so of their F0 and of their
    coefficients: exact albedos of textured pixels are mixtures of those of the metals.

    Attributes
    ----------
    basis : Basis
    f0, coefficients : (3,) and (3, terms) float64
        Of the uniform material, by channel.
    f0_map, coefficient_map, r_map, g_map : (size, size, 3[, terms]) float32
    mixture : (size, size, metals) float32
    exact, exact_metals : AlbedoTable of three terms: red, green, blue, and one per metal
    schlick_table, table : AlbedoTable of two terms, and of the basis
    """

    basis: Basis
    f0: Array
    coefficients: Array
    f0_map: Array
    coefficient_map: Array
    r_map: Array
    g_map: Array
    mixture: Array
    exact: AlbedoTable
    exact_metals: tuple[AlbedoTable, ...]
    schlick_table: AlbedoTable
    table: AlbedoTable


@functools.cache
def make_materials(recipe: str, texture_size: int, table_size: int = 64) -> Materials:
    """Bake everything; it takes some seconds."""
    basis = load_basis(recipe, 4)
    tint = from_gulbrandsen(EDGE_TINT["r"], EDGE_TINT["g"])
    metals = [load_material(name) for name in METALS]
    mixture = _mixture(texture_size).astype(np.float32)
    parameters = [ior_to_gulbrandsen(*metal.rgb_indices()) for metal in metals]

    def mixed(values: Any) -> Array:
        return np.tensordot(mixture, np.array(values), 1).astype(np.float32)

    def baked(f: Any) -> AlbedoTable:
        return AlbedoTable.bake(f, table_size)

    return Materials(
        basis,
        conductor(1.0, tint.eta, tint.k),
        basis.coefficients(tint.eta, tint.k),
        mixed([metal.rgb_reflectance(1.0) for metal in metals]),
        mixed([metal.rgb_coefficients(basis) for metal in metals]),
        *(mixed(values) for values in zip(*parameters, strict=True)),
        mixture,
        baked(lambda c: conductor(c[:, None], tint.eta, tint.k)),
        tuple(baked(metal.rgb_reflectance) for metal in metals),
        baked(lambda c: np.stack([1.0 - (1.0 - c) ** 5, (1.0 - c) ** 5], axis=-1)),
        baked(basis),
    )


def node_reflectance(basis: Basis, r: Any, g: Any) -> list[Any]:
    """Exact reflectances at the nodes of a basis, from Gulbrandsen's parameters."""
    eta, k = gulbrandsen_to_ior(r, g)
    return [conductor(float(np.cos(node)), eta, k, precision="native") for node in basis.nodes]


# --- the shaders ---------------------------------------------------------------------------------

UNIFORM = ("Schlick, uniform", "four terms, uniform")
TEXTURED = ("Schlick, textured", "four terms, textured", "four terms, (r, g) textured")
PASSES = (*UNIFORM, *TEXTURED)
PARTS = ("G-buffer and output", "and light", "and table of two terms", "and table of four terms")
"""Passes cut short, to see what each part takes."""
FETCHES = {
    "Schlick, uniform": "light, table (2)",
    "four terms, uniform": "light, table (4)",
    "Schlick, textured": "light, table (2), 1 map",
    "four terms, textured": "light, table (4), 3 maps",
    "four terms, (r, g) textured": "light, table (4), 2 maps",
}


class Shaders:
    """The screen and all textures in memory of the active variant, and a function for each pass.

    Parameters
    ----------
    screen, materials
    light : PrefilteredLight
        All maps of one size.
    use_accel : bool
        Let texture units filter, on a GPU.
    """

    def __init__(
        self, screen: Screen, materials: Materials, light: Any, use_accel: bool = False
    ) -> None:
        import drjit as dr
        import mitsuba as mi

        from fresnel_decomp._array import drjit_constant
        from fresnel_decomp.mitsuba.albedo_texture import AlbedoTexture
        from fresnel_decomp.mitsuba.light_texture import LightTexture

        self._screen, self._basis = screen, materials.basis
        self._light = LightTexture(light, use_accel=use_accel)
        self._tables = {
            "two": AlbedoTexture(materials.schlick_table, use_accel),
            "four": AlbedoTexture(materials.table, use_accel),
        }

        def texture(values: Array) -> Any:
            padded = np.pad(values, ((0, 0), (0, 0), (0, 4 - values.shape[2])))
            return mi.Texture2f(
                mi.TensorXf(np.ascontiguousarray(padded)),
                use_accel=use_accel,
                filter_mode=dr.FilterMode.Linear,
                wrap_mode=dr.WrapMode.Repeat,
            )

        self._maps = {
            "f0": texture(materials.f0_map),
            "r": texture(materials.r_map),
            "g": texture(materials.g_map),
            **{f"channel {c}": texture(materials.coefficient_map[:, :, c]) for c in range(3)},
        }

        def columns(values: Array) -> list[Any]:
            return [drjit_constant(mi.Float, column) for column in values.T]

        self._normal, self._uv = columns(screen.normal), columns(screen.uv)
        self._alpha = drjit_constant(mi.Float, screen.alpha)

        # as a shader has them: neither compiled in nor read for every pixel
        def uniform(value: float) -> Any:
            return dr.opaque(mi.Float, float(value))

        self._f0 = [uniform(value) for value in materials.f0]
        self._coefficients = [[uniform(c) for c in row] for row in materials.coefficients]
        self._index = dr.arange(mi.UInt32, screen.width * screen.height)
        dr.eval(self._index)

    def __call__(self, name: str) -> tuple[Any, Any, Any]:
        """The picture of a pass, or of a part of one: three arrays, not evaluated yet."""
        if name in PARTS:
            return self._part(PARTS.index(name))
        from fresnel_decomp.mitsuba.split_sum import shade

        albedo = getattr(self, _METHODS[name])
        return shade(self._light, albedo, self._normal, self._view(), self._alpha)

    def _view(self) -> list[Any]:
        import drjit as dr
        import mitsuba as mi

        width, height = self._screen.width, self._screen.height
        row = self._index // width
        column = self._index - row * width
        slope = 2.0 * _HALF_WIDTH / width
        x = dr.fma(mi.Float(column), slope, 0.5 * slope - _HALF_WIDTH)
        y = dr.fma(mi.Float(row), -slope, (0.5 * height - 0.5) * slope)
        axes = zip(*_camera(), strict=True)
        ray = [dr.fma(x, float(r), dr.fma(y, float(u), float(f))) for r, u, f in axes]
        scale = -dr.rsqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2])
        return [part * scale for part in ray]

    # albedos: functions of the cosine and the roughness

    def _schlick(self, mu: Any, alpha: Any) -> Any:
        first, second = self._tables["two"].lookup(mu, alpha)
        return tuple(f0 * first + second for f0 in self._f0)

    def _schlick_map(self, mu: Any, alpha: Any) -> Any:
        first, second = self._tables["two"].lookup(mu, alpha)
        return tuple(f0 * first + second for f0 in self._fetch("f0")[:3])

    def _terms(self, mu: Any, alpha: Any) -> Any:
        functions = self._tables["four"].lookup(mu, alpha)
        return tuple(_sum(row, functions) for row in self._coefficients)

    def _terms_map(self, mu: Any, alpha: Any) -> Any:
        functions = self._tables["four"].lookup(mu, alpha)
        return tuple(_sum(self._fetch(f"channel {c}"), functions) for c in range(3))

    def _tint_map(self, mu: Any, alpha: Any) -> Any:
        functions = self._tables["four"].lookup(mu, alpha)
        channels = []
        for r, g in zip(self._fetch("r")[:3], self._fetch("g")[:3], strict=True):
            nodes = node_reflectance(self._basis, r, g)
            channels.append(_sum(self._basis.coefficients_from_reflectance(r, nodes), functions))
        return tuple(channels)

    def _fetch(self, name: str) -> Any:
        import mitsuba as mi

        return self._maps[name].eval(mi.Point2f(*self._uv))

    def _part(self, last: int) -> tuple[Any, Any, Any]:
        normal, view, alpha = self._normal, self._view(), self._alpha
        cosine = sum(n * v for n, v in zip(normal, view, strict=True))
        mirrored = [2.0 * cosine * n - v for n, v in zip(normal, view, strict=True)]
        if last == 0:  # alpha is read, too
            return tuple(alpha * part for part in mirrored)  # type: ignore[return-value]
        radiance = self._light.lookup(mirrored, alpha)
        if last == 1:
            return radiance
        functions = self._tables["two" if last == 2 else "four"].lookup(cosine, alpha)
        return tuple(part * sum(functions) for part in radiance)  # type: ignore[return-value]


_METHODS = dict(
    zip(PASSES, ("_schlick", "_terms", "_schlick_map", "_terms_map", "_tint_map"), strict=True)
)


def _sum(coefficients: Any, functions: Any) -> Any:
    import drjit as dr

    total = coefficients[0] * functions[0]
    for c, b in zip(coefficients[1:], functions[1:], strict=True):
        total = dr.fma(c, b, total)
    return total


# --- the same in NumPy ---------------------------------------------------------------------------

Albedo = Callable[[Array, Array], Array]


def _repeated(texture: Array, uv: Array) -> Array:
    """Bilinear interpolation of a texture that repeats, in float64."""
    size = len(texture)
    position = uv.astype(np.float64) * size - 0.5
    first = np.floor(position).astype(np.int64)
    x, y = ((position - first)[:, i].reshape(-1, *[1] * (texture.ndim - 2)) for i in (0, 1))
    (i, j), (i_next, j_next) = (first % size).T, ((first + 1) % size).T
    texture = texture.astype(np.float64)
    above = texture[j, i] * (1.0 - x) + texture[j, i_next] * x
    below = texture[j_next, i] * (1.0 - x) + texture[j_next, i_next] * x
    return above * (1.0 - y) + below * y


def _albedo(name: str, m: Materials, uv: Array) -> Albedo:
    """Albedo of the pixels with these texture coordinates, by a pass or 'exact, ...'."""
    if name == "exact, uniform":
        return m.exact.lookup
    if name == "exact, textured":
        weights = _repeated(m.mixture, uv)
        return lambda mu, alpha: sum(
            weights[:, i, None] * table.lookup(mu, alpha) for i, table in enumerate(m.exact_metals)
        )
    if name.startswith("Schlick"):
        f0 = m.f0 if name in UNIFORM else _repeated(m.f0_map, uv)

        def schlick(mu: Array, alpha: Array) -> Array:
            functions = m.schlick_table.lookup(mu, alpha)
            return f0 * functions[:, :1] + functions[:, 1:]

        return schlick
    if name == "four terms, uniform":
        coefficients = m.coefficients
    elif name == "four terms, textured":
        coefficients = _repeated(m.coefficient_map, uv)
    else:
        r, g = _repeated(m.r_map, uv), _repeated(m.g_map, uv)
        nodes = np.stack(node_reflectance(m.basis, r, g), axis=-1)
        coefficients = m.basis.coefficients_from_reflectance(r, nodes)
    return lambda mu, alpha: (coefficients * m.table.lookup(mu, alpha)[:, None, :]).sum(axis=-1)


def reference(name: str, screen: Screen, materials: Materials, light: Any) -> Array:
    """(n, 3) float64: a pass, or 'exact, uniform' and 'exact, textured', computed with NumPy."""
    from fresnel_decomp.mitsuba.split_sum import shade

    parts = []
    view = screen.view
    for start in range(0, len(view), 65536):
        rows = slice(start, start + 65536)
        albedo = _albedo(name, materials, screen.uv[rows])
        normal, alpha = (v[rows].astype(np.float64) for v in (screen.normal, screen.alpha))
        parts.append(shade(light, albedo, normal, view[rows], alpha))
    return np.concatenate(parts)
