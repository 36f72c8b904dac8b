"""Results that formulas give: nothing is simulated, so every number of a report is known beforehand."""

import logging
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import unescape
from typing import Any

import numpy as np
import pytest
from boom_results import boom, make_fields, make_space  # noqa: F401 fixtures

from pmr import Response, RunResult
from pmr.report.document import ReportFiles, render_runs, write_page
from pmr.report.sections import chapter
from pmr.results import BodyResult, Energy, Frequencies, Loads, Paths, Shapes
from pmr.scene import Scene

MakeResult = Callable[..., RunResult]

PUBLISHED = {
    "source": "a paper",
    "errors": {"reduced_vs_full": {"tip": 0.01, "beam": 0.02}, "full_vs_ancf": {"tip": 0.0007}},
    "max_displacement": 0.05,
    "max_error": 0.001,
}
SUMMARY = {
    "errors": {"reduced_vs_full": {"tip": 0.0105, "beam": 0.0105}, "reduced_vs_ancf": {"tip": 0.03, "beam": 0.04},
     "full_vs_ancf": {"tip": 0.00074, "beam": 0.001}},
    "max_displacement": 0.05,
    "max_error": 0.0012,
    "coordinates": {"full": 153, "reduced": 3},
    "basis": {"kappa": 0.99875, "singular_values": [1.0, 0.1, 0.01, 0.001]},
    "seconds": {"assemble": 0.25, "snapshots": 0.5, "pod": 0.004, "simulate": {"exudyn": 0.3, "full": 3.0,
     "ancf": 2.0}},
    "versions": {"pmr": "0.1.0", "numpy": "1.24.2"},
    "commit": "abc1234",
    "machine": {"processor": "a processor", "cores": "2"},
    "scene_hash": "0123456789abcdef",
    "notes": ["The published value rests on another step size."],
}  # fmt: skip


@pytest.fixture(scope="session")
def make_result() -> MakeResult:
    """Function that builds a result with chosen responses, sliders, loads, length and summary."""

    def make(
        responses: Sequence[str] = ("full", "ancf", "reduced"),
        title: str = "Case",
        steps: int = 3000,
        offsets: tuple[float, ...] = (0.0,),
        loads: Sequence[dict[str, Any]] = ({"name": "F", "on": 5.0, "signal": -50.0},),
        published: dict[str, Any] | None = None,
        summary: dict[str, Any] | None = None,
        closed_form: bool = True,
        **sections: Any,
    ) -> RunResult:
        """Build a result; `sections` are further keys of the scene."""
        scene = Scene.model_validate(
            {
                "title": title,
                "body": {"profile": {"length": 5.0, "bending_stiffness": 5.0e4, "mass_per_length": 78.0}},
                "supports": [{"on": 0.0}],
                "mesh": {"elements": 10},
                "slider": {"path": {"kind": "ramp", "times": [1.0, 2.0], "values": [1.25, 3.75]}, "offsets": offsets},
                "loads": list(loads),
                "time": {"end": steps * 1e-3, "step": 1e-3},
                "reduction": {"basis": "eigenmodes"},
                "published": published,
                **sections,
            }
        )
        t = np.arange(steps + 1) * 1e-3
        return RunResult(
            scene=scene,
            summary=SUMMARY if summary is None else summary,
            responses={name: _response(name, t, len(offsets)) for name in responses},
            paths=Paths(("slider",), scene.slider.path.value(t)[:, None], scene.slider.path.rate(t)[:, None]),
            loads=_loads(scene, t),
            bodies={"": BodyResult(Shapes(np.array([1.0, 0.1, 0.01, 0.001]), X, np.stack([X, X**2, 0.0 * X], axis=1)))},
            frequencies=_frequencies(closed_form),
        )

    return make


X = np.linspace(0.0, 5.0, 11)


def _response(name: str, t: np.ndarray, sliders: int) -> Response:
    """Response of a model at the times t (T,), with so many slider forces."""
    size = {"full": 1.0, "ancf": 1.001, "reduced": 0.99}[name]
    tip = 0.05 * size * np.sin(2.0 * np.pi * 2.0 * t)
    unknown = np.full(len(t), np.nan)
    tiny = 1e-12 * (1.1 + np.sin(40.0 * t))
    return Response(
        t=t,
        x=X,
        displacement=np.outer(tip, (X / 5.0) ** 2),
        energy=Energy(size * np.sin(t) ** 2, size * np.cos(t) ** 2, -size * t),
        slider_force=100.0 * size * np.stack([np.cos(t + j) for j in range(sliders)], axis=1),
        residual_position=unknown if name == "ancf" else tiny,
        residual_velocity=unknown if name == "ancf" else 1e3 * tiny,
        seconds={"full": 3.0, "ancf": 2.0, "reduced": 0.3}[name],
        output_names=(*(f"z at {x:g} m" for x in X[:-1]), "tip z"),
        force_names=("force of slider",) if sliders == 1 else tuple(f"force of slider {k + 1}" for k in range(sliders)),
        kinds=(*("beam z",) * (len(X) - 1), "tip z", *("pad",) * sliders),
        bodies=("",) * (len(X) + sliders),
    )


