"""The payload of a scene's run beside what a chart allows in the run's postures."""

from pathlib import Path

import numpy as np
import pytest

import pmr.cli
from pmr.report.studies.chart_tables import lifts_more, payload_sentences
from pmr.scene import Scene, load_any
from pmr.studies.duty import LeastLoads, least_allowed, payload_of

CRANE = Path(pmr.cli.__file__).parent / "templates" / "crane.toml"
#: Extensions of both sections in m in the rows of a chart, and loads in kg that its only limit allows there.
EXTENSIONS, LOADS = (0.8, 2.65, 4.5), (3000.0, 2000.0, 1000.0)


def chart_of(names: tuple[str, ...] = ("middle", "fly")) -> tuple[LeastLoads, list[dict[str, float]]]:
    """Loads at 20, 40 and 60 degrees, the same at all angles; only sections of these `names` go out."""
    rows = [{f"extension.{name}": (x if name in names else 0.8) for name in ("middle", "fly")} for x in EXTENSIONS]
    lengths = np.array([6.0 + sum(row.values()) for row in rows])
    angles = np.deg2rad([20.0, 40.0, 60.0])
    load = np.repeat(np.array(LOADS)[:, None, None], 3, axis=1)
    place = lengths[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return LeastLoads(load, 0.0 * load, place, angles, np.arange(3)), rows


def crane(farthest: float) -> Scene:
    return load_any(CRANE, [f"section.joint.extension.values=[0.8, {farthest}]"])


def test_the_smallest_load_is_that_of_the_posture_between_two_boom_lengths() -> None:
    """Half way from 2.65 to 4.5 m the chart allows 1 / (0.5 / 2000 + 0.5 / 1000) = 1333.3 kg, at 6 + 2 * 3.575 m."""
    found = least_allowed(crane(3.575), *chart_of(), 2e4)
    assert found is not None and payload_of(crane(3.575)) == 1000.0
    assert found.load == pytest.approx(4000.0 / 3.0, rel=1e-9) and found.limit == 0
    assert found.length == pytest.approx(13.15) and found.t == pytest.approx(7.0, abs=0.015)
    assert 20.0 < np.rad2deg(found.luffing) < 60.0


def test_the_errors_of_the_loads_are_taken_off() -> None:
    """Errors of 10 % leave 0.9 / (0.5 / 2000 + 0.5 / 1000) = 1200 kg."""
    loads, rows = chart_of()
    found = least_allowed(crane(3.575), loads._replace(error=0.1 * loads.load), rows, 2e4)
    assert found is not None and found.load == pytest.approx(1200.0, rel=1e-9)


def test_postures_that_a_chart_lacks_are_not_looked_at() -> None:
    """In a chart whose fly stays inside the run has the first posture alone, 3000 kg at 7.6 m; beyond 20 t none."""
    found = least_allowed(crane(4.5), *chart_of(("middle",)), 2e4)
    assert found is not None and found.load == pytest.approx(3000.0, abs=2.0)  # within 1 mm of the first row
    assert found.length == pytest.approx(7.6, abs=2e-3)
    loads, rows = chart_of()
    found = least_allowed(crane(4.5), loads._replace(load=np.full_like(loads.load, np.nan)), rows, 2e4)
    assert found is not None and (found.load, found.limit) == (pytest.approx(2e4), -1)
    angles = loads._replace(luffing=loads.luffing + 1.0)
    assert least_allowed(crane(4.5), angles, rows, 2e4) is None


def test_the_page_says_whether_the_run_lifts_more_than_the_chart_allows() -> None:
    posture = {"payload.t": 6.9, "payload.luffing": 55.5, "payload.length": 15.0, "payload.limit": "walls"}
    for load, said in (
        (752.9, "payload of 1000 kg is more than this chart allows in the scene's run"),
        (1000.0, "payload of 1000 kg is within this chart"),
    ):
        figures = {"payload": 1000.0, "payload.load": load} | posture
        text = payload_sentences(figures, lambda kg: f"{kg:.0f} kg", True).replace("\u00a0", " ")
        assert f"which is {load:.0f} kg, error bar taken off (boom length 15 m, raised by 55.5°, limit: walls)." in text
        assert f"{said}: along this run, the chart allows least at 6.9 s," in text
        assert lifts_more({"payload": 1000.0, "payload.load": load}) is (load < 1000.0)
    unknown = payload_sentences({"payload": 1000.0}, str, True)
    assert unknown.endswith("no posture of the scene's run is in this chart.")
    assert not payload_sentences({}, str, True)
