"""CITATION.cff has the form of the Citation File Format 1.2.0, as far as this file uses it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from fresnel_decomp import __version__

yaml = pytest.importorskip("yaml")
jsonschema = pytest.importorskip("jsonschema")

ROOT = Path(__file__).parent.parent

TEXT = {"type": "string", "minLength": 1}
PERSON = {
    "type": "object",
    "properties": dict.fromkeys(("family-names", "given-names", "orcid", "affiliation"), TEXT),
    "required": ["family-names", "given-names"],
    "additionalProperties": False,
}
ENTITY = {
    "type": "object",
    "properties": dict.fromkeys(("name", "website", "city", "country"), TEXT),
    "required": ["name"],
    "additionalProperties": False,
}
AUTHORS = {
    "type": "array",
    "minItems": 1,
    "uniqueItems": True,
    "items": {"anyOf": [PERSON, ENTITY]},
}
DOI = {"type": "string", "pattern": r"^10\.\d{4,9}(\.\d+)?/[A-Za-z0-9:/_;\-\.\(\)\[\]\\]+$"}
NUMBER = {"type": ["integer", "string"]}
REFERENCE = {
    "type": "object",
    "properties": {
        "type": {"enum": ["article", "book", "conference-paper", "report", "software", "thesis"]},
        "title": TEXT,
        "authors": AUTHORS,
        "journal": TEXT,
        "volume": NUMBER,
        "issue": NUMBER,
        "start": NUMBER,
        "end": NUMBER,
        "year": NUMBER,
        "doi": DOI,
        "collection-title": TEXT,
        "conference": ENTITY,
        "publisher": ENTITY,
        "institution": ENTITY,
        "url": {"type": "string", "pattern": "^https?://"},
        "repository-code": {"type": "string", "pattern": "^https?://"},
        "notes": TEXT,
    },
    "required": ["authors", "title", "type"],
    "additionalProperties": False,
}
SCHEMA = {
    "type": "object",
    "properties": {
        "cff-version": {"const": "1.2.0"},
        "message": TEXT,
        "title": TEXT,
        "type": {"enum": ["software", "dataset"]},
        "version": TEXT,
        "license": {"const": "BSD-3-Clause"},
        "authors": AUTHORS,
        "keywords": {"type": "array", "minItems": 1, "uniqueItems": True, "items": TEXT},
        "abstract": TEXT,
        "doi": DOI,
        "date-released": {"type": "string", "pattern": r"^\d{4}-\d{2}-\d{2}$"},
        "repository-code": {"type": "string", "pattern": "^https?://"},
        "url": {"type": "string", "pattern": "^https?://"},
        "preferred-citation": REFERENCE,
        "references": {"type": "array", "minItems": 1, "uniqueItems": True, "items": REFERENCE},
    },
    "required": ["authors", "cff-version", "message", "title"],
    "additionalProperties": False,
}


def citation() -> Any:
    # dates stay text, as the format wants them
    return yaml.load((ROOT / "CITATION.cff").read_text(encoding="utf-8"), yaml.BaseLoader)


def test_form() -> None:
    jsonschema.validate(citation(), SCHEMA)


@pytest.mark.parametrize(
    "change",
    [
        {"cff-version": "1.1.0"},
        {"authors": []},
        {"licence": "BSD-3-Clause"},
        {"preferred-citation": {"type": "talk", "title": "x", "authors": [{"name": "y"}]}},
        {"preferred-citation": {"type": "article", "title": "x"}},
        {"doi": "https://doi.org/10.1145/3388767.3407325"},
    ],
    ids=["version", "nobody", "spelling", "type", "authors", "doi"],
)
def test_another_form_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(citation() | change, SCHEMA)


def test_it_names_the_talk_and_this_licence() -> None:
    found = citation()
    talk = found["preferred-citation"]
    assert [author["family-names"] for author in talk["authors"]] == ["Belcour", "Bati", "Barla"]
    assert (talk["year"], talk["doi"]) == ("2020", "10.1145/3388767.3407325")
    licence = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert licence.startswith("BSD 3-Clause License\n")
    assert len(re.findall(r"^\d\. ", licence, re.M)) == 3
    page = (ROOT / "docs" / "cite.md").read_text(encoding="utf-8")
    assert talk["title"].replace("Fresnel", "{Fresnel}").split(":")[0] in page
    assert talk["doi"] in page
    assert found["version"] in page


def test_version_and_year_are_said_alike() -> None:
    """In CITATION.cff, in the BibTeX entry, in the package; the changelog once it has a date."""
    found = citation()
    page = (ROOT / "docs" / "cite.md").read_text(encoding="utf-8")
    entry = re.search(r"@software\{.*?\n\}", page, re.S)
    assert entry
    fields = dict(re.findall(r"^  (\w+) *= \{(.*)\},$", entry[0], re.M))
    assert fields["version"] == found["version"] == __version__
    assert fields["year"] == found["date-released"][:4]
    assert fields["license"] == found["license"]
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    heading = re.search(rf"^## {re.escape(__version__)} \((.*)\)$", changes, re.M)
    assert heading
    assert heading[1] in ("unreleased", found["date-released"])
