"""The rooms of pmr, which of them each imports, and circles: ``make graph`` prints it, `test_rooms` sets the limits.

A room is a folder or a module of `pmr`.  Imports within functions and for type checking count as any other.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter

import grimp


def graph() -> grimp.ImportGraph:
    """All modules of pmr and what each imports."""
    return grimp.build_graph("pmr", cache_dir=None)


def arrows(imports: grimp.ImportGraph, package: str = "pmr") -> Mapping[tuple[str, str], int]:
    """Imports between the children of a package, by importer and imported."""
    within = f"{package}."
    found = Counter[tuple[str, str]]()
    for module in imports.find_descendants(package):
        for imported in imports.find_modules_directly_imported_by(module):
            if imported.startswith(within):
                pair = tuple(name[len(within) :].split(".")[0] for name in (module, imported))
                found[pair] += pair[0] != pair[1]
    return +found


def circles(imports: grimp.ImportGraph) -> Iterator[str]:
    """One circle of each package whose children import each other in circles."""
    for package in sorted(module for module in imports.modules if imports.find_children(module)):
        needs: dict[str, set[str]] = {}
        for importer, imported in arrows(imports, package):
            needs.setdefault(importer, set()).add(imported)
        try:
            TopologicalSorter(needs).prepare()
        except CycleError as error:
            yield f"{package}: {' <- '.join(error.args[1])}"


def main() -> None:
    imports = graph()
    found, rooms = arrows(imports), sorted(imports.find_children("pmr"))
    for room in rooms:
        name = room.removeprefix("pmr.")
        print(f"{name:12} {' '.join(sorted(imported for importer, imported in found if importer == name))}".rstrip())
    modules = sum(not imports.find_children(room) for room in rooms) + 1
    print(f"\n{len(rooms)} rooms, {modules} of them modules (with __init__), {len(found)} arrows")
    print("\n".join(circles(imports)) or "no circles, in no folder either")


if __name__ == "__main__":
    main()
