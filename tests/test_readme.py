"""What the README shows works, and what it points to exists."""

import ast
import importlib
import re
from pathlib import Path

import pytest

import pmr

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def test_the_python_example_is_short() -> None:
    """`.ci/manual` runs it."""
    (example,) = re.findall(r"```python\n(.*?)```", README, flags=re.S)
    assert len([line for line in example.splitlines() if line.strip()]) <= 15


def test_links_and_commands_exist() -> None:
    for target in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (ROOT / target).exists(), target
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"^ +make (\S+)", README, flags=re.M):
        assert re.search(rf"^{target}:", makefile, flags=re.M), target
    for scene in re.findall(r"workflows/\w+\.toml", README):
        assert (ROOT / scene).is_file(), scene


@pytest.mark.parametrize(
    "page",
    [
        "README.md",
        *sorted(str(f.relative_to(ROOT)) for f in (ROOT / "docs").rglob("*.md")),
        *sorted(str(f.relative_to(ROOT)) for f in (ROOT / "workflows").rglob("*.py")),
    ],
)
def test_what_python_of_a_page_imports_is_there(page: str) -> None:
    """`.ci/manual` runs the pages and slow tests the experiments; a name that has moved is seen here."""
    text = (ROOT / page).read_text()
    for block in [text] if page.endswith(".py") else re.findall(r"^```python\n(.*?)^```$", text, flags=re.M | re.S):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "pmr":
                module = importlib.import_module(node.module)
                absent = [name.name for name in node.names if not hasattr(module, name.name)]
                assert not absent, f"{page}: {node.module} has no {', '.join(absent)}"
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "pmr":
                assert hasattr(pmr, node.attr) or importlib.import_module(f"pmr.{node.attr}"), f"{page}: {node.attr}"


@pytest.mark.parametrize("name", ["CONTRIBUTING.md", "CHANGELOG.md", "LICENSE"])
def test_what_a_project_has(name: str) -> None:
    assert (ROOT / name).stat().st_size > 200


def test_the_tests_of_the_validation_exist() -> None:
    rows = re.findall(r"\| (tests/\S+\.py)::(\w+) \|", (ROOT / "docs" / "validation.md").read_text())
    assert len(rows) > 20
    for file, name in rows:
        assert f"\ndef {name}(" in (ROOT / file).read_text(), (file, name)


def test_the_citation_has_this_version_and_the_papers_authors() -> None:
    cited = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {pmr.__version__}\n" in cited
    paper = re.search(r"Weyrer, Gerstmayr, Mikkola and Orzechowski, \*(.+?)\*", README, flags=re.S)
    assert paper and f'title: "{" ".join(paper[1].split())}: Formulation and Evaluation"' in cited
    names = re.findall(r"family-names: (\w+), given-names: (\w+)\}", cited)
    assert names[:4] == [
        ("Weyrer", "Sebastian"),
        ("Gerstmayr", "Johannes"),
        ("Mikkola", "Aki"),
        ("Orzechowski", "Grzegorz"),
    ]
