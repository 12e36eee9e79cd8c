"""Sphinx configuration. Builds without a network; the pages need none either.

Notebooks are kept as text in `notebooks/`. Each is rendered by the page of the same name in
`docs/notebooks/` and executed while the documentation is built (smaller pictures without LLVM).
"""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path
from typing import Any

import sphinx.ext.autosummary
from docutils.nodes import SkipNode
from docutils.utils.math import latex2mathml

from fresnel_decomp import __version__

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = ROOT / "notebooks"

project = "fresnel_decomp"
author = "The fresnel_decomp authors"
copyright = author
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
]
exclude_patterns = ["_build"]
default_role = "py:obj"  # single backticks in docstrings: a link where the name is documented

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_in_temp = True
nb_output_stderr = "remove"
nb_ipywidgets_js: dict[str, Any] = {}  # would be loaded from the network
nb_mime_priority_overrides = [  # sliders need a kernel: show their picture
    ("html", "application/vnd.jupyter.widget-view+json", None),
]

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # types are in the docstrings, with shapes and ranges
autosummary_generate = False
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"fresnel_decomp {version}"
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False


def setup(app: Any) -> None:
    app.add_html_math_renderer("mathml", (_inline_math, None), (_display_math, None))
    app.connect("source-read", _insert_notebook)
    app.connect("autodoc-process-docstring", _repair_docstring, priority=100)  # before napoleon
    app.connect("autodoc-process-docstring", _restore_docstring, priority=900)  # and after it


def _inline_math(translator: Any, node: Any) -> None:
    translator.body.append(_mathml(node.astext(), as_block=False))
    raise SkipNode


def _display_math(translator: Any, node: Any) -> None:
    mathml = _mathml(node.astext(), as_block=True)
    style = "overflow-x: auto; padding-top: 0.3em"
    translator.body.append(f'<div class="math" style="{style}">{mathml}</div>')
    raise SkipNode


def _mathml(text: str, as_block: bool) -> str:
    """MathML, after what docutils' translation of LaTeX misreads was put in other words."""
    text = re.sub(r"\\([dt]?frac)(\d)(\d)", r"\\\1{\2}{\3}", text)
    mathml = latex2mathml.tex2mathml(text, as_block=as_block).replace("\u02c9", "\u00af")
    bar = (
        r'<munderover>\s*(<mi>\w</mi>)\s*(\S*)\s*(<mo stretchy="false">\u00af</mo>)\s*</munderover>'
    )
    return re.sub(bar, r'<msub><mover accent="true">\1\3</mover>\2</msub>', mathml)


def _insert_notebook(app: Any, docname: str, source: list[str]) -> None:
    """Replace the text of a page in `notebooks/` by the notebook, in MyST-NB's own format."""
    folder, _, name = docname.rpartition("/")
    if folder == "notebooks":
        notebook = NOTEBOOKS / f"{name}.py"
        source[0] = _myst_notebook(notebook.read_text(encoding="utf-8"))
        app.env.note_dependency(str(notebook))


def _myst_notebook(text: str) -> str:
    """A py:percent notebook as MyST Markdown."""
    metadata = {
        "file_format": "mystnb",
        "kernelspec": {"name": "python3", "display_name": "Python 3"},
        "language_info": {"name": "python", "pygments_lexer": "ipython3"},
    }
    parts = [f"---\n{json.dumps(metadata)}\n---\n"]
    _, *cells = re.split(r"^# %%", text, flags=re.M)
    for cell in cells:
        head, _, body = cell.partition("\n")
        if "[markdown]" in head:
            parts.append(re.sub(r"^# ?", "", body.strip("\n"), flags=re.M))
        else:
            body = re.sub(r"  # noqa: \w+$", "", body.strip("\n"), flags=re.M)
            parts.append("````{code-cell} python3\n" + body + "\n````")
    return "\n\n".join(parts) + "\n"


def _repair_docstring(
    app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]
) -> None:
    """Our docstrings are plain text; make reStructuredText of what it would misread.

    |m| is a modulus and not a substitution, **options not bold, indented paragraphs of module
    docstrings are equations, and what a function returns may take several lines to say.
    """
    equation = "    " if what == "module" else ">>> "
    escaped = (line if line.startswith(equation) else line.replace("|", r"\|") for line in lines)
    text = "\n".join(escaped)
    text = re.sub(r"(?m)^(\*+)(?=\w+ : )", lambda stars: r"\*" * len(stars[1]), text)
    if what == "module":
        text = re.sub(r"(?m)^(\S.*[^:\n]:?)\n\n(?=    \S)", r"\1\n\n::\n\n", text)
    text = re.sub(r"(?m)^Returns\n-+\n((?:.+\n?)+)", _returns, text)
    lines[:] = text.split("\n")
    if what in _DATA:
        _repaired[name] = list(lines)


def _restore_docstring(
    app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]
) -> None:
    """Undo that napoleon takes what precedes a colon for a type."""
    if what in _DATA and name in _repaired:
        lines[:] = _repaired[name]


_DATA = ("attribute", "data", "property")
_repaired: dict[str, list[str]] = {}


def _returns(section: re.Match[str]) -> str:
    """A type and a description of it, unless the results have names."""
    if re.match(r"\w+(, \w+)* : ", section[1]):
        return section[0]
    text = section[1].rstrip()
    end = _end_of_type(text)
    kind, rest = (" ".join(part.split()) for part in (text[:end], text[end + 1 :]))
    description = f"    {rest}\n" if rest else ""
    return f"Returns\n-------\n{kind}\n{description}"


def _end_of_type(text: str) -> int:
    """Where a first punctuation mark stands outside of brackets, or an indented line begins."""
    depth = 0
    for i, (here, following) in enumerate(itertools.pairwise(text)):
        depth += (here in "([{") - (here in ")]}")
        if depth == 0 and ((here in ",;.:" and following.isspace()) or text[i : i + 2] == "\n "):
            return i
    return len(text)


def _first_paragraph(doc: list[str], settings: Any) -> str:
    """The first line of a docstring says it all; do not cut it at "Eq."."""
    return " ".join(itertools.takewhile(str.strip, itertools.dropwhile(_blank, doc)))


def _blank(line: str) -> bool:
    return not line.strip()


sphinx.ext.autosummary.extract_summary = _first_paragraph
