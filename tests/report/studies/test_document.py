"""Reports of small studies: what they say, and that they ask for nothing from outside."""

import json
import re
import shutil
from pathlib import Path

import pytest
from finished import compute, short_scene

from pmr.report.studies import render_studies, write_report
from pmr.studies import call

pytestmark = pytest.mark.slow  # studies are computed and drawn

SCENES = 'scenes = ["short.toml"]\n[change]\ncompare.against = ["full"]\n[grid]\n'
STUDIES = {"steps": f"{SCENES}time.step = [1e-3, 5e-4]", "coordinates": f"{SCENES}reduction.coordinates = [10, 12]"}
STATEMENT = {
    "figure": "largest", "text": "what somebody found", "value": 0.001, "quantity": "length",
    "why": "Their beam was another one.",
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A collection's folder, put together from studies computed one by one."""
    root = tmp_path_factory.mktemp("collection")
    for name, rest in STUDIES.items():
        part = root / name
        part.mkdir()
        short_scene(part)
        head = f'kind = "scenes"\ntitle = "Study of {name}"\nsource = "A paper"\n'
        (part / "study.toml").write_text(f"{head}{rest}\n")
        compute(part, call.load(part / "study.toml"))
        summary = json.loads((part / "summary.json").read_text())
        published = [STATEMENT] if name == "steps" else []
        shown = {"figures": {"largest": 0.01234}, "published": published}
        (part / "summary.json").write_text(json.dumps(summary | shown))
    (root / "summary.json").write_text(
        json.dumps(summary | {"title": "All of them", "studies": list(STUDIES), "runs": []})
    )
    return root


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return render_studies(folder)


def test_every_study_is_in_the_index_and_on_the_page(page: str) -> None:
    for name in STUDIES:
        (anchor,) = re.findall(rf'<a href="#([^"]+)">Study of {name}</a>', page)
        assert page.count(f'id="{anchor}"') == 1
    targets, identifiers = (re.findall(rf' {key}([^"]+)"', page) for key in ('href="#', 'id="'))
    assert set(targets) <= set(identifiers) and len(set(targets)) > 2 * len(STUDIES)
    assert len(identifiers) == len(set(identifiers))


@pytest.mark.parametrize(("number", "figures"), [(1, 2), (2, 3)])
def test_each_study_draws_its_figures(page: str, number: int, figures: int) -> None:
    section = page.split(f'<section class="case" id="study-{number}">')[1].split("</section>")[0]
    assert section.count("<svg") == figures == section.count("<figcaption")
    assert "nan" not in re.sub(r"<[^>]+>", " ", section).lower().split()


def test_the_page_asks_for_nothing_from_outside(page: str) -> None:
    assert not re.search(r'(?:src|href)="(?!#|data:)', page)
    assert "url(http" not in page and "<script" not in page


def test_published_figures_stand_beside_ours(page: str) -> None:
    row = page.split("what somebody found")[1].split("</tr>")[0]
    assert "1.0" in row and "≠" in row and "12.3" in row
    assert "Their beam was another one." in page


@pytest.mark.slow
def test_both_files_are_written(folder: Path, page: str) -> None:
    written = write_report(folder)
    assert written.html.read_text() == page
    content = written.pdf.read_bytes()
    assert content.startswith(b"%PDF") and len(content) > 20_000


def test_a_study_with_a_failed_run_says_so_and_shows_its_table(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "steps", tmp_path / "broken")
    file = tmp_path / "broken" / "summary.json"
    summary = json.loads(file.read_text())
    summary["runs"][1] |= {"status": "failed", "reason": "the bearing broke", "figures": {}}
    file.write_text(json.dumps(summary | {"figures": {}, "hints": ["up_to = 1 kg is unusual"]}))
    page, count = render_studies(tmp_path / "broken"), len(summary["runs"])
    assert "(failed: the bearing broke)" in page and "<li>Up_to = 1 kg is unusual.</li>" in page
    assert f"{count - 1} of {count} runs are done" in page
    summary["runs"] = [run | {"status": "failed", "reason": "the bearing broke"} for run in summary["runs"]]
    file.write_text(json.dumps(summary | {"figures": {}}))
    page = render_studies(tmp_path / "broken")
    assert f"Without a result: {count} of {count} runs (failed: the bearing broke)</p>" in page
    assert page.count("the bearing broke") == 1
