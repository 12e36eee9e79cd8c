"""Links lead somewhere: in Markdown files as they are, and in a built site. No network needed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from links import broken_links

ROOT = Path(__file__).parent.parent
FILES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *ROOT.glob("scripts/*.md")])


def prose(path: Path) -> str:
    """The text without code, in which brackets mean other things; captions of figures stay."""
    text = path.read_text(encoding="utf-8")
    text = re.sub(
        r"^```(\S*).*?^```$",
        lambda block: block[0] if block[1].startswith("{fig") else "",
        text,
        flags=re.S | re.M,
    )
    return re.sub(r"``.*?``|(?<!`)`[^`\n]*`(?!`)", "`code`", text)


def links(path: Path) -> Iterator[str]:
    """Targets of links and pictures; of directives that show a file, too."""
    text = prose(path)
    yield from re.findall(r"\]\(<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\)", text)
    text = path.read_text(encoding="utf-8")
    yield from re.findall(r"^```\{(?:figure|image|include)\} (\S+)$", text, re.M)
    yield from re.findall(r"^:file: (\S+)$", text, re.M)


def anchors(path: Path) -> set[str]:
    """Of headings, as GitHub and MyST make them, and explicit ones."""
    text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.S | re.M)
    found = set(re.findall(r"^\(([\w-]+)\)=$", text, re.M))
    for heading in re.findall(r"^#+ (.+)$", text, re.M):
        kept = re.sub(r"[^\w\- ]", "", heading.strip().lower())
        found.add(kept.replace(" ", "-"))
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_of_markdown_files(path: Path) -> None:
    for link in links(path):
        if re.match(r"[a-z]+:", link):
            assert re.match(r"https://[\w.-]+\.\w+(/|$)|mailto:", link), link
            continue
        name, _, anchor = link.partition("#")
        target = (path.parent / name).resolve() if name else path
        assert target.exists(), f"{path.name}: {link}"
        assert ROOT in [target, *target.parents], f"{path.name}: {link}"
        if anchor and target.suffix == ".md":
            assert anchor in anchors(target), f"{path.name}: {link}"


def test_there_are_links() -> None:
    """The patterns find what they are for."""
    found = [link for path in FILES for link in links(path)]
    assert len(found) > 100
    assert "https://doi.org/10.1145/3388767.3407325" in found
    assert "figures/fig01b_beryllium.png" in found
    assert "figures/split_sum_table.csv" in found
    assert "recipes.md#accuracy" in found


SITE = {
    "index.html": '<h1 id="top"></h1><a href="sub/page.html#here">x</a><a href="#top">x</a>'
    '<img src="a%20b.png"><a href="https://example.org/x">x</a><a href="mailto:a@b.c">x</a>',
    "sub/page.html": '<span id="here"></span><a href="../index.html">x</a>'
    '<link rel="stylesheet" href="../s.css?v=1">',
    "s.css": "",
    "a b.png": "",
}


@pytest.fixture
def site(tmp_path: Path) -> Path:
    for name, text in SITE.items():
        path = tmp_path / "site" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return tmp_path / "site"


def test_whole_site(site: Path) -> None:
    assert broken_links(site) == []


@pytest.mark.parametrize(
    ("link", "message"),
    [
        ('<a href="none.html">', "no such file"),
        ('<img src="none.png">', "no such file"),
        ('<a href="sub/page.html#gone">', "no such anchor"),
        ('<a href="#gone">', "no such anchor"),
        ('<a href="../secret.txt">', "outside the site"),
        ('<a href="file:///etc/hosts">', "no address"),
        ('<a href="https://localhost">', "no address"),
    ],
)
def test_broken_links_are_found(link: str, message: str, site: Path) -> None:
    (site.parent / "secret.txt").touch()
    with (site / "index.html").open("a", encoding="utf-8") as file:
        file.write(link)
    (found,) = broken_links(site)
    assert message in found
