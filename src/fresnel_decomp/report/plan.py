"""A plan in words and tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..mitsuba.scene_plan import ScenePlan

__all__ = ["summary"]

_UNITS = {"reflectance": "of the incident light", "delta-e": "ΔE00"}


def summary(planned: ScenePlan) -> list[str | list[list[str]]]:
    """Paragraphs, and tables as rows of cells with the header first."""
    plan = planned.plan
    parts: list[str | list[list[str]]] = []
    if plan.choices:
        rows = [["surface", "takes", "error", "operations", "instead of", "why exact"]]
        for choice in plan.choices:
            takes: str = choice.model
            if choice.model == "decomposition":
                takes = f"{choice.numbers} terms"
            exact = choice.exact_operations
            cells = [f"{choice.error:.2g}", str(choice.operations), str(exact), choice.why]
            rows.append([choice.surface.name, takes, *cells])
        parts.append(rows)
    if plan.basis is not None:
        origin = plan.basis.recipe
        if origin == "custom":
            origin = "extracted for this scene"
        parts.append(
            f"Basis of {plan.basis.terms} terms ({origin}), in closed form; with what surfaces "
            f"store, {plan.nbytes} bytes."
        )
    for table in plan.tables:
        enough = "" if table.enough else ", more than a tenth of the bound"
        parts.append(
            f"For image-based light and {table.distribution}: a table of {table.size} x "
            f"{table.size} x {table.channels} half floats, {table.nbytes} bytes, adds "
            f"{table.error:.1e}{enough}."
        )
    if not plan.choices:
        parts.append("No conductor to plan for: nothing to carry.")
    elif plan.basis is None:
        parts.append("No basis and no table to carry.")
    if plan.left:
        parts.append("Left exact:")
        rows = [["surface", "type", "because", "would gain"]]
        rows += [[entry.name, entry.kind, entry.why, entry.gain] for entry in plan.left]
        parts.append(rows)
    parts.append(
        f"Bound {plan.max_error:g} {_UNITS[plan.metric]}, in {planned.variant}; "
        f"lights: {', '.join(planned.lights) or 'none'}."
    )
    contrasts = {choice.surface.contrast for choice in plan.choices if choice.surface.averaged}
    if contrasts:
        parts.append(
            f"Errors are those in light of contrast {max(contrasts):.3g} (its variance relative to "
            "its squared mean). Deep shadow and small bright openings have more: --contrast inf "
            "holds in any light."
        )
    return parts
