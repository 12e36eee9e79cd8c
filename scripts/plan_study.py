"""A studio of gold, aluminium, glass and plastic: planned at several bounds, checked by rendering.

    python scripts/plan_study.py --page docs/plans.md --picture docs/figures/plans.png

For each bound the scene is rendered as it is, with its plan, and with conductors that reflect
everything, all from the same random numbers. The difference of the first two over the third is, in
every pixel, an average of the error of the reflectance over the angles that light came from: what
the plan predicts. Measured is its largest value over the pixels that show a metal directly, and the
noise is how much that differs between two seeds. Scenes that are finished are not rendered again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.progress import Progress

from _command_line import json_option, main, page_option, script
from _markdown import insert, markdown, marks
from fresnel_decomp import __version__, doctor
from fresnel_decomp._files import writable_folder, write_json
from fresnel_decomp.images import read_exr, write_exr

BOUNDS = (0.02, 0.005, 0.001)
METALS = ("gold", "aluminium")
MARKS = marks("plans")


@dataclass(frozen=True)
class Row:
    """One metal at one bound."""

    bound: float
    metal: str
    model: str
    basis: str
    operations: int
    predicted: float
    measured: float
    noise: float


def scene(size: int, spp: int, lit_by: str = "sky") -> dict[str, Any]:
    """Four spheres on a floor, under a sky or a point light."""
    import mitsuba as mi

    look = mi.ScalarTransform4f().look_at
    move = mi.ScalarTransform4f().translate
    lights = {
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [1.0, 1.0, 1.0]}},
        "point": {"type": "point", "position": [4.0, -6.0, 7.0], "intensity": 150.0},
    }
    bsdfs = {
        "gold": {"type": "roughconductor", "material": "Au", "alpha": 0.15, "distribution": "ggx"},
        "aluminium": {
            "type": "roughconductor",
            "material": "Al",
            "alpha": 0.3,
            "distribution": "ggx",
        },
        "glass": {"type": "dielectric", "int_ior": "bk7", "ext_ior": "air"},
        "plastic": {"type": "roughplastic", "alpha": 0.1, "distribution": "ggx"},
    }
    spheres = {
        f"{name} sphere": {
            "type": "sphere",
            "to_world": move([3.2 * i - 4.8, 0.0, 1.0]),
            "bsdf": {"type": "ref", "id": name},
        }
        for i, name in enumerate(bsdfs)
    }
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5, "rr_depth": 10},
        "sensor": {
            "type": "perspective",
            "fov": 26.0,
            "to_world": look([0.0, -28.0, 7.0], [0.0, 0.0, 0.9], [0.0, 0.0, 1.0]),
            "film": {
                "type": "hdrfilm",
                "width": size,
                "height": size * 5 // 16,
                "rfilter": {"type": "box"},
                "component_format": "float32",
            },
            "sampler": {"type": "independent", "sample_count": spp},
        },
        **{name: {**bsdf, "id": name} for name, bsdf in bsdfs.items()},
        **spheres,
        "floor": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().scale([40.0, 40.0, 1.0]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.2] * 3}},
        },
        "light": lights[lit_by],
    }


def mirrors(described: dict[str, Any]) -> dict[str, Any]:
    """The scene with conductors that reflect everything."""
    changed = dict(described)
    for name in METALS:
        metal = {key: value for key, value in described[name].items() if key != "material"}
        changed[name] = {**metal, "material": "none"}
    return changed


def which_metal(loaded: Any, described: dict[str, Any]) -> np.ndarray:
    """(height, width) index into METALS of what a pixel shows wholly, or -1."""
    import drjit as dr
    import mitsuba as mi

    film = described["sensor"]["film"]
    width, height = film["width"], film["height"]
    found = np.full((height, width), -2)
    y, x = np.mgrid[:height, :width].reshape(2, -1)
    shapes = loaded.shapes()
    for dx, dy in ((0.0, 0.0), (0.99, 0.0), (0.0, 0.99), (0.99, 0.99), (0.5, 0.5)):
        position = mi.Point2f(
            mi.Float(((x + dx) / width).astype(np.float32)),
            mi.Float(((y + dy) / height).astype(np.float32)),
        )
        ray, _ = loaded.sensors()[0].sample_ray(0.0, 0.5, position, mi.Point2f(0.5))
        hit = loaded.ray_intersect(ray)
        index = np.full(len(x), -1)
        for i, name in enumerate(METALS):
            for shape in shapes:
                if shape.id() == f"{name} sphere":
                    index[np.array(hit.shape == mi.ShapePtr(shape))] = i
        index = index.reshape(height, width)
        found = np.where(found == -2, index, np.where(found == index, found, -1))
        dr.eval()
    return found


@dataclass(frozen=True)
class Settings:
    """What is planned and rendered."""

    bounds: tuple[float, ...]
    light: str
    variant: str
    size: int
    spp: int
    folder: Path


@script()
@click.option(
    "--bounds", multiple=True, type=float, default=BOUNDS, show_default=True, help="Repeatable."
)
@click.option("--light", type=click.Choice(("sky", "point")), default="sky", show_default=True)
@click.option("--variant", default="llvm_ad_rgb", show_default=True)
@click.option("--size", default=384, show_default=True, help="Width in pixels.")
@click.option("--spp", default=256, show_default=True)
@click.option(
    "--folder", type=click.Path(path_type=Path), default="out/plans", help="Of the renders."
)
@page_option(MARKS)
@click.option("--picture", type=click.Path(path_type=Path), help="Also draw a picture.")
@json_option
def plans(page: Path | None, picture: Path | None, out: Path | None, **given: Any) -> None:
    """A studio, planned at several bounds and checked by rendering."""
    settings = Settings(**given)
    doctor.require_variant(settings.variant)
    import mitsuba as mi

    mi.set_variant(settings.variant)
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("plans", total=2.0 * (2 + len(settings.bounds)))
        rows, images = study(settings, lambda: progress.advance(task))
    text = table(rows)
    broken = violations(rows)
    click.echo("\n".join([text, *broken]))
    if page:
        insert(page, text, MARKS)
    if picture:
        draw(images, picture)
    if out:
        write_json(
            out,
            {
                "fresnel_decomp": __version__,
                "variant": settings.variant,
                "light": settings.light,
                "size": settings.size,
                "spp": settings.spp,
                "rows": [asdict(row) for row in rows],
            },
        )
    if broken:
        raise SystemExit(1)


def violations(rows: Sequence[Row]) -> list[str]:
    """Where a prediction is not kept, or is more than three times what is measured."""
    found = []
    for row in rows:
        if row.model == "exact":
            continue  # what it shows is the error of its neighbours
        where = f"{row.metal} at {row.bound:g}"
        if row.measured > row.predicted + row.noise:
            found.append(f"{where}: measured {row.measured:.2g}, predicted {row.predicted:.2g}")
        if row.predicted > 3.0 * row.measured:
            found.append(f"{where}: predicted {row.predicted:.2g}, three times what is measured")
    return found


def study(settings: Settings, advance: Any) -> tuple[list[Row], dict[str, np.ndarray]]:
    """Plan, render and compare."""
    import mitsuba as mi

    from fresnel_decomp.mitsuba.scene_plan import plan_scene

    folder = writable_folder(settings.folder)
    described = scene(settings.size, settings.spp, settings.light)

    def render(name: str, make: Any, seed: int) -> np.ndarray:
        about = (
            f"{described} {settings.spp} {seed} {settings.variant} {mi.__version__} {__version__}"
        )
        path = folder / f"{name}-{hashlib.sha256(about.encode()).hexdigest()[:16]}.exr"
        if not path.is_file():
            image = np.array(mi.render(make(), spp=settings.spp, seed=seed))
            write_exr(path, image[..., :3], {"software": f"fresnel_decomp {__version__}"})
        advance()
        return read_exr(path).astype(np.float64)

    loaded = mi.load_dict(described)
    metal = which_metal(loaded, described)
    exact = [render("exact", lambda: loaded, seed) for seed in (0, 1)]
    white = [render("white", lambda: mi.load_dict(mirrors(described)), seed) for seed in (0, 1)]
    rows, images = [], {"exact": exact[0]}
    for bound in settings.bounds:
        planned = plan_scene(described, bound)
        plan, basis = planned.plan, planned.plan.basis
        content = "".join(f"{c.model} {c.surface.eta} {c.coefficients}" for c in plan.choices)
        content += "" if basis is None else str(basis.provenance["sha256"])
        key = f"planned-{hashlib.sha256(content.encode()).hexdigest()[:16]}"
        approximate = [render(key, planned.apply, seed) for seed in (0, 1)]
        difference = [
            np.abs(a - e) / np.maximum(w, 1e-6)
            for a, e, w in zip(approximate, exact, white, strict=True)
        ]
        images[f"{bound:g}"] = approximate[0]
        images[f"{bound:g} difference"] = difference[0]
        for choice in plan.choices:
            shown = metal == METALS.index(choice.surface.name)
            largest = [float(d[shown].max()) for d in difference]
            name = "" if choice.model != "decomposition" else f"{basis.recipe}, {basis.terms} terms"
            rows.append(
                Row(
                    bound,
                    choice.surface.name,
                    choice.model,
                    name,
                    choice.operations,
                    choice.error,
                    max(largest),
                    abs(largest[1] - largest[0]),
                )
            )
    return rows, images


def table(rows: Sequence[Row]) -> str:
    head = ["bound", "surface", "takes", "operations", "predicted error", "measured", "noise"]
    body = [
        [
            f"{row.bound:g}",
            row.metal,
            row.basis or row.model,
            str(row.operations),
            f"{row.predicted:.4f}",
            f"{row.measured:.4f}",
            f"{row.noise:.4f}",
        ]
        for row in rows
    ]
    return markdown(head, body)


def draw(images: dict[str, np.ndarray], path: Path) -> None:
    """The exact picture, and for each bound where and by how much the plan differs."""
    from matplotlib import pyplot as plt

    from fresnel_decomp._files import replacing
    from fresnel_decomp.images import display

    bounds = [name for name in images if f"{name} difference" in images]
    figure, axes = plt.subplots(len(bounds) + 1, 1, figsize=(8.0, 2.6 * (len(bounds) + 1)))
    axes[0].imshow(display(images["exact"]))
    axes[0].set_title("as written: exact equations")
    for axis, name in zip(axes[1:], bounds, strict=True):
        values = images[f"{name} difference"].max(axis=-1) / float(name)
        shown = axis.imshow(values, vmin=0.0, vmax=1.0, cmap="magma")
        axis.set_title(f"planned for {name}: error of the reflectance over the bound")
        figure.colorbar(shown, ax=axis, fraction=0.015, pad=0.01)
    for axis in axes:
        axis.set_axis_off()
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110, bbox_inches="tight")
    plt.close(figure)


if __name__ == "__main__":
    main(plans, interrupted="Interrupted. The same command goes on from finished renders.")
