"""The page of an observer says what its files have: estimates, bands, innovations, and which sensor matters."""

import json
import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from oscillator import OUTPUTS, history, measured, oscillator

from pmr import InputError, Observer
from pmr.observe.measured import Observation
from pmr.observe.observer import Sensor, UnknownLoad
from pmr.report.numbers import format_percent
from pmr.report.observation import write_report

STEPS, NOISE = 150, np.array([0.05, 1e-5, 500.0])


def observation(off: float = 0.0) -> Observation:
    """Estimates of an oscillator whose displacement is known; the sensor of force is `off` by a factor 1 + off."""
    model, rng = oscillator(STEPS), np.random.default_rng(1)
    y = history(model, 60.0 * rng.standard_normal(STEPS))
    data = measured(model, y * (1.0, 1.0, 1.0 + off), NOISE, rng)
    sensors = [Sensor(name, noise, bias=noise * (name == "force")) for name, noise in zip(OUTPUTS, NOISE, strict=True)]
    truth = {OUTPUTS[1]: (model.t[::2], y[::2, 1])}
    return Observation.compute(
        Observer(model, sensors, [UnknownLoad("push", 60.0, 1e-3)]), data, True, truth, "A <day>"
    )


def page_of(folder: Path, of: Observation) -> str:
    """Text of the report, with spaces for all white space."""
    of.write(folder)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", write_report(folder).html.read_text())).split())


@pytest.mark.slow
def test_the_page_has_what_the_files_have(tmp_path: Path) -> None:
    of = observation()
    text, figures = page_of(tmp_path, of), of.summary()
    share = of.estimates.coverage(OUTPUTS[1], of.truth[OUTPUTS[1]])
    assert figures["coverage"] == {OUTPUTS[1]: share} and 0.7 < share < 1.0
    assert np.isfinite(of.truth[OUTPUTS[1]]).sum() == STEPS // 2
    assert "A <day>" in text and f"{' '.join(format_percent(share).split())} of the true values lie within" in text
    svgs = (tmp_path / "report.html").read_text().count("<svg")
    assert svgs == len(of.observer.units) + len(OUTPUTS)
    for name in (*of.observer.units, "Which sensor matters", f"without {OUTPUTS[1]}", "p-value"):
        assert name in text
    assert "disagrees with the model" not in text and (tmp_path / "report.pdf").stat().st_size > 10_000
    assert json.loads((tmp_path / "observe.json").read_text())["rms_error"][OUTPUTS[1]] < 3.0 * NOISE[1]


def test_a_sensor_that_disagrees_is_warned_of(tmp_path: Path, undrawn: None) -> None:
    text, name = page_of(tmp_path, observation(off=1e3)), OUTPUTS[2][:1].upper() + OUTPUTS[2][1:]
    assert re.search(rf"{name} disagrees with the model, is stuck or silent from \S+ m?s on\. [^.]", text)
    bands = re.findall(r"\S+ ± \S+.{1,8}", text)
    assert bands and all(re.fullmatch(r"\S*\d ± [\d.]+\s[^\d]+.*", band) for band in bands)  # one unit, behind both


def test_truth_of_nothing_that_is_estimated_is_refused() -> None:
    observer = observation().observer
    for truth in ({"nothing": (observer.model.t, observer.model.t)}, {OUTPUTS[1]: (np.array([99.0]), np.array([1.0]))}):
        with pytest.raises(InputError, match="observe"):
            Observation.compute(observer, {}, truth=truth)
