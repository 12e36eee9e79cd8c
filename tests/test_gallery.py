"""The gallery shows every picture, with a command that exists."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from fresnel_decomp import InputError

ROOT = Path(__file__).parent.parent


@pytest.fixture
def gallery(scripts: Any) -> Any:
    return scripts.gallery


def test_page_is_what_the_script_writes(gallery: Any) -> None:
    found = gallery.entries()
    gallery.check(found)
    assert gallery.PAGE.read_text(encoding="utf-8") == gallery.text(found)


def test_every_picture_is_there_once(gallery: Any) -> None:
    shown = re.findall(r"figures/(\S+\.png)", (ROOT / "docs" / "gallery.md").read_text("utf-8"))
    shown = [name for name in shown if not name.startswith("out")]
    pictures = {path.name for path in (ROOT / "docs" / "figures").glob("*.png")}
    directives = [e.name for e in gallery.entries()]
    assert sorted(directives) == sorted(pictures)
    assert pictures <= set(shown)


def test_commands_exist(gallery: Any) -> None:
    """Scripts are there, and the command has these parameters; test_scripts has the options."""
    from fresnel_decomp.cli import cli

    for entry in gallery.entries():
        for part in entry.command.split("&&"):
            words = shlex.split(part)
            options = [word for word in words if word.startswith("--")]
            if words[0] == "fresnel-decomp":
                known = {o for p in cli.commands[words[1]].params for o in p.opts}
                assert set(options) <= known
                continue
            assert words[0] == "python"
            source = (ROOT / words[1]).read_text(encoding="utf-8")
            if words[1].endswith("reproduce.py"):
                assert words[-1] in gallery.FIGURES
            elif not options:
                assert entry.name in source


def test_pictures_are_on_the_page_that_they_link_to(gallery: Any) -> None:
    for entry in gallery.entries():
        page = (ROOT / "docs" / f"{entry.page}.md").read_text(encoding="utf-8")
        assert f"figures/{entry.name}" in page, entry.name


def test_pictures_without_a_command_are_refused(gallery: Any) -> None:
    found = gallery.entries()
    with pytest.raises(InputError, match=found[-1].name):
        gallery.check(found[:-1])
    none = gallery.Entry("none.png", "x", "python scripts/none.py", "speed", "y")
    with pytest.raises(InputError, match=r"missing: \['none\.png'\]"):
        gallery.check([*found, none])


def test_every_picture_says_what_it_shows(gallery: Any) -> None:
    """In words of its own, which are those of the page that explains it."""
    found = gallery.entries()
    for said in ([entry.title for entry in found], [entry.alt for entry in found]):
        assert len(set(said)) == len(said)
        assert all(len(words) > 15 and "\n" not in words for words in said)
    with pytest.raises(InputError, match=r"does not say what 'none\.png' shows"):
        gallery.alt_of("none.png", "speed")
