"""One import for notebooks: the library, a Mitsuba that runs here, and ways to look at things.

    from fresnel_decomp.notebook import explore, fast, fd, mi, np, plt, show, style

What is not asked for is not loaded, and nothing happens before it is asked for:

- `mi` is Mitsuba. Asking for it chooses an LLVM that works (`doctor.prepare`), sets the fastest
  variant that runs here unless one is set already, and registers our plugin. Where only the slow
  scalar variants run, as in Colab before an LLVM is fetched, it says so and what to do.
- `fast` is whether that variant is one of the fast ones: pictures can be large.
- `plt` is pyplot in the style of our figures, `style` their colours, `np` NumPy and `fd` this
  package.
- `show` puts pictures side by side, `explore` puts sliders to a figure.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import html
import importlib
import io
import logging
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from ._check import InputError, input_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["explore", "show"]

_DPI = 110.0
_PAUSE = 0.02  # seconds: slider events that wait meanwhile are answered together


def __getattr__(name: str) -> Any:
    if name not in _PREPARED:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return _PREPARED[name]()


def _mitsuba() -> Any:
    from . import doctor

    llvm = doctor.prepare()
    variant = doctor.best_variant()
    import mitsuba as mi

    if mi.variant() is None:
        mi.set_variant(variant)
        if variant.startswith("scalar"):
            llvm = doctor.prepare()  # again: now with Dr.Jit's own word on it
            logging.getLogger(__name__).warning(
                "Mitsuba runs in %s, slowly: %s. %s, then restart the kernel.",
                variant,
                llvm.reason,
                llvm.remedy,
            )
    from .mitsuba import register

    register()
    return mi


def _fast() -> bool:
    return not str(_mitsuba().variant()).startswith("scalar")


def _pyplot() -> Any:
    from matplotlib import pyplot as plt

    from .report.style import RC

    settings: Any = {**RC, "figure.dpi": _DPI, "figure.figsize": (9.0, 3.2)}
    plt.rcParams.update(settings)
    return plt


_PREPARED: dict[str, Callable[[], Any]] = {
    "fast": _fast,
    "fd": lambda: importlib.import_module("fresnel_decomp"),
    "mi": _mitsuba,
    "np": lambda: importlib.import_module("numpy"),
    "plt": _pyplot,
    "style": lambda: importlib.import_module("fresnel_decomp.report.style"),
}


# --- pictures ------------------------------------------------------------------------------------


def show(
    images: Mapping[str, Any],
    exposure: float = 0.0,
    *,
    maps: Mapping[str, Any] | None = None,
    limit: float | None = None,
    unit: str = "",
    width: float = 9.0,
) -> None:
    """Put linear images side by side, and maps with one colour scale after them.

    Parameters
    ----------
    images : mapping of titles to (height, width, 3) float
        Linear sRGB, shown as `images.display` encodes it.
    exposure : float
        In stops.
    maps : mapping of titles to (height, width) float, optional
        In false colours, from 0, or from -limit where any is negative.
    limit : float, optional
        End of the colours; by default a round number that nearly all of the maps stay below.
    unit : str
        Beside the colour bar.
    width : float
        Of the figure, in inches.
    """
    _display(draw_row(images, exposure, maps=maps, limit=limit, unit=unit, width=width))


def draw_row(
    images: Mapping[str, Any],
    exposure: float = 0.0,
    *,
    maps: Mapping[str, Any] | None = None,
    limit: float | None = None,
    unit: str = "",
    width: float = 9.0,
) -> Figure:
    """The figure that `show` shows."""
    import numpy as np

    from .images import display
    from .report import style

    maps = dict(maps or {})
    shapes = [np.shape(values)[:2] for values in (*images.values(), *maps.values())]
    if not shapes:
        raise input_error("no images", "at least one image or map", "Name it: {'exact': image}.")
    if limit is None:
        largest = (float(np.quantile(np.abs(values), 0.999)) for values in maps.values())
        limit = style.nice_limit(max(largest, default=0.0))
    signed = any(float(np.min(values)) < 0.0 for values in maps.values())
    ratio = max(height / across for height, across in shapes)
    with style.styled():
        cell = width / len(shapes)
        fig = style.figure(width, cell * ratio + 0.3, layout="compressed")
        axes = fig.subplots(1, len(shapes), squeeze=False)[0]
        for ax, (title, image) in zip(axes, images.items(), strict=False):
            ax.imshow(display(image, exposure))
            ax.set_title(title)
        for ax, (title, values) in zip(axes[len(images) :], maps.items(), strict=True):
            colours = style.DIVERGING if signed else style.SEQUENTIAL
            shown = ax.imshow(values, cmap=colours, vmin=-limit if signed else 0.0, vmax=limit)
            ax.set_title(title)
        if maps:
            fig.colorbar(shown, ax=list(axes[len(images) :]), label=unit, shrink=0.9)
        for ax in axes:
            ax.set_axis_off()
    return fig


def _png(fig: Figure) -> bytes:
    buffer = io.BytesIO()
    fig.savefig(buffer, format="png", dpi=_DPI)
    return buffer.getvalue()


def _display(fig: Figure, widget: Any = None) -> None:
    """Show a figure; where it can, the frontend shows the widget instead."""
    display: Any = importlib.import_module("IPython.display").display
    png = base64.b64encode(_png(fig)).decode("ascii")
    bundle = {"image/png": png, "text/plain": repr(fig)}
    if widget is not None:
        bundle |= widget._repr_mimebundle_()
    display(bundle, raw=True)


# --- sliders -------------------------------------------------------------------------------------


def explore(draw: Callable[..., Figure], **sliders: tuple[float, float, float]) -> None:
    """Show what `draw` draws, with a slider for each of its arguments.

    A notebook that is read without a kernel, or where ipywidgets is missing, shows the first
    picture.

    Parameters
    ----------
    draw : callable
        Takes the values of the sliders by name and returns a matplotlib figure. What it refuses
        with an `InputError` is told below the sliders.
    **sliders : (start, lowest, highest)
        By the names of draw's arguments.

    Raises
    ------
    InputError
        For sliders other than three numbers in this order of size: lowest, start, highest.

    Examples
    --------
    Live in a notebook::

        def draw(eta, k):
            fig = style.figure(4, 3)
            ax = fig.subplots()
            ax.plot(np.arange(91), fd.conductor(np.cos(np.radians(np.arange(91))), eta, k))
            return fig

        explore(draw, eta=(1.5, 0.1, 4.0), k=(1.0, 0.0, 6.0))
    """
    for name, given in sliders.items():
        if not (len(given) == 3 and given[1] <= given[0] <= given[2]):
            raise input_error(
                f"{name}={given!r}",
                "(start, lowest, highest) with lowest ≤ start ≤ highest",
                "For example eta=(1.5, 0.1, 4.0).",
            )
    first = draw(**{name: start for name, (start, _, _) in sliders.items()})
    box = None
    with contextlib.suppress(ImportError):
        box = _box(draw, sliders, _png(first))
    _display(first, box)


def _box(draw: Callable[..., Figure], sliders: Mapping[str, Any], png: bytes) -> Any:
    widgets: Any = importlib.import_module("ipywidgets")

    controls = {
        name: widgets.FloatSlider(
            value=start, min=low, max=high, step=(high - low) / 200.0,
            description=name.replace("_", " "), readout_format=".3g",
        )
        for name, (start, low, high) in sliders.items()
    }  # fmt: skip
    picture, message = widgets.Image(value=png, format="png"), widgets.HTML()
    waiting = False

    def redraw() -> None:
        nonlocal waiting
        waiting = False
        try:
            picture.value = _png(draw(**{name: c.value for name, c in controls.items()}))
            message.value = ""
        except InputError as error:
            message.value = html.escape(str(error))

    def moved(_change: Any) -> None:
        nonlocal waiting
        if waiting:
            return
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            redraw()
        else:
            waiting = True
            loop.call_later(_PAUSE, redraw)

    for control in controls.values():
        control.observe(moved, "value")
    return widgets.VBox([widgets.Box([*controls.values()]), picture, message])
