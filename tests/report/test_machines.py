"""What the page says of a vehicle on a bridge, a hoist, oil and outriggers, in short runs of the workflows."""

from pathlib import Path

import numpy as np
import plain_machines
import pytest

import pmr
from pmr import RunResult
from pmr.report import forces, sections, sentences
from pmr.report.columns import rope_axis
from pmr.report.figures import space
from pmr.report.figures.space import space_drawings
from pmr.report.first_page import first_page_tables

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("undrawn")]
SPACE, MINUS = "\u00a0", "\u2212"
SHORT = ("section.mesh.elements=8", "section.reduction.coordinates=6", "time.end=0.2")


def short_run(name: str | Path, *changes: str) -> RunResult:
    """Result of a workflow, or of a scene file, without its full model and without a richer one."""
    outcome = pmr.run(pmr.load_scene(name, ["compare.against=[]", "compare.richer='none'", *changes]))
    assert outcome is not None
    return outcome.result


def rows(result: RunResult, title: str) -> dict[str, str]:
    """Rows of the table of this title, or of both tables of largest values."""
    titles = ("Largest values that have a limit", title) if title.startswith("Largest") else (title,)
    return dict(row for table in first_page_tables(result) if table.title in titles for row in table.rows)


def test_a_vehicle_is_told_by_its_place_on_the_bridge_and_counts_with_its_mass() -> None:
    """The mass on its spring is lowest beyond midspan, the bridge at midspan; masses are those of the file."""
    result = short_run("bridge", "sections.bridge.mesh.elements=20")
    asked, carries = rows(result, "What was asked"), rows(result, "Largest values of this motion")
    assert asked["bridge"].startswith(f"20{SPACE}m long, 20")
    assert asked["vehicle"].startswith(f"mass 4000{SPACE}kg, wheel mass 500{SPACE}kg")
    assert asked["total mass"].replace("\u202f", "").startswith(f"24500{SPACE}kg")
    assert asked["way of vehicle"] == f"0 to 20{SPACE}m" and "boom length" not in asked
    lowest = carries["largest displacement of vehicle, vertical, z"]
    assert "down" in lowest and "vehicle at" in lowest
    assert f", 10{SPACE}m from its tail\n" in carries["largest deflection of bridge"]
    assert carries["lowest natural frequency"].endswith(f"with vehicle at 10{SPACE}m")
    assert not any("without coordinates along x" in warning for warning in result.summary["warnings"])
    assert sentences.then_words(result) == ", and the place of vehicle then"


def test_what_hangs_on_the_hoist_stands_on_the_first_page() -> None:
    result = short_run(plain_machines.HOIST, *SHORT, "hoist.swing=[-0.01, 0.02]")
    asked, carries = rows(result, "What was asked"), rows(result, "Largest values of this motion")
    assert "largest deflection of the tip, vertical part" in carries
    assert asked["hoist"] == f"payload of 400{SPACE}kg with a hook of 50{SPACE}kg on 2 falls"  # a gust comes later
    rope = rope_axis(result, [0, -1])
    assert rope is not None
    height = result.responses["reduced"].other("hook height")[[0, -1]]
    assert rope.side[:, 1, 1] == pytest.approx(height - 2.0, abs=1e-9)  # the pivot is 2 m above the ground
    assert rope.side[0, 0, 1] - rope.side[0, 1, 1] == pytest.approx(6.0, abs=1e-2)  # hangs under its head
    inclined = rope_axis(short_run(plain_machines.HOIST, *SHORT, "frame.base={ry={kind='constant',amount=5.0}}"), [0])
    assert inclined is not None  # the sketch has the base level, so that the rope hangs aslant in it
    assert np.diff(inclined.side[0], axis=0)[0] == pytest.approx(6.0 * np.array([0.0872, -0.9962]), abs=1e-2)
    assert "the square is the payload on its rope" in space.view_caption(result, "from the side")
    assert carries["lowest natural frequency"].endswith(", without the payload of the hoist")
    swings = {way: result.summary["hoist"][f"swing_{way}"] for way in ("along", "across")}
    ends = [(of[end], way, end) for way, of in swings.items() for end in ("min", "max")]
    largest, way, end = max(ends, key=lambda of: abs(of[0]))
    side = {"along": ("inwards of", "outwards of"), "across": ("to the right of", "to the left of")}[way][end == "max"]
    degrees = f"{abs(np.rad2deg(largest)):.3g}° {way} the boom, the hook {side} the head\nat "
    assert carries["largest swing of the hook"].startswith(degrees)
    drawn = [drawing.name for drawing in space_drawings(result, "case-1") if "buckling" in drawing.name]
    assert drawn == ["case-1-buckling"]  # neither reach nor angle changes
    assert sections.input_block(result, "case-1") is None


