"""Names and titles stand in a report as they were written; what can't stand in a page is spelled out."""

import re
from html import unescape
from pathlib import Path
from xml.etree import ElementTree

import pytest
from fuzz.names import fit

from pmr.errors import escape_controls
from pmr.report.blocks import Chapter, Notices
from pmr.report.document import render_runs as render
from pmr.report.document import write_report
from pmr.report.sections import chapter as case

TEXTS = {
    "mathtext": "$x^2$",
    "broken mathtext": r"$\frac{",
    "markup": "[/red] <b>&amp;</b> </text></svg><script>alert(1)</script>",
    "template": "{{ 7 * 7 }} {% raw %} %s {0}",
    "control": "a\x00\x08\x1b[31m\x9b",
    "lines": "a\nb\r\tc\u2028d",
    "direction": "\u202eabc\u2066\u200f",
    "surrogate": "F\ud800",
    "not XML": "F\ufffe\uffff",
    "underscore": "_F",
    "superscript": "F² ﬁ 😀 漢",
    "nothing": "",
    "long": "x" * 3000,
}


@pytest.fixture(scope="module")
def html(make_result) -> str:
    """A page of loads that are called what of these may be a name; its title is markup, which shows the most."""
    loads = [{"name": fit(text), "on": 5.0, "signal": 1.0} for text in TEXTS.values()]
    texts = list(TEXTS.values())
    result = make_result(
        title=TEXTS["markup"], loads=loads, summary={"warnings": texts, "notes": texts}, published=None
    )
    return render([case(result, "case-1")])


def test_the_page_is_one_that_browsers_read(html: str) -> None:
    assert re.search(r"<title>(.*?)</title>", html)[1] == unescape_once(escape_controls(TEXTS["markup"]))
    for svg in re.findall(r"<svg.*?</svg>", html, re.DOTALL):
        ElementTree.fromstring(svg)
    assert escape_controls(html.replace("\n", "")) == html.replace("\n", "")
    assert "<script>alert" not in html and "49" not in html.partition("<h1>")[2].partition("</h1>")[0]


@pytest.mark.parametrize("kind", TEXTS)
def test_a_report_shows_names_as_they_are(html: str, kind: str) -> None:
    drawn = re.search(r'<figure id="case-1-loads-0".*?(<svg.*?</svg>)', html, re.DOTALL)[1]
    legend = [unescape(found) for found in re.findall(r"<text[^>]*>([^<]*)</text>", drawn)]
    assert fit(TEXTS[kind]) in legend


@pytest.mark.slow
@pytest.mark.parametrize("kind", TEXTS)
def test_a_title_is_shown_as_it_is(kind: str) -> None:
    page = render([Chapter(anchor="case-1", title=TEXTS[kind], notices=Notices(warnings=[TEXTS[kind]]))])
    assert re.search(r"<title>(.*?)</title>", page)[1] == unescape_once(escape_controls(TEXTS[kind]))
    assert "<script>alert" not in page and "49" not in re.findall(r"<h1>(.*?)</h1>", page)
    assert escape_controls(page.replace("\n", "")) == page.replace("\n", "")


def unescape_once(text: str) -> str:
    """As a page has it: jinja writes quotes as numbers."""
    from markupsafe import escape

    return str(escape(text))


@pytest.mark.slow
def test_a_pdf_is_written_whatever_the_names(make_result, tmp_path: Path) -> None:
    everything = " ".join(text[:60] for text in TEXTS.values())
    loads = [{"name": fit(f"{everything}{i}"), "on": 5.0, "signal": 1.0} for i in range(2)]
    files = write_report([make_result(title=everything, loads=loads)], tmp_path)
    assert files.pdf.read_bytes().startswith(b"%PDF-")
