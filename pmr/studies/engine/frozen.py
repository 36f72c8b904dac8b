"""The code of a study, read once: what its digest is made from is what its workers run, whatever is edited meanwhile.

The process that plans reads all of pmr's sources at one moment.  The digest under which results are stored is that of
these bytes, and each worker's child imports pmr from these bytes, not from the files, whenever it is started.

A child runs this file before it knows pmr: it imports the standard library alone.
"""

from __future__ import annotations

import hashlib
import json
import marshal
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache, cached_property
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import MAGIC_NUMBER, cache_from_source, source_hash, spec_from_file_location
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

PACKAGE = "pmr"
#: What a child runs first: it reads the sources from its input, `sys.argv[1]` bytes, and takes pmr from them.
START = """
import json, os, sys
read = b""
while len(read) < int(sys.argv[1]):
    read += os.read(0, int(sys.argv[1]) - len(read)) or sys.exit(1)
sent = json.loads(read)
sys.path[:] = sent["path"]
space = {"__name__": "frozen"}
exec(compile(sent["files"]["studies/engine/frozen.py"], "frozen.py", "exec"), space)
space["use"](space["Sources"](sent["root"], sent["files"]))
del read, sent, space
from pmr.studies.engine.execute import main
main()
"""


class Sources:
    """Texts of a package's modules, by path within its folder `root`."""

    def __init__(self, root: str, files: Mapping[str, str]) -> None:
        self.root, self.files = root, files

    def of(self, module: str) -> str | None:
        """Source of a module; None if it is none of the package's."""
        name = module.removeprefix(f"{PACKAGE}.").replace(".", "/")
        return self.files.get(f"{name}.py") if module.startswith(f"{PACKAGE}.") else None

    @cached_property
    def digest(self) -> str:
        """Digest of all of them."""
        return hashlib.sha256(json.dumps(sorted(self.files.items())).encode()).hexdigest()

    def as_text(self, path: Sequence[str]) -> str:
        """What a child is sent, in ASCII, with the folders in which it finds other modules."""
        return json.dumps({"root": self.root, "files": dict(self.files), "path": list(path)})


@cache
def sources() -> Sources:
    """Pmr's sources as this process found them when it asked first."""
    root = Path(__file__).resolve().parents[2]
    files = {file.relative_to(root).as_posix(): file.read_text(encoding="utf-8") for file in sorted(root.rglob("*.py"))}
    return Sources(str(root), files)


def use(frozen: Sources) -> None:
    """Import the package from these sources, in this process and from now on."""
    sys.meta_path.insert(0, _Finder(frozen))


class _Finder(MetaPathFinder):
    def __init__(self, frozen: Sources) -> None:
        self._sources = frozen

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname.partition(".")[0] != PACKAGE:
            return None
        name = "/".join(fullname.split(".")[1:])
        for file in (f"{name}.py", f"{name}/__init__.py".lstrip("/")):
            if file in self._sources.files:
                place = os.path.join(self._sources.root, file)
                loader = _Loader(fullname, place, self._sources)
                folder = [os.path.dirname(place)] if file.endswith("__init__.py") else None
                return spec_from_file_location(fullname, place, loader=loader, submodule_search_locations=folder)
        raise ModuleNotFoundError(f"No module named {fullname!r}", name=fullname)


class _Loader(SourceFileLoader):
    """Compiles the text it was given, or loads what an earlier worker compiled of the same text, found by its hash.

    Python's own compiled files go by time and size: they may be of another version that looks as old.
    """

    def __init__(self, fullname: str, path: str, frozen: Sources) -> None:
        super().__init__(fullname, path)
        self._sources = frozen

    def get_data(self, path: Any) -> bytes:
        text = self._sources.files.get(Path(os.path.relpath(path, self._sources.root)).as_posix())
        return super().get_data(path) if text is None else text.encode()

    def get_code(self, fullname: str) -> CodeType:
        text, kept = self.get_data(self.path), cache_from_source(self.path, optimization="frozen")
        of_text = MAGIC_NUMBER + (1).to_bytes(4, "little") + source_hash(text)  # as Python marks what goes by content
        with suppress(OSError, EOFError, ValueError, TypeError):
            if (found := super().get_data(kept)).startswith(of_text):
                known: CodeType = marshal.loads(found[len(of_text) :])
                return known
        code = self.source_to_code(text, self.path)
        if not sys.dont_write_bytecode:
            self.set_data(kept, of_text + marshal.dumps(code))
        return code