def test_oil_has_its_pressure_and_flow_on_the_first_page() -> None:
    """Litres per minute are cubic metres per second times 60,000."""
    result = short_run("luffing_oil", *SHORT, "time.end=1.0", "frame.cylinder.allowed_push=3e5")
    asked, carries = rows(result, "What was asked"), rows(result, "Largest values of this motion")
    assert asked["luffing"].endswith(
        f", computed: oil of 21.0{SPACE}MPa through a valve and a counterbalance valve drives it"
    )
    cylinder = result.summary["luffing_cylinder"]
    assert cylinder["use"]["max"] == pytest.approx(cylinder["force"]["max"] / 3e5)
    used = f"{cylinder['use']['max']:.1%}"[:-1]
    assert f"kN, it pushes: {used}{SPACE}% of the " in carries["largest use of the luffing cylinder"]
    rod, flow = cylinder["pressure_rod"]["max"], 6e4 * cylinder["flow_supply"]["max"]
    assert rod > cylinder["pressure_bore"]["max"]
    pressure = carries["largest pressure of oil"]
    assert pressure.startswith(f"{rod / 1e6:.3g}{SPACE}MPa, on the rod side\nat ")
    assert carries["largest flow from the supply"].startswith(f"{flow:.3g}{SPACE}l/min, ")
    assert carries["lowest natural frequency"].endswith(
        ", the luffing cylinder locked: on its oil the boom swings up and down more slowly"
    )
    block = forces.driven_block(result, "case-1")
    assert block is not None
    assert [drawing.name.rpartition("-")[2] for drawing in block.drawings] == ["pressure", "flow", "power"]
    names = [row[0] for grid in forces.pivot_block(result, "case-1").grids for row in grid.rows]
    assert {"flow supply", "volume bore", "use"} <= set(names)
    cells = [row[2] for grid in forces.pivot_block(result, "case-1").grids for row in grid.rows if row[0] == "use"]
    assert cells[0].startswith(f"{cylinder['use']['max']:.1%}"[:-1] + f"{SPACE}% at ")
    assert "luffing cylinder, by the moment about the pivot" in names and "luffing cylinder" not in names


def test_a_machine_on_outriggers_says_on_what_it_stands() -> None:
    """A gust that comes after the end of the run is 0 at all times, and has no figure."""
    result = short_run(plain_machines.OUTRIGGERS, *SHORT)
    carries = rows(result, "Largest values of this motion")
    use = carries["largest use of the support polygon"]
    assert "largest deflection of the tip, vertical part" not in carries  # its ground slopes, too
    corners = [f", {of.name}\nat " for of in result.scene.frame.ground.outriggers]
    assert any(corner in carries["largest force of an outrigger"] for corner in corners)
    assert use.startswith(
        f"{100.0 * result.summary['ground']['use']['max']:.1f}{SPACE}% (the machine tips at 100{SPACE}%)\nat "
    )
    asked = rows(result, "What was asked")
    masses = f"4 outriggers, with machine masses of 7500{SPACE}kg"
    assert asked["stands on"] == f"{masses}, on ground that rises by 0.5° along X and 1° along Y"
    ground = result.scene.frame.ground
    corners = asked["outriggers, x and y from the pivot"].split("; ")
    assert corners == [
        f"{of.name} ({of.at[0]:g}, {of.at[1]:g}){SPACE}m".replace("-", MINUS) for of in ground.outriggers
    ]
    machine = asked["masses of the machine, x, y, z from the pivot"].split("; ")
    assert [text.partition(f"{SPACE}kg (")[0] for text in machine] == [f"{of.name} {of.mass:g}" for of in ground.masses]
    assert asked["fly: gust"] == "0 at all times, on tip along y"
    assert [drawing.name for drawing in sections.input_block(result, "case-1").drawings] == ["case-1-angles"]
