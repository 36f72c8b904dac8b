"""Limits of what a reader has to hold in mind: rooms, arrows between them, and no circle anywhere."""

import grimp
import pytest
import rooms

# The kernel still stands beside some of what it replaces in the rooms simulation and export.
MOST_ROOMS, MOST_ARROWS, MOST_MODULES = 19, 104, 2


@pytest.fixture(scope="module")
def imports() -> grimp.ImportGraph:
    return rooms.graph()


def test_rooms_and_the_arrows_between_them_can_be_looked_over(imports: grimp.ImportGraph) -> None:
    found = imports.find_children("pmr")
    modules = [room for room in found if not imports.find_children(room)]
    assert len(found) <= MOST_ROOMS and len(modules) + 1 <= MOST_MODULES  # and __init__
    assert 0 < len(rooms.arrows(imports)) <= MOST_ARROWS


def test_nothing_imports_in_circles(imports: grimp.ImportGraph) -> None:
    assert list(rooms.circles(imports)) == []


def test_a_circle_is_found_in_any_folder() -> None:
    imports = rooms.graph()
    imports.add_import(importer="pmr.system.body_matrices", imported="pmr.system.reduced_model")
    assert [circle.split(":")[0] for circle in rooms.circles(imports)] == ["pmr.system"]
