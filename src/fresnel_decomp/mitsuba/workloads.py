"""What is timed: curves in two kinds of kernels, a BSDF alone, and a whole picture.

Each function returns one that runs the work and waits for nothing; see `timing.interleaved_times`.
They are for LLVM and CUDA variants.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

__all__ = [
    "BERYLLIUM",
    "PICTURE_DEPTH",
    "UNROLL",
    "Picture",
    "Run",
    "bsdf_evaluation",
    "compute_bound",
    "directions",
    "picture",
    "random_cosines",
    "streaming",
]

Run = Callable[[], Any]

BERYLLIUM = {"eta": [4.185, 3.185, 2.784], "k": [3.835, 3.010, 2.869]}
"""An index like that of beryllium, per channel."""

UNROLL = 8
"""Evaluations in each turn of the compute-bound loop."""


def random_cosines(size: int, seed: int = 0) -> Any:
    """Evaluated, uniform in [0, 1)."""
    values = mi.PCG32(size=size, initseq=seed).next_float32()
    dr.eval(values)
    return values


def streaming(evaluate: Callable[[Any], Any], cosines: Any) -> Run:
    """Reads one cosine from memory, evaluates once, writes the result."""
    return lambda: dr.eval(evaluate(cosines))


def compute_bound(evaluate: Callable[[Any], Any], kind: type, cosines: Any, turns: int) -> Run:
    """Evaluates `turns * UNROLL` cosines for each element, writes their sum, of type `kind`."""

    def turn(i: Any, c: Any, total: Any) -> Any:
        for j in range(UNROLL):
            total = total + evaluate(c * (1.0 - j / (2.0 * UNROLL)))
        return i + 1, 1.0 - 0.97 * c, total

    def run() -> None:
        state = (mi.UInt32(0), cosines, dr.zeros(kind, dr.width(cosines)))
        dr.eval(dr.while_loop(state, lambda i, c, total: i < turns, turn)[2])

    return run


def directions(size: int, seed: int = 0) -> tuple[Any, Any]:
    """A surface interaction with random directions to the viewer, and random ones to the light."""
    sampler = mi.PCG32(size=size, initseq=seed)

    def direction() -> Any:
        return mi.warp.square_to_cosine_hemisphere(
            mi.Point2f(sampler.next_float32(), sampler.next_float32())
        )

    si = dr.zeros(mi.SurfaceInteraction3f, size)
    si.wi, wo = direction(), direction()
    if mi.is_spectral:
        si.wavelengths = type(si.wavelengths)(
            *(360.0 + 470.0 * sampler.next_float32() for _ in range(len(si.wavelengths)))
        )
    dr.eval(si, wo)
    return si, wo


def bsdf_evaluation(bsdf: Any, si: Any, wo: Any) -> Run:
    """`eval` of a loaded BSDF on pairs of directions."""
    return lambda: dr.eval(bsdf.eval(mi.BSDFContext(), si, wo, True))


PICTURE_DEPTH = 5
"""Path vertices, `max_depth` of the integrator: up to four reflections by conductors."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A scene; calling it renders, and returns, its picture."""

    scene: Any
    spp: int
    seed: int

    def __call__(self) -> Any:
        image = mi.render(self.scene, spp=self.spp, seed=self.seed)
        dr.eval(image)
        return image


def picture(bsdf: Mapping[str, Any], size: int, spp: int, seed: int = 0) -> Picture:
    """Conducting balls on a conducting floor under an even sky."""
    scale = mi.ScalarTransform4f().scale(4.0)
    view = mi.ScalarTransform4f().look_at([0, -5, 2.5], [0, 0, 0.4], [0, 0, 1])
    material = dict(bsdf)
    balls = {
        f"ball{i}": {
            "type": "sphere",
            "center": [1.1 * (i - 1), 0.4 * (i % 2), 0.5],
            "radius": 0.5,
            "bsdf": material,
        }
        for i in range(3)
    }
    film = {"type": "hdrfilm", "width": size, "height": size}
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {
                "type": "path",
                "max_depth": PICTURE_DEPTH,
                "rr_depth": PICTURE_DEPTH + 1,
            },
            "sensor": {"type": "perspective", "fov": 40, "to_world": view, "film": film},
            "floor": {"type": "rectangle", "to_world": scale, "bsdf": material},
            "sky": {"type": "constant"},
            **balls,
        }
    )
    return Picture(scene, spp, seed)
