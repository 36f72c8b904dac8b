"""Names in docstrings of the package and in tables of CONTRIBUTING.md are names of what there is."""

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
TREES = {file.relative_to(ROOT).with_suffix(""): ast.parse(file.read_text()) for file in (ROOT / "pmr").rglob("*.py")}
NODES = [node for tree in TREES.values() for node in ast.walk(tree)]
CLASSES = [node for node in NODES if isinstance(node, ast.ClassDef)]
KEYS = ("name", "asname", "id", "attr", "arg")
IN_C = {word for file in (ROOT / "pmr/kernel/src").glob("*.[ch]") for word in re.findall(r"\w+", file.read_text())}
NAMES = IN_C.union(vars(node).get(key) for node in NODES for key in KEYS)


@cache
def members(node: ast.AST) -> set[object]:
    """Names that a module or a class defines, imports, inherits, or has as a string."""
    parts = [vars(part) for part in ast.walk(node)]
    own = [of for of in parts if isinstance(of.get("ctx"), ast.Store) or getattr(of.get("value"), "id", "") == "self"]
    names = {of.get(key) for of in parts for key in ("name", "asname", "value")}
    bases = {getattr(part, "id", "") for base in getattr(node, "bases", ()) for part in ast.walk(base)}
    return names.union(
        (of.get(key) for of in own for key in KEYS), *(members(of) for of in CLASSES if of.name in bases)
    )


def exists(name: str) -> bool:
    """Whether there is what a text names; true for a name of which this test can't tell."""
    first, *rest = parts = name.split(".")
    if first == "pmr" and rest:
        ways = [Path(*parts[:k], *init) for k in range(len(parts), 0, -1) for init in ((), ("__init__",))]
        file = next(way for way in ways if way in TREES)
        return members(TREES[file]).union(file.parts).issuperset(rest)
    owners = [of for of in CLASSES if of.name == first]
    if rest and owners:
        return any(rest[0] in members(of) for of in owners)
    return bool(rest) or not re.search("[A-Z_]", name) or name in NAMES


def test_names_in_docstrings_exist() -> None:
    texts = [ast.get_docstring(of) or "" for of in NODES if isinstance(of, ast.Module | ast.ClassDef | ast.FunctionDef)]
    names = {name for text in texts for name in re.findall(r"(?<![`\w:])`([A-Za-z_][\w.]*\w)`(?!`)", text)}
    assert len(names) > 1000 and [name for name in sorted(names) if not exists(name)] == []


def test_names_in_tables_of_contributing_exist() -> None:
    """Rows of rooms name their modules and folders; other rows name files, and words of package and tests."""
    files = [file for of in ("pmr", "tests", "docs") for file in (ROOT / of).rglob("*.*")]
    words = {word for file in files if file.suffix == ".py" for word in re.findall(r"\w+", file.read_text())}
    for row in re.findall(r"^\|.*", (ROOT / "CONTRIBUTING.md").read_text(), flags=re.M):
        room = re.match(r"\| `(pmr/\w+/)` \|", row)
        for name in re.findall(r"`([\w/.]+)(?<!\.csv)`", row):
            place = rf"/{room[1]}.*\b{name.removeprefix(room[1])}\b" if room else f"/{name}"
            is_file = room or re.search(r"/|\.py$", name)
            assert any(re.search(place, str(at)) for at in files) if is_file else words.issuperset(name.split(".")), (
                name
            )
