"""Lean SVG: what matplotlib writes, fit to stand in a page beside other figures and quick to set in a PDF."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterator
from html import escape
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import matplotlib as mpl
from fontTools import subset
from fontTools.ttLib import TTFont
from matplotlib.figure import Figure
from matplotlib.text import Text

from pmr.errors.text import visible

FONT = "pmr figures"  # family under which the page brings the font along
_SVG, _XLINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}"
_REFERENCE = re.compile(r"#([^)]+)")
_NUMBER = re.compile(r"-?\d+\.\d+")
_FILE = Path(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")


def svg(figure: Figure, name: str, description: str) -> str:
    """The figure as an ``<svg>`` element with identifiers of its own.

    Text stays text, so that it can be searched, in the font `FONT` that the page embeds: it looks the same in
    every browser and in the PDF.  Styles become attributes, groups that only structure are dissolved, and
    coordinates get two decimals of a point, which keeps pages with dozens of figures small and quick.

    Parameters
    ----------
    figure : Figure
    name : str
        Unique in the page; put before every identifier.
    description : str
        For those who listen to the page.
    """
    buffer = io.BytesIO()
    for words_in_it in figure.findobj(Text):
        words_in_it.set_parse_math(False)  # a user's $ is a dollar
        words_in_it.set_text(visible(words_in_it.get_text()))
    with mpl.rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    root = ElementTree.fromstring(buffer.getvalue())
    used = {target for element in root.iter() for target in _targets(element)}
    box = root.get("viewBox", "0 0 1 1")
    _, _, width, height = box.split()
    content = "".join(_write_element(child, name, used) for child in _flat(root))
    return (
        f'<svg viewBox="{box}" width="{width}pt" height="{height}pt" role="img" stroke-linejoin="round" '
        f'font-family="{FONT}" aria-label="{escape(visible(description))}">{content}</svg>'
    )


def words(drawn: str) -> str:
    """All text in an SVG, for the choice of characters that the embedded font needs."""
    return "".join(re.findall(r">([^<]+)<", drawn))


def _targets(element: Element) -> Iterator[str]:
    """Identifiers that an element refers to."""
    for attribute in (f"{_XLINK}href", "clip-path"):
        yield from _REFERENCE.findall(element.get(attribute, ""))


def _flat(parent: Element) -> Iterator[Element]:
    """Children of `parent`, with groups that carry nothing replaced by what they hold."""
    for child in parent:
        if child.tag == f"{_SVG}g" and not set(child.attrib) - {"id"}:
            yield from _flat(child)
        elif child.find(f"{_SVG}style") is None:
            yield child


def _write_element(element: Element, name: str, used: set[str]) -> str:
    tag = element.tag.removeprefix(_SVG)
    attributes = "".join(f' {key}="{escape(value)}"' for key, value in _attributes(element, name, used))
    content = escape(element.text or "").strip() if tag == "text" else ""
    content += "".join(_write_element(child, name, used) for child in _flat(element))
    return f"<{tag}{attributes}>{content}</{tag}>" if content else f"<{tag}{attributes}/>"


def _attributes(element: Element, name: str, used: set[str]) -> Iterator[tuple[str, str]]:
    for key, value in element.attrib.items():
        if key == "id":
            if value in used:
                yield key, f"{name}-{value}"
        elif key == "style":
            declarations = (declaration.split(":", 1) for declaration in value.split(";") if ":" in declaration)
            yield from ((k.strip(), v.strip()) for k, v in declarations if k.strip() != "font-family")
        elif key in (f"{_XLINK}href", "clip-path"):
            yield key.removeprefix(_XLINK), value.replace("#", f"#{name}-")
        elif key == "d":
            yield key, _short(" ".join(value.split()))
        elif key == "transform" and value.startswith("rotate(-0 "):
            continue
        else:
            yield key, _short(value)


def _short(numbers: str) -> str:
    return _NUMBER.sub(lambda number: f"{float(number[0]):.2f}".rstrip("0").rstrip("."), numbers)


def font_face_rule(family: str, characters: str) -> str:
    """A CSS ``@font-face`` rule that holds DejaVu Sans, reduced to `characters`, under the name `family`."""
    options = subset.Options(layout_features=[], hinting=False, notdef_outline=True)
    options.drop_tables += ["FFTM"]
    font = TTFont(_FILE, recalcTimestamp=False)
    del font["GSUB"], font["GPOS"]  # slow to read: no ligatures are asked for, and "kern" has the same kerning
    subsetter = subset.Subsetter(options)
    subsetter.populate(text=characters + " ")
    subsetter.subset(font)
    buffer = io.BytesIO()
    font.flavor = "woff"
    font.save(buffer)
    data = base64.b64encode(buffer.getvalue()).decode()
    return f'@font-face{{font-family:"{family}";src:url(data:font/woff;base64,{data}) format("woff")}}'
