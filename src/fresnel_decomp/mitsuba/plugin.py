"""What the BSDF plugins have in common: how they are made, told apart, kept and printed."""

from __future__ import annotations

from typing import Any

import mitsuba as mi

from .._check import choose
from ..basis import load_basis
from ..microfacet import DISTRIBUTIONS, Distribution
from .fresnel_terms import FRESNEL_TERMS, Decomposition, fresnel_term
from .tabulation import Lookup

__all__ = ["FresnelPlugin", "derived"]

_OWN_SLOTS = ("__dict__", "__weakref__")


def derived(methods: type) -> type:
    """A BSDF class of the active variant with the methods of another class and of its bases."""
    # a class of Mitsuba's takes no second base, so it gets the methods themselves
    body: dict[str, Any] = {}
    for base in reversed(methods.__mro__[:-1]):
        body |= {name: value for name, value in vars(base).items() if name not in _OWN_SLOTS}
    return type(methods.__name__, (mi.BSDF,), body)


class FresnelPlugin:
    """A microfacet BSDF with a choice of Fresnel term; a plain class, made for `derived`."""

    def _set_fresnel(self, props: Any, distribution: Distribution) -> None:
        """Take what all plugins are told; `distribution` is the default."""
        self.fresnel = choose("fresnel", str(props.get("fresnel", "decomposition")), FRESNEL_TERMS)
        chosen: Any = str(props.get("distribution", distribution)).lower()
        choose("distribution", chosen, DISTRIBUTIONS)
        self.distribution: Distribution = chosen
        self.sample_visible = bool(props.get("sample_visible", True))
        self.recipe, terms = str(props.get("recipe", "talk")), int(props.get("terms", 0)) or None
        if self.recipe.endswith(".json"):  # relative to the scene file
            self.recipe = str(mi.file_resolver().resolve(self.recipe))
        self.basis = load_basis(self.recipe, terms)
        self.term = fresnel_term(self.fresnel, self.basis)
        self.tables: list[Any] = []

    def _keep(self, lookup: Lookup) -> None:
        """Take a new lookup, its tables in the place of the old ones."""
        self.lookup = lookup
        self.tables = self.tables or [type(table)(table) for table in lookup.tables]
        for kept, table in zip(self.tables, lookup.tables, strict=True):
            mi.set_property(kept, table)  # in place: `SceneParameters` hold on to them

    def _show_tables(self, cb: Any) -> None:
        for i, table in enumerate(self.tables):  # as inputs of `mi.render`, see `Lookup`
            cb.put(f"table_{i}", table, mi.ParamFlags.ReadOnly)

    def _lobe(self, alpha_u: Any, alpha_v: Any) -> Any:
        types = mi.MicrofacetType
        kind = types.GGX if self.distribution == "ggx" else types.Beckmann
        return mi.MicrofacetDistribution(kind, alpha_u, alpha_v, self.sample_visible)

    def _described(self, items: dict[str, Any]) -> str:
        """What `to_string` returns, with these items after those of all plugins."""
        shown: dict[str, Any] = {"fresnel": self.fresnel}
        if isinstance(self.term, Decomposition):
            shown |= {"recipe": self.term.basis.recipe, "terms": self.term.basis.terms}
        shown |= {"distribution": self.distribution, "sample_visible": self.sample_visible, **items}
        lines = [f"  {key} = {value}".replace("\n", "\n  ") for key, value in shown.items()]
        return f"{type(self).__name__}[\n" + ",\n".join(lines) + "\n]"
