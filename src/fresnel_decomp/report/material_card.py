"""A material on one card: its colours and the parameters of every engine, each with its error."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..basis import Basis
from ..colour import gamut_excess, linear_to_srgb, rgb_weights, srgb_hex
from ..converters import Converted, convert
from ..images import display
from ..material import Material
from ..representations import Curve
from . import style

__all__ = ["MaterialCard", "draw_card", "make_card", "remarks", "render_card", "table_rows"]

Array = NDArray[np.float64]

_CHANNELS = "RGB"


@dataclass(frozen=True, eq=False)
class MaterialCard:
    """Everything on the card: the spectrum in linear sRGB, in each form that engines store.

    Each form is what `converters.convert` returns, the nearest value where there is no counterpart.
    """

    material: Material
    illuminant: str
    basis: Basis
    coefficients: Converted
    nodes: Converted
    gulbrandsen: Converted
    linear_tint: Converted
    f82: Converted
    base_colour: Converted

    @property
    def node_colours(self) -> Array:
        """(terms - 1, 3) linear RGB: F0, then the reflectance at each node."""
        value = self.nodes.value
        return np.concatenate([value.f0[None], np.moveaxis(value.f_nodes, -1, 0)])

    @property
    def node_degrees(self) -> Array:
        """(terms - 1,) angles of the node colours."""
        return np.degrees(np.array([0.0, *self.basis.nodes]))


def make_card(material: Material, basis: Basis, illuminant: str = "D65") -> MaterialCard:
    """Integrate the spectrum and convert it to every form.

    Raises
    ------
    InputError
        For an unknown illuminant.

    Examples
    --------
    >>> from fresnel_decomp import load_basis, load_material
    >>> from fresnel_decomp.report.material_card import make_card
    >>> card = make_card(load_material("Au"), load_basis())
    >>> card.node_colours[0].round(3)
    array([1.022, 0.782, 0.343])
    """
    rgb_weights(illuminant)
    source = Curve(lambda cos_theta: material.rgb_reflectance(cos_theta, illuminant))

    def to(target: str) -> Converted:
        return convert(source, target, basis=basis, no_counterpart="nearest")

    return MaterialCard(
        material,
        illuminant,
        basis,
        to("coefficients"),
        to("nodes"),
        to("gulbrandsen"),
        to("linear_tint"),
        to("f82"),
        to("metallic_base"),
    )


def table_rows(card: MaterialCard) -> list[list[str]]:
    """Rows of text, the first a header: name, hex, R, G, B, mean and largest ΔE00 of the form."""
    rows = [["", "sRGB", *_CHANNELS, "ΔE00 mean", "ΔE00 max"]]

    def add(
        name: str, values: Any, form: Converted | None = None, colour: bool = False, digits: int = 4
    ) -> None:
        error = ["", ""]
        if form is not None and form.loss is not None:
            error = [f"{form.loss.delta_e_mean:.2f}", f"{form.loss.delta_e_max:.2f}"]
        numbers = [f"{value:.{digits}f}" for value in values]
        rows.append([name, srgb_hex(values) if colour else "", *numbers, *error])

    for i, (degrees, value) in enumerate(zip(card.node_degrees, card.node_colours, strict=True)):
        name = "F0" if i == 0 else f"F at {degrees:.2f}°"
        add(name, value, card.nodes if i == 0 else None, colour=True)
    for i, column in enumerate(np.moveaxis(card.coefficients.value.coefficients, -1, 0)):
        add(f"c_{i}", column, card.coefficients if i == 0 else None)
    gulbrandsen, tint, f82 = card.gulbrandsen.value, card.linear_tint.value, card.f82.value
    add("r", gulbrandsen.r, card.gulbrandsen, digits=5)
    add("g", gulbrandsen.g)
    add("beta (with r)", tint.beta, card.linear_tint)
    add("F82 (with F0)", f82.f82, card.f82, colour=True)
    add("F82 tint", f82.tint)
    add("base colour", card.base_colour.value.base_colour, card.base_colour, colour=True)
    return rows


def remarks(card: MaterialCard) -> list[str]:
    """What a reader must know: values out of [0, 1], and forms that have no exact counterpart."""
    lines = []
    excess = gamut_excess(card.node_colours)
    if np.abs(excess).max() > 5e-4:
        where = [
            f"{_CHANNELS[channel]} = {card.node_colours[node, channel]:.4f}"
            for node, channel in np.argwhere(np.abs(excess) > 5e-4)
        ]
        lines.append(f"Out of the range of sRGB, and kept: {', '.join(where)}. Hex is clipped.")
    for form, symbols in (
        (card.gulbrandsen, "(r, g)"),
        (card.linear_tint, "(r, beta)"),
        (card.base_colour, "base colour"),
    ):
        if np.any(form.moved):
            channels = [_CHANNELS[i] for i in np.flatnonzero(np.broadcast_to(form.moved, 3))]
            lines.append(
                f"No {symbols} has the colour in {', '.join(channels)}: the nearest is given."
            )
    if np.any(card.f82.value.tint > 1.0):
        lines.append("F82 tint above 1: OpenPBR stores at most 1.")
    return lines


def draw_card(card: MaterialCard, path: Path, image: Array | None = None) -> None:
    """Draw the card: a render if there is one, colours over the angle, node colours, curves.

    Parameters
    ----------
    card : MaterialCard
    path : file that ends in .png, .pdf or .svg
    image : (n, n, 3) float, optional
        Linear render of the material.
    """
    degrees = np.linspace(0.0, 90.0, 181)
    cos_theta = np.clip(np.cos(np.radians(degrees)), 0.0, 1.0)
    exact = card.material.rgb_reflectance(cos_theta, card.illuminant)
    fitted = card.coefficients.value(cos_theta[:, None])
    with style.styled():
        width, height = 8.6, 3.9
        figure = style.figure(width, height)

        def axes(x: float, y: float, w: float, h: float) -> Any:
            return figure.add_axes((x / width, 1.0 - (y + h) / height, w / width, h / height))

        title = ", ".join([card.material.name, *card.material.aliases[:2]])
        figure.text(0.12 / width, 1.0 - 0.26 / height, title, size=13, va="center")
        left = 0.12
        if image is not None:
            picture = axes(left, 0.5, 3.2, 3.2)
            picture.imshow(display(image), vmin=0, vmax=1)
            picture.set_axis_off()
            left += 3.2
        left += 0.5
        wide = width - left - 0.2
        strip = axes(left, 0.5, wide, 0.62)
        strip.imshow(
            linear_to_srgb(np.stack([exact, fitted])),
            aspect="auto",
            interpolation="nearest",
            extent=(0.0, 90.0, 2.0, 0.0),
        )
        strip.set_yticks([0.5, 1.5], ["exact", f"{card.basis.terms} terms"], size=6.5)
        strip.set_xticks([])
        strip.grid(False)
        strip.tick_params(length=0, pad=2)
        for spine in strip.spines.values():
            spine.set_visible(False)
        curves = axes(left, 1.2, wide, 1.24)
        for i, (channel, colour) in enumerate(style.CHANNEL_COLOURS.items()):
            curves.plot(degrees, exact[:, i], color=colour, lw=4.0, alpha=0.3)
            curves.plot(degrees, fitted[:, i], color=colour, lw=1.2, label=channel)
        for at in card.node_degrees[1:]:
            curves.axvline(at, color="#909090", lw=0.7, ls=(0, (2, 2)))
        curves.set_xlim(0.0, 90.0)
        low = min(float(exact.min()), float(fitted.min()))
        curves.set_ylim(max(0.0, np.floor(10.0 * low - 0.2) / 10.0), max(1.02, exact.max() + 0.02))
        curves.set_xticks(range(0, 91, 15), [f"{d}°" for d in range(0, 91, 15)], size=7)
        curves.tick_params(axis="y", labelsize=7)
        _chips(axes(left, 2.82, wide, 0.88), card)
        light = f"{card.illuminant}, linear sRGB, basis {card.basis.recipe}"
        figure.text(1.0 - 0.2 / width, 1.0 - 0.26 / height, light, size=8, ha="right", va="center")
        style.save(figure, path)


def _chips(axes: Any, card: MaterialCard) -> None:
    """F0 and the node colours as patches, with their values on them."""
    colours = card.node_colours
    axes.set_xlim(0.0, len(colours))
    axes.set_ylim(0.0, 1.0)
    axes.set_axis_off()
    for i, (degrees, value) in enumerate(zip(card.node_degrees, colours, strict=True)):
        ink = "black" if value @ [0.21, 0.72, 0.07] > 0.2 else "white"
        axes.axvspan(i + 0.02, i + 0.98, color=tuple(linear_to_srgb(value)), lw=0)
        head = "F0" if i == 0 else f"F at {degrees:.2f}°"
        numbers = "  ".join(f"{channel:.3f}" for channel in value)
        text = f"{head}   {srgb_hex(value)}\n{numbers}"
        size = 7.0 if len(colours) <= 3 else 5.5
        axes.text(i + 0.5, 0.5, text, ha="center", va="center", size=size, color=ink)


def render_card(card: MaterialCard, variant: str, size: int = 320, spp: int = 64) -> Array:
    """A rough sphere of the card's coefficients in the studio, (size, size, 3) linear RGB."""
    from ..mitsuba.comparison import render_scene
    from ..mitsuba.scenes import load_scene
    from ..mitsuba.variants import variant_scope

    coefficients: Sequence[Array] = np.moveaxis(card.coefficients.value.coefficients, -1, 0)
    colours = {
        f"c{i}": {"type": "rgb", "value": column.tolist()} for i, column in enumerate(coefficients)
    }
    bsdf = {"type": "decomposed_conductor", "distribution": "ggx", "alpha": 0.1, **colours}
    with variant_scope(variant), tempfile.TemporaryDirectory() as folder:
        # the basis itself: one from a file need not be what ships under the name that it has
        path = Path(folder) / "basis.json"
        card.basis.save(path)
        scene = load_scene("studio", {**bsdf, "recipe": str(path)}, size, spp=spp)
        return np.asarray(render_scene(scene, spp))
