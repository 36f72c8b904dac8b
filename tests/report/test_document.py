import base64
import re
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest

from pmr import RunResult, report
from pmr.report import document, errors, sentences, trust
from pmr.report.blocks import END_OF_SCREEN, SCREEN, Grid
from pmr.report.document import render_runs as render
from pmr.report.document import with_date, write_report
from pmr.report.numbers import prose
from pmr.report.sections import chapter as case


class Page(HTMLParser):
    """Tags with their attributes, and the text outside of scripts and styles."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.words: list[str] = []
        self._inside: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {key: value or "" for key, value in attributes}))
        self._inside.append(tag)

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {key: value or "" for key, value in attributes}))

    def handle_endtag(self, tag: str) -> None:
        if tag in self._inside:
            while self._inside.pop() != tag:
                pass

    def handle_data(self, data: str) -> None:
        if not {"script", "style"} & set(self._inside) and data.strip():
            self.words.append(re.sub(r"[ \n]+", " ", data).strip(" "))

    @property
    def text(self) -> str:
        return " ".join(self.words)

    def attributes(self, *keys: str) -> Iterator[str]:
        return (attributes[key] for _, attributes in self.tags for key in keys if key in attributes)


@pytest.fixture(scope="session")
def html(written) -> str:
    return written.html


@pytest.fixture(scope="session")
def page(html: str) -> Page:
    return Page(html)


@pytest.fixture(scope="session")
def pdf(printed) -> bytes:
    return printed.files.pdf.read_bytes()


@pytest.fixture(scope="session")
def pdf_objects(pdf: bytes) -> bytes:
    """The objects of the PDF, which are packed in compressed streams."""
    found = [pdf]
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, flags=re.DOTALL):
        try:
            found.append(zlib.decompress(stream))
        except zlib.error:
            continue
    return b"\n".join(found)


@pytest.mark.slow
def test_files_are_html_and_pdf(printed, html: str, pdf: bytes) -> None:
    assert (printed.files.html.name, printed.files.pdf.name) == ("report.html", "report.pdf")
    assert printed.files.html.read_text(encoding="utf-8") == html
    assert html.startswith("<!doctype html>") and html.rstrip().endswith("</html>")
    assert pdf.startswith(b"%PDF-") and pdf.rstrip().endswith(b"%%EOF")


@pytest.mark.slow
def test_pdf_has_a_few_pages_for_each_case(pdf_objects: bytes) -> None:
    pages = len(re.findall(rb"/Type\s*/Page\b(?!s)", pdf_objects))
    assert 2 * 3 <= pages <= 2 * 5


@pytest.mark.slow
def test_pdf_is_set_in_the_embedded_font(pdf_objects: bytes) -> None:
    assert re.search(rb"/BaseFont\s*/[A-Z]{6}\+pmr-figures", pdf_objects)


@pytest.mark.slow
def test_nothing_in_the_page_is_unknown_to_the_pdf_writer(printed) -> None:
    assert printed.warnings == []


def test_page_asks_for_nothing_from_outside(html: str, page: Page) -> None:
    assert "http:" not in html and "https:" not in html
    references = list(page.attributes("src", "href", "xlink:href", "srcset", "data", "action", "poster"))
    assert references and all(reference.startswith(("#", "data:")) for reference in references)
    urls = re.findall(r"url\(([^)]{0,40})", html)
    assert urls and all(url.strip("\"'").startswith(("#", "data:")) for url in urls)
    assert "@import" not in html


def test_references_within_the_page_lead_somewhere(html: str, page: Page) -> None:
    identifiers = Counter(page.attributes("id"))
    assert set(identifiers.values()) == {1}
    targets = {reference[1:] for reference in page.attributes("href") if reference.startswith("#")}
    targets |= set(re.findall(r"url\(#([^)]+)\)", html))
    assert targets <= set(identifiers)
    assert {"case-1", "case-2"} <= targets  # the index


def test_titles_are_text_and_no_markup(html: str, page: Page) -> None:
    assert "Whole <case> & more" in page.text
    assert "Whole &lt;case&gt; &amp; more" in html


def test_page_says_figures_inputs_and_provenance(page: Page) -> None:
    for text in (
        "153\u00a0→\u00a03 coordinates 98\u00a0% fewer",
        "reduced against full, tip 1.05\u00a0%",
        "300\u00a0ms for 3\u00a0s of motion, 10 times faster than real time; full model 3.0\u00a0s",
        "0123456789abcdef",
        "abc1234",
        "a processor",
        "numpy\u00a01.24.2",
        "simulation, Exudyn 300\u00a0ms",
        "bending stiffness 50\u202f000\u00a0N\u00a0m²",
        "slider path ramp, times (1, 2)\u00a0s, values (1.25, 3.75)\u00a0m",
        "load M on 5\u00a0m, direction ry, signal constant, amount 4\u00a0N\u00a0m",
        "slider offsets (0, −500)\u00a0mm",
        "support clamped, on 0\u00a0m, stiffness rigid",
        "The published value rests on another step size.",
    ):
        assert text in page.text


@pytest.mark.parametrize(
    ("row", "cells"),
    [
        ("reduced against full, tip", ["1.05\u00a0%", "1.00\u00a0%", "+5.0\u00a0%", "within", "≈ within 5\u00a0%"]),
        ("reduced against full, beam", ["1.05\u00a0%", "2.00\u00a0%", "−48\u00a0%", "better", "▲ better"]),
        ("full against ANCF, tip", ["0.0740\u00a0%", "0.07\u00a0%", "+5.7\u00a0%", "within", "= same when rounded"]),
        ("largest transverse displacement", ["50.00\u00a0mm", "50\u00a0mm", "+0\u00a0%", "within",
         "≈ within 5\u00a0%"]),
        ("largest difference to the full model",
         ["1.200\u00a0mm", "1\u00a0mm", "+20\u00a0%", "worse", "▼ worse"]),
    ],
)  # fmt: skip
def test_error_table_marks_with_symbol_word_and_colour(html: str, row: str, cells: list[str]) -> None:
    line = re.search(rf'<tr>\s*<th scope="row">{row}</th>(.*?)</tr>', html, flags=re.DOTALL)
    assert line
    values = [re.sub(r"<[^>]+>", "", cell) for cell in re.findall(r"<td[^>]*>(.*?)</td>", line[1])]
    kind = re.search(r'class="mark (\w+)"', line[1])
    assert kind and [*values[:3], kind[1], values[3]] == cells
    assert f".{kind[1]} span" in html  # its colour


def section(html: str, anchor: str) -> str:
    found = re.search(rf'<section class="case" id="{anchor}">.*?</section>', html, flags=re.DOTALL)
    assert found
    return found[0]


def test_published_figures_are_absent_where_there_are_none(html: str) -> None:
    bare = Page(section(html, "case-2")).text
    assert "published" not in bare and "within 5" not in bare and "Errors" not in bare


@pytest.mark.slow
def test_saved_results_give_the_same_page_as_fresh_ones(html: str, whole: RunResult) -> None:
    fresh = case(whole, "case-1")
    assert section(render([fresh, fresh]), "case-1") == section(html, "case-1")


@pytest.mark.usefixtures("undrawn")
def test_a_case_alone_needs_no_index(whole: RunResult) -> None:
    alone = render([case(replace(whole, scene=whole.scene.model_copy(update={"published": None})), "case-1")])
    text = Page(alone).text
    assert '<nav class="index"' not in alone  # a single case needs none
    assert "<h1>Whole &lt;case&gt; &amp; more</h1>" in alone
    assert "reduced against full, tip 1.05\u00a0%" in text and "Notes:" in text
    assert "published one" not in text and "deviation" not in text


def test_without_results_there_is_no_report(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least one result"):
        write_report([], tmp_path)


def test_without_a_reduced_beam_there_is_no_report(make_result, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="Case: a report needs the response of the reduced model"):
        write_report([make_result(responses=("full",))], tmp_path)


@pytest.mark.usefixtures("undrawn")
def test_warnings_stand_by_themselves_above_values_and_their_errors(make_result) -> None:
    warned = make_result(summary=make_result().summary | {"warnings": ["mind the gap", "and < the step"]})
    page = render([case(warned, "case-1")])
    shown = re.search(r'<div class="warnings" id="case-1-warnings">(.*?)</div>', page, flags=re.S)
    assert shown and re.findall(r"<li>(.*?)</li>", shown[1]) == ["Mind the gap.", "And &lt; the step."]
    assert shown.start() < page.index("Largest values of this motion")
    assert 'class="warnings"' not in render([case(make_result(), "case-1")])


def test_forces_beside_impacts_have_a_row(make_result) -> None:
    hit = make_result(summary=make_result().summary | {"impacts": {"band": 7.6, "pad_force": 0.0112}})
    places = {row.place: row.value for row in errors.rows(hit)}
    assert places["slider force below 7.6\u00a0Hz, where the tip moves"] == "1.12\u00a0%"


def reduction(result: RunResult) -> str:
    """Text of the first page on the error of the reduction."""
    return dict(trust.trust_table(result).rows)["reduction"]


def test_the_estimate_stands_beside_the_true_error(make_result) -> None:
    estimated = {"beam": 0.0126, "tip": 0.012, "chi": 0.7, "largest": 1e-3, "seconds": 0.01}
    summary = make_result().summary | {"estimate": estimated}
    result = make_result(summary=summary)
    assert reduction(result).endswith("; the estimated error along the beam is 1.20 times the true error")
    assert "1.26\u00a0%" in [row.value for row in errors.rows(result) if row.comparison.startswith("estimated")]
    number = next(one for one in sentences.key_numbers(result) if one.label == "RMS error along the beam")
    assert number.value == "1.05\u00a0%" and number.note.endswith("; estimated without the full model 1.26\u00a0%")
    of_probe = make_result(summary=summary | {"estimate": estimated | {"probe": 0.031}})
    assert reduction(of_probe).endswith("; the estimated error at probes is at most 3.10\u00a0%")
    tiny = make_result(summary=summary | {"estimate": estimated | {"probe": 1e-12}})
    assert "; the estimated error at probes is less than " in reduction(tiny)
    alone = make_result(summary={"estimate": estimated})
    assert "estimated error along the beam" in [number.label for number in sentences.key_numbers(alone)]
    none = make_result(summary={"estimate": {"beam": None, "reason": "the basis is no good"}})
    assert reduction(none) == "not known, not even by an estimate: the basis is no good"
    assert not any("estimated" in number.label for number in sentences.key_numbers(none))
    assert reduction(make_result(summary={})).startswith("not known")


PACE = "for 3\u00a0s of motion, 10 times faster than real time"


@pytest.mark.parametrize(
    ("who", "number"),
    [
        ({"reduced": "march", "full": "march"},
         ("10\u00a0×", "as fast as the full model", f"300\u00a0ms {PACE}; full model 3.0\u00a0s")),
        ({"reduced": "march", "full": "petsc"},
         ("300\u00a0ms", "one simulation", f"{PACE}; full model 3.0\u00a0s")),
        ({"reduced": "exudyn-callback"}, ("300\u00a0ms", "one simulation", f"{PACE}; full model 3.0\u00a0s")),
    ],
)  # fmt: skip
def test_speed_is_a_ratio_where_one_simulator_did_both(make_result, who: dict[str, str], number: tuple) -> None:
    result = make_result(summary=make_result().summary | {"simulators": who})
    *_, speed, coordinates = sentences.key_numbers(result)
    assert coordinates.label == "coordinates" and speed == sentences.KeyNumber(*number)


def test_a_report_has_the_dates_of_its_results() -> None:
    assert with_date("Report", [{}, {"date": ""}]) == "Report"
    assert with_date("Report", [{"date": "2026-03-02"}]) == "Report · 2026-03-02"
    assert with_date("Report", [{"date": "2026-03-02"}, {"date": "2025-12-31"}]) == "Report · 2025-12-31 to 2026-03-02"


class Printer:
    """Keeps what it is to print."""

    def __init__(self, string: str) -> None:
        self.string = string

    def write_pdf(self, file: Path) -> None:
        file.write_text(self.string)


def test_paper_goes_without_what_is_shown_at_a_pointer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(document, "import_package", lambda _: SimpleNamespace(HTML=Printer))
    made = document.write_page(f"<p>a{SCREEN}\n1{END_OF_SCREEN}b{SCREEN}2{END_OF_SCREEN}</p>", tmp_path / "report")
    assert made.pdf.read_text() == "<p>ab</p>" and "\n1" in made.html.read_text()


def test_on_paper_figures_are_images_and_text_stays_as_it_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(document, "import_package", lambda _: SimpleNamespace(HTML=Printer))
    drawn = '<svg viewBox="0 0 2 1"><path d="M0 0"/><text>a &lt; b</text></svg>'
    text = document.write_page(
        f"<style>.pair svg {{ width: 1px }}</style><p>svg {{</p>{drawn}", tmp_path
    ).pdf.read_text()
    image = re.search('base64,([^"]*)', text)
    assert image is not None
    shown = ElementTree.fromstring(base64.b64decode(image[1]))
    assert [element.tag.rpartition("}")[2] for element in shown.iter()] == ["svg", "path", "text"]
    assert ".pair embed {" in text and "<p>svg {</p>" in text and "<svg" not in text


def test_each_text_of_the_template_of_prose_is_used_and_stands_on_one_line() -> None:
    """A macro that nothing calls would be translated and mended for nobody."""
    folder = Path(report.__file__).parent
    calls = set(re.findall(r'prose\(\s*"(\w+)"', "".join(file.read_text() for file in folder.rglob("*.py"))))
    assert calls == set(re.findall(r"{% macro (\w+)", (folder / "templates" / "prose.txt").read_text()))
    text = prose("frequencies", is_stressed=False, stays=False, part="slider", has_level_stretches=True)
    assert text == (
        "Lowest natural frequencies, numbered from the lowest, each with the slider at rest at its position. "
        "Level stretches belong to vibration along the axis."
    )
    slack = [{"start": 0.5, "end": 1.25, "snatch": 2e3}]
    assert prose("hoist", factor=1.5, weight=1e3, slack=slack) == (
        "The rope's largest force is 1.50 times the weight of 1.00\u00a0kN. It is slack from 0.5\u00a0s to "
        "1.25\u00a0s, then it pulls with up to 2.00\u00a0kN."
    )


def test_columns_of_long_texts_begin_at_their_left_edge() -> None:
    """A note of a limit was at the right edge, as numbers are."""
    note = "pad, of one pad alone: it does not contain the stress of the whole section"
    grid = Grid("", ("limit", "of", "load"), (("A", "tipping", "1 kg"), ("B", note, "2 kg")))
    assert grid.alignments == ["number", "text", "number"]