def _loads(scene: Scene, t: np.ndarray) -> Loads:
    """Loads of a scene at the times t (T,)."""
    units = tuple("N m" if load.direction.startswith("r") else "N" for load in scene.loads)
    values = np.stack([load.signal.value(t) for load in scene.loads], axis=1)
    return Loads(tuple(load.name for load in scene.loads), units, values)


def _frequencies(closed_form: bool) -> Frequencies:
    """Frequencies along the path of the full and the reduced model, with closed forms or without."""
    s = np.linspace(1.25, 3.75, 9)
    f = np.stack([1.0 + s, 10.0 + s, 30.0 + s], axis=1)
    return Frequencies(s, s[:, None], {"full": f, "reduced": 1.01 * f} | ({"closed_form": f} if closed_form else {}))


@pytest.fixture(scope="session")
def whole(make_result: MakeResult) -> RunResult:
    """Result with everything that a report can show."""
    return make_result(title="Whole <case> & more", published=PUBLISHED)


@pytest.fixture(scope="session")
def bare(make_result: MakeResult) -> RunResult:
    """Result without anything that may be absent, but with two sliders and three loads, one of which is a moment."""
    return make_result(
        responses=("reduced",),
        title="Bare case",
        closed_form=False,
        summary={},
        offsets=(0.0, -0.5),
        loads=(
            {"name": "F", "on": 5.0, "signal": -50.0},
            {"name": "G", "on": 2.5, "signal": {"kind": "sine", "amplitude": 2.0e3, "frequency": 3.0}},
            {"name": "M", "on": 5.0, "direction": "ry", "signal": 4.0},
        ),
        supports=[{"on": 0.0, "kind": "clamped"}],
        damping={"mass": 0.1},
    )


@dataclass(frozen=True)
class Written:
    """Report of the cases `whole` and `bare` as HTML."""

    html: str

    def svg(self, case: str, name: str) -> str:
        """SVG of a figure of a case."""
        return self._figure(case, name)[1]

    def caption(self, case: str, name: str) -> str:
        """Caption of a figure of a case."""
        return unescape(self._figure(case, name)[2])

    def texts(self, case: str, name: str) -> list[str]:
        """All texts in a figure of a case."""
        return [unescape(text) for text in re.findall(r"<text[^>]*>([^<]+)</text>", self.svg(case, name))]

    def names(self, case: str) -> list[str]:
        """Names of the figures of a case."""
        return re.findall(rf'<figure id="{case}-([^"]+)"', self.html)

    def _figure(self, case: str, name: str) -> re.Match[str]:
        """Match of a figure of a case in the page; fails if there is none."""
        start = rf'<figure id="{case}-{name}" class="[^"]*">\s*<div class="drawing">'
        found = re.search(start + r"(<svg.*?</svg>)</div>\s*<figcaption>(.*?)</figcaption>", self.html, re.DOTALL)
        assert found, f"no figure {name} of {case}"
        return found


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory, whole: RunResult, bare: RunResult) -> Written:
    """Report of the whole case, saved and loaded before, and of the bare one."""
    folder = tmp_path_factory.mktemp("results")
    whole.save(folder)
    results = [RunResult.load(folder), bare]
    return Written(render_runs([chapter(one, f"case-{number}") for number, one in enumerate(results, start=1)]))


@dataclass(frozen=True)
class Printed:
    """Both files of a report, and what was logged while they were written."""

    files: ReportFiles
    warnings: list[str]


@pytest.fixture(scope="session")
def printed(tmp_path_factory: pytest.TempPathFactory, written: Written) -> Printed:
    """Write the report into files; setting the PDF takes longer than drawing all figures."""
    records: list[logging.LogRecord] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = records.append  # type: ignore[method-assign]
    logging.getLogger().addHandler(handler)
    files = write_page(written.html, tmp_path_factory.mktemp("report") / "new" / "folder")
    logging.getLogger().removeHandler(handler)
    return Printed(files, [record.getMessage() for record in records])
