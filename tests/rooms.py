"""Imports between the rooms of pmr, and circles among them; ``make graph`` prints them, `test_rooms` limits them.

A room is a folder or a module of `pmr`.  Imports within functions and for type checking count as any other.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter

import grimp


def graph() -> grimp.ImportGraph:
    """Build the graph of imports between all modules of pmr."""
    return grimp.build_graph("pmr", cache_dir=None)


def arrows(imports: grimp.ImportGraph, package: str = "pmr") -> Mapping[tuple[str, str], int]:
    """Number of imports between children of a package, by (importer, imported)."""
    within = f"{package}."
    found = Counter[tuple[str, str]]()
    for module in imports.find_descendants(package):
        for imported in imports.find_modules_directly_imported_by(module):
            if imported.startswith(within):
                pair = tuple(name[len(within) :].split(".")[0] for name in (module, imported))
                found[pair] += pair[0] != pair[1]
    return +found


def circles(imports: grimp.ImportGraph) -> Iterator[str]:
    """Yield a circle of each package whose children import each other in circles, as text."""
    for package in sorted(module for module in imports.modules if imports.find_children(module)):
        needs: dict[str, set[str]] = {}
        for importer, imported in arrows(imports, package):
            needs.setdefault(importer, set()).add(imported)
        try:
            TopologicalSorter(needs).prepare()
        except CycleError as error:
            yield f"{package}: {' <- '.join(error.args[1])}"


def main() -> None:
    """Print the imports of each room, their numbers, and circles."""
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
