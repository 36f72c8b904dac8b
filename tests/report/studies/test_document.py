"""Reports of small studies: what they say, and that they ask for nothing from outside."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from finished import compute, short_scene

from pmr.report.studies import document, write_report
from pmr.studies import files

pytestmark = pytest.mark.slow  # studies are computed and drawn

STUDIES = {
    "convergence": 'scene = "short.toml"\nfull = [4, 8, 20]\nancf = [4, 6, 8]',
    "scenes": 'scenes = ["short.toml"]\n[change]\ncompare.against = ["full"]\n[grid]\nreduction.coordinates = [10, 12]',
}
FIGURES = {"convergence": 1, "scenes": 3}
STATEMENT = """
[[published]]
figure = "{figure}"
text = "what somebody found"
value = {value}
quantity = "length"
why = "Their beam was another one."
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A collection's folder, put together from studies computed one by one."""
    root = tmp_path_factory.mktemp("collection")
    for kind, rest in STUDIES.items():
        part = root / kind
        part.mkdir()
        short_scene(part)
        extra = STATEMENT.format(figure="least.full", value=0.01) if kind == "convergence" else ""
        head = f'kind = "{kind}"\ntitle = "Study of {kind}"\nsource = "A paper"\n'
        (part / "study.toml").write_text(f"{head}{rest}\n{extra}")
        compute(part, files.load(part / "study.toml"))
    summary = json.loads((part / "summary.json").read_text())
    (root / "summary.json").write_text(
        json.dumps(summary | {"title": "All of them", "studies": list(STUDIES), "runs": []})
    )
    return root


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return document.render_studies(folder)


def test_every_study_is_in_the_index_and_on_the_page(page: str) -> None:
    for kind in STUDIES:
        (anchor,) = re.findall(rf'<a href="#([^"]+)">Study of {kind}</a>', page)
        assert page.count(f'id="{anchor}"') == 1
    targets = set(re.findall(r'href="#([^"]+)"', page))
    assert targets <= set(re.findall(r'id="([^"]+)"', page)) and len(targets) > 2 * len(STUDIES)


def test_every_identifier_is_unique(page: str) -> None:
    identifiers = re.findall(r' id="([^"]+)"', page)
    assert len(identifiers) == len(set(identifiers))


@pytest.mark.parametrize("kind", STUDIES)
def test_each_study_draws_its_figures(folder: Path, page: str, kind: str) -> None:
    number = list(STUDIES).index(kind) + 1
    section = page.split(f'<section class="case" id="study-{number}">')[1].split("</section>")[0]
    assert section.count("<svg") == FIGURES[kind] == section.count("<figcaption")
    assert "nan" not in re.sub(r"<[^>]+>", " ", section).lower().split()


def test_the_page_asks_for_nothing_from_outside(page: str) -> None:
    assert not re.search(r'(?:src|href)="(?!#|data:)', page)
    assert "url(http" not in page and "<script" not in page


def test_published_figures_stand_beside_ours(folder: Path, page: str) -> None:
    found = json.loads((folder / "convergence" / "summary.json").read_text())["figures"]["least.full"]
    row = page.split("what somebody found")[1].split("</tr>")[0]
    assert "10.0\u00a0mm" in row and "≠" in row and f"{1e3 * found:.4f}" in row
    assert "Their beam was another one." in page


def test_the_same_results_give_the_same_page(folder: Path, page: str) -> None:
    assert document.render_studies(folder) == page


@pytest.mark.slow
def test_both_files_are_written(folder: Path, page: str) -> None:
    written = write_report(folder)
    assert written.html.read_text() == page
    content = written.pdf.read_bytes()
    assert content.startswith(b"%PDF") and len(content) > 20_000


def test_a_study_with_a_failed_run_says_so_and_shows_its_table(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "convergence", tmp_path / "broken")
    file = tmp_path / "broken" / "summary.json"
    summary = json.loads(file.read_text())
    summary["runs"][3] |= {"status": "failed", "reason": "the bearing broke", "figures": {}}
    file.write_text(json.dumps(summary | {"figures": {}}))
    page = document.render_studies(tmp_path / "broken")
    assert "the bearing broke" in page and "Error over the number of coordinates" not in page
    assert f"{len(summary['runs']) - 1} of {len(summary['runs'])} runs are there" in page
