"""Links of a built site that lead nowhere, found without a network."""

from __future__ import annotations

import urllib.parse
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path

REFERENCES = {
    "a": "href", "link": "href", "img": "src", "script": "src", "source": "src", "iframe": "src",
}  # fmt: skip


@dataclass
class Page:
    """What a page refers to, and what can be referred to in it."""

    links: list[tuple[str, str]] = field(default_factory=list)
    anchors: set[str] = field(default_factory=set)


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.page = Page()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value for name, value in attrs if value is not None}
        self.page.anchors |= {given[name] for name in ("id", "name") if name in given}
        target = given.get(REFERENCES.get(tag, ""))
        if target is not None and given.get("rel") != "canonical":
            self.page.links.append((tag, target))


def read(path: Path) -> Page:
    reader = _Reader()
    reader.feed(path.read_text(encoding="utf-8"))
    return reader.page


def broken_links(folder: Path) -> list[str]:
    """Messages, one for each link within the site to no file or no anchor, and for addresses on
    the network that are none."""
    root = folder.resolve()
    pages = {path.resolve(): read(path) for path in sorted(root.rglob("*.html"))}
    messages = []
    for path, page in pages.items():
        where = path.relative_to(root)
        for tag, link in page.links:
            parts = urllib.parse.urlsplit(link)
            if parts.scheme in ("data", "mailto", "javascript"):
                continue
            if parts.scheme or parts.netloc:
                if parts.scheme not in ("http", "https") or "." not in parts.netloc:
                    messages.append(f"{where}: <{tag}> {link}: no address")
                continue
            file = urllib.parse.unquote(parts.path)
            target = (path.parent / file).resolve() if file else path
            if not target.is_file():
                messages.append(f"{where}: <{tag}> {link}: no such file")
            elif root not in target.parents:
                messages.append(f"{where}: <{tag}> {link}: outside the site")
            elif parts.fragment and target in pages:
                anchor = urllib.parse.unquote(parts.fragment)
                if anchor not in pages[target].anchors:
                    messages.append(f"{where}: <{tag}> {link}: no such anchor")
    return messages
