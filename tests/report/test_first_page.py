"""The first page for the one who decides."""

from __future__ import annotations

from dataclasses import replace

import pytest
from boom_results import SUMMARY, MakeSpace

from pmr.report.first_page import tables
from pmr.results import Response, RunResult

SPACE = "\u00a0"


def named(response: Response) -> Response:
    """With kinds: two supports, one of which bears round-off, and pads."""
    kinds = ("beam y",) * 5 + ("beam z",) * 5 + ("tip y", "tip z") + ("pad",) * 5 + ("support", "cylinder")
    forces = response.slider_force.copy()
    forces[:, 5], forces[:, 6] = -75e3, 1e-7
    names = (*(f"force of pad {k}" for k in range(5)), "force of luffing cylinder", "force of cylinder of fly")
    found = replace(response, slider_force=forces, force_names=names, kinds=kinds, bodies=("",) * len(kinds))
    return found


@pytest.fixture(scope="module")
def result(make_space: MakeSpace) -> RunResult:
    found = make_space()
    return replace(found, responses={name: named(one) for name, one in found.responses.items()})


def rows(result: RunResult, title: str) -> dict[str, str]:
    return dict(next(table.rows for table in tables(result) if table.title == title))


def test_what_was_asked_is_said_in_rows(result: RunResult) -> None:
    asked = rows(result, "What was asked")
    assert asked["structure"] == f"a shell, box of 6{SPACE}m, 300 × 400{SPACE}mm, wall 8{SPACE}mm"
    assert asked["payload"] == f"250{SPACE}kg" and asked["gust"] == f"up to 500{SPACE}N on tip along y"


def test_each_kind_of_force_has_its_largest_with_when_and_where(result: RunResult) -> None:
    bears = rows(result, "What it carries")
    assert bears["largest pad force"].startswith(f"5.00{SPACE}kN, pad 4, at 0{SPACE}s")
    assert bears["largest force of a support"].startswith(f"−75.0{SPACE}kN, luffing cylinder, at 0{SPACE}s, s = 1.5")
    assert bears["largest von Mises stress"].startswith(f"49.0{SPACE}MPa, at 0.50{SPACE}s")
    assert bears["lowest natural frequency"] == f"6.50{SPACE}Hz, at s = 1.5{SPACE}m"


def test_no_figure_is_round_off(result: RunResult) -> None:
    """A cylinder that bears 1e-12 of the largest force, and a tip that does not move aside, have no rows."""
    assert "largest cylinder force" not in rows(result, "What it carries")
    still = {}
    for name, one in result.responses.items():
        moved = one.displacement.copy()
        moved[:, -2] = 1e-17
        still[name] = replace(one, displacement=moved)
    bears = rows(replace(result, responses=still), "What it carries")
    assert "largest deflection of the tip, y" not in bears and "largest deflection of the tip, z" in bears


def test_what_is_not_known_is_said(make_space: MakeSpace) -> None:
    summary = SUMMARY | {"step": {"beam": None, "reason": "too short"}, "errors": {}, "max_von_mises": {}}
    result = make_space(summary=summary)
    trust = rows(result, "How far to trust it")
    assert trust["model"].startswith("not known: compare.richer") and trust["time step"] == "not known: too short"
    assert trust["reduction"].startswith("not known") and trust["mesh"].startswith("not known")
    assert rows(result, "What it carries")["stress"].startswith("not computed")
    model = {"beside": "shell", "beam": 0.4, "frequency": 0.6}
    known = SUMMARY | {"budget": {"mesh": {"beam": 0.01}, "model": model}}
    trust = rows(make_space(summary=known), "How far to trust it")
    assert trust["model"] == f"40.0{SPACE}% over the run, lowest frequencies 60.0{SPACE}%, beside a shell"
    assert trust["mesh"] == f"1.00{SPACE}%" and trust["reduction"] == f"0.200{SPACE}% off the full model"


def test_masses_and_the_share_of_the_yield_stress_have_rows(result: RunResult) -> None:
    used = {"value": 0.138, "stress": 49e6, "yield": 355e6, "section": "", "t": 0.5, "position": [3.0, 0.0, 0.2]}
    masses = [{"name": "", "mass": 527.52, "attached": 250.0, "centre": [4.0, 0.0, 0.0]}]
    found = replace(result, summary=result.summary | {"utilisation": {"reduced": used}, "masses": masses})
    asked, carries = rows(found, "What was asked"), rows(found, "What it carries")
    assert asked["structure"].endswith(f"wall 8{SPACE}mm, 527.5{SPACE}kg")
    assert asked["total mass"] == f"777.5{SPACE}kg" and "total mass" not in rows(result, "What was asked")
    share = carries["largest stress over yield stress"]
    assert share == f"13.8{SPACE}% of 355{SPACE}MPa, 3{SPACE}m from the tail, at 0.5{SPACE}s"
    assert "largest stress over yield stress" not in rows(result, "What it carries")
