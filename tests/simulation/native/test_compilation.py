"""The cache on disk: used again, and not once a source has changed."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from numba import TypingError
from numba.core import caching
from numba.core.cpu import CPUContext

from pmr.files.whole import locked
from pmr.simulation.native import compilation as compiled

SOURCE = """
from pmr.simulation.native.compilation import compiled

@compiled
def twice(x):
    return 2.0 * x
"""


def load(folder: Path, name: str = "twice") -> Any:
    specification = importlib.util.spec_from_file_location("some_kernel", folder / "some_kernel.py")
    assert specification and specification.loader
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return getattr(module, name)


def test_compiled_once_and_again_after_a_change_in_the_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What compiles is loaded in order to compile alone: it takes five times as long as what is stored."""
    (tmp_path / "some_kernel.py").write_text(SOURCE)
    hits, load_all, loaded = [], CPUContext.load_additional_registries, list[str]()
    for sources in ("one", "one", "another"):
        monkeypatch.setattr(compiled, "_SOURCES", sources)
        twice = load(tmp_path)

        def counted(context: CPUContext, sources: str = f"{sources} {len(hits)}") -> None:
            loaded.append(sources)
            load_all(context)

        monkeypatch.setattr(CPUContext, "load_additional_registries", counted)
        assert twice(1.5) == 3.0
        hits.append(sum(twice.stats.cache_hits.values()))
    assert hits == [0, 1, 0] and set(loaded) == {"one 0", "another 2"}


def test_what_another_process_compiles_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "some_kernel.py").write_text(SOURCE)
    twice = load(tmp_path)
    assert twice(1.5) == 3.0 and not compiled.claimed(twice)
    (stored,) = tmp_path.glob("__pycache__/*.nbi")
    index = stored.read_bytes()
    stored.unlink()

    @contextmanager
    def stored_meanwhile(lock: Path) -> Iterator[bool]:
        assert lock.exists()
        stored.write_bytes(index)
        yield True

    again = load(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(compiled, "locked", stored_meanwhile)
        assert again(1.5) == 3.0
    assert sum(again.stats.cache_hits.values()) == 1
    with locked(stored.with_suffix(".lock")):
        assert compiled.claimed(again)
    assert not compiled.claimed(again)


def test_what_can_not_be_compiled_can_be_tried_again(tmp_path: Path) -> None:
    """Its lock isn't waited for by the process that holds it."""
    (tmp_path / "some_kernel.py").write_text(SOURCE)
    twice = load(tmp_path)
    for _ in range(2):
        with pytest.raises(TypingError):
            twice("text")
    assert twice(1.5) == 3.0


def test_where_no_folder_can_be_written_to_it_is_compiled_each_time(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "some_kernel.py").write_text(SOURCE)
    monkeypatch.setattr(caching.FunctionCache._impl_class, "_locator_classes", [])
    assert load(tmp_path)(1.5) == 3.0


def test_what_another_version_left_is_compiled_again(tmp_path: Path) -> None:
    """A type of the arguments has got another name since; Numba's index can't be read without the old one."""
    typed = SOURCE + "from typing import NamedTuple\nclass Old(NamedTuple):\n    x: float\n"
    (tmp_path / "some_kernel.py").write_text(typed.replace("2.0 * x", "2.0 * x[0]"))
    sys.path.insert(0, str(tmp_path))
    try:
        for name in ("Old", "Renamed"):  # of another length: Python tells what it compiled by second and size alone
            text = (tmp_path / "some_kernel.py").read_text().replace("Old", name)
            (tmp_path / "some_kernel.py").write_text(text)
            sys.modules.pop("some_kernel", None)
            importlib.invalidate_caches()
            module = importlib.import_module("some_kernel")
            assert module.twice(getattr(module, name)(1.5)) == 3.0
    finally:
        sys.path.remove(str(tmp_path))
        sys.modules.pop("some_kernel", None)


PARTS = """
from pmr.simulation.native.compilation import compiled, inlined

@inlined
def part(x):
    return 2.0 * x

@inlined
def both(x):
    return part(x) + part(part(x))

@compiled
def whole(x):
    return both(x) + 1.0
"""


def test_what_stands_in_others_alone_is_not_translated_by_itself(tmp_path: Path) -> None:
    (tmp_path / "some_kernel.py").write_text(PARTS)
    whole = load(tmp_path, "whole")
    assert whole(1.5) == 10.0
    for name, translated in (("part", False), ("both", False), ("whole", True)):
        (made,) = whole.py_func.__globals__[name].overloads.values()
        engine = made.target_context.codegen()._engine
        assert engine.is_symbol_defined(made.fndesc.llvm_func_name) == translated
    assert sum(whole.stats.cache_hits.values()) == 0
    again = load(tmp_path, "whole")
    assert again(1.5) == 10.0
    assert sum(again.stats.cache_hits.values()) == 1
