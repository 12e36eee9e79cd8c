"""Where scenes come from: files, dictionaries or scenes that are loaded, and their parsed form."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mitsuba as mi

from .._check import input_error
from . import register
from .variants import active_variant

__all__ = ["ParsedScene", "Source", "load_source"]

Source = str | os.PathLike[str] | dict[str, Any] | Any
"""The path of an XML file, a dictionary as for `mi.load_dict`, or a loaded `mi.Scene`."""


@dataclass(frozen=True, eq=False)
class ParsedScene:
    """Where a scene comes from, and the object that each of its parsed nodes became.

    Attributes
    ----------
    origin : path or dict
    config : mi.parser.ParserConfig
    nodes : tuple of Mitsuba's objects, or None for nodes that nothing refers to
    """

    origin: str | dict[str, Any]
    config: Any
    nodes: tuple[Any, ...]

    def parse(self) -> Any:
        """The parsed form anew, to be changed."""
        return _parse(self.origin, self.config)

    def instantiate(self, state: Any) -> Any:
        """The scene that a parsed form describes."""
        return _instantiate(self.origin, self.config, state)


def _parse(origin: str | dict[str, Any], config: Any) -> Any:
    parse = mi.parser.parse_dict if isinstance(origin, dict) else mi.parser.parse_file
    state = parse(config, origin)
    mi.parser.transform_upgrade(config, state)
    mi.parser.transform_resolve_references(config, state)
    return state


def load_source(source: Source) -> tuple[Any, ParsedScene | None]:
    """The scene, loaded in the active variant, and its parsed form where there is one.

    Raises
    ------
    InputError
        If no variant is set, or the scene cannot be loaded.
    """
    active_variant()
    register()
    if isinstance(source, mi.Scene):
        return source, None
    if not isinstance(source, dict):
        source = os.fspath(source)
        if not Path(source).is_file():
            raise input_error(f"no file '{source}'", "a Mitsuba scene in XML", "Check the path.")
    config = mi.parser.ParserConfig(mi.variant())
    config.merge_equivalent = config.merge_meshes = False
    try:
        state = _parse(source, config)
        scene = _instantiate(source, config, state)
    except RuntimeError as error:
        raise input_error(
            f"a scene that does not load in {mi.variant()} ({str(error).strip()})",
            "a scene that Mitsuba renders",
            "Load it with mitsuba.load_file or load_dict to see what is wrong.",
        ) from error
    if not isinstance(scene, mi.Scene):
        raise input_error(f"a {type(scene).__name__}", "a scene", "Put it into a scene first.")
    # instantiating replaces references by the objects that they stand for
    again = _parse(source, config)
    nodes: list[Any] = [None] * len(again.nodes)
    for before, after in zip(again.nodes, state.nodes, strict=True):
        for name in list(before.props.keys()):
            if before.props.type(name) == mi.Properties.Type.ResolvedReference:
                nodes[before.props[name].index()] = after.props[name]
    return scene, ParsedScene(source, config, tuple(nodes))


def _instantiate(origin: str | dict[str, Any], config: Any, state: Any) -> Any:
    """The scene; files that it names are looked for beside its own."""
    before = mi.file_resolver()
    resolver = mi.FileResolver(before)
    if isinstance(origin, str):
        resolver.prepend(str(Path(origin).resolve().parent))
    mi.set_file_resolver(resolver)
    try:
        loaded = mi.parser.instantiate(config, state)
    finally:
        mi.set_file_resolver(before)
    return loaded[0] if isinstance(loaded, list | tuple) else loaded
