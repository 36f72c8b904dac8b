"""Residual flexibility beside other ways to reduce a sliding beam: error over the number of coordinates.

Bases, each with the same numbers of coordinates, all against the full model's motion with the same step:

pod
    POD of eigenmodes with the slider held at several positions (Weyrer et al.), the pin's rows left out.
modes
    Eigenmodes on the supports with the slider released.
harmonic
    POD of harmonic responses with the slider held along the visited stretch, up to `band` in Hz; M-orthonormal.
flexibility
    The eigenmodes of ``modes`` with the flexibility of those left out (docs/moving_residual_flexibility.md).
trajectory
    POD of the full model's own motion, M-orthonormal: no basis of fixed vectors holds more of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy.linalg
from experiment import Findings, Row, Settings, full_body, rows, run, save
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import pmr
from pmr.compare.errors import nrms
from pmr.report.blocks import Block, Chapter, Grid, KeyNumber
from pmr.report.figures import WIDE, curve_style, drawing, log_axis, log_x, make_sheet
from pmr.report.numbers import format_percent, significant
from pmr.scene import Scene
from pmr.system.body import FullBody

SETTINGS = {
    "scenes": [
        "simple_residual", "evolved_residual", "static_slide", "fast_slide", "tip_impact",
        "sine_sweep", "steel_boom", "reversing",
    ],
    "coordinates": [4, 5, 6, 8, 10, 12, 16, 20],
    "band": 20.0,  # Hz
    "round_off": 3e-8,  # errors below this are round-off
}  # fmt: skip
NAMES = {
    "pod": "POD of eigenmodes",
    "modes": "free modes",
    "harmonic": "POD of harmonic responses",
    "trajectory": "POD of the full motion",
    "flexibility": "residual flexibility",
}
PLAIN = ["compare.against=[]", "compare.richer='none'", "simulation.simulators=['march']", "simulation.repeats=1"]
#: Slider positions and frequencies of the harmonic responses, and their structural loss factor.
POSITIONS, FREQUENCIES, LOSS = 41, 81, 0.02
#: Every so many steps of the full motion are snapshots of it.
EVERY = 5
#: Simulations of which the fastest counts.
REPEATS = 5


@lru_cache
def full_motion(scene: str) -> tuple[FullBody, np.ndarray, np.ndarray, pmr.Response, np.ndarray]:
    """Return the full model, its modes (n, n), their squared frequencies (n,), response, and modal motion (T, n)."""
    loaded = pmr.load_scene(scene, PLAIN)
    full = full_body(loaded)
    omega2, phi = scipy.linalg.eigh(full.K.toarray(), full.M.toarray())
    simulated = pmr.simulate_with_states(loaded, pmr.project(full, phi))
    return full, phi, omega2, simulated.response, simulated.states[""].p


#: What is changed in a scene for models of a basis.
REDUCED = {
    "pod": ["basis='eigenmodes'", "positions='nodes'", "flexibility=false"],
    "modes": ["basis='free_modes'", "flexibility=false"],
}


def scene_of(scene: str, basis: str, largest: int) -> Scene:
    """Return the scene with the reduction to models of a basis with up to `largest` coordinates."""
    size = min(largest, 30) if basis == "pod" else largest
    reduction = [f"reduction.{change}" for change in REDUCED.get(basis, [])]
    return pmr.load_scene(scene, [*PLAIN, *reduction, f"reduction.coordinates={size}"])


def models(scene: str, basis: str, largest: int, band: float) -> tuple[Callable[[int], pmr.ReducedModel], int]:
    """Return a function from the number of coordinates to the model of a basis, and the largest number."""
    if basis in REDUCED:
        longest = pmr.reduce(scene_of(scene, basis, largest)).reduced
        return longest.leading, longest.size
    full, phi, omega2, _, p = full_motion(scene)
    pool = p[::EVERY].T if basis == "trajectory" else np.hstack(list(_responses(scene, full, phi, omega2, band)))
    U, sigma, _ = np.linalg.svd(pool, full_matrices=False)
    free = [row for row in range(len(full.row_names)) if row not in full.rows.fixed]  # the basis satisfies the others
    rank = int(np.sum(sigma > sigma[0] * 1e-13))
    return lambda r: pmr.project(full, phi @ U[:, :r]).with_rows(free), rank


def _responses(scene: str, full: FullBody, phi: np.ndarray, omega2: np.ndarray, band: float) -> Iterator[np.ndarray]:
    r"""Yield modal responses (n, 2 i) to unit loads on i inputs at each position and frequency, real parts first.

    .. math:: z = h\, (b - c^T \lambda), \qquad h_j = 1 / (\omega_j^2 (1 + i \eta) - \omega^2)

    with modal loads b (n, i), the slider's rows c at s, and their forces :math:`\lambda`, which hold them or load their
    compliance.
    """
    compliance, B = np.diag(full.rows.compliance), phi.T @ full.B
    for s in np.linspace(*pmr.load_scene(scene, PLAIN).path_bounds, POSITIONS):
        c = full.rows.at(float(s)).toarray() @ phi
        for omega in 2.0 * np.pi * np.linspace(0.0, band, FREQUENCIES)[1:]:
            h = 1.0 / (omega2 * (1.0 + 1j * LOSS) - omega**2)
            z = h[:, None] * (B - c.T @ np.linalg.solve((c * h) @ c.T + compliance, (c * h) @ B))
            yield np.hstack([z.real, z.imag])


def row(scene: str, basis: str, coordinates: list[int], band: float) -> Row:
    """Return ``beam``, ``seconds`` and ``estimate``, each (c,) over c numbers of coordinates; NaN without a value.

    They are the errors along the beam, the solver's seconds of the fastest simulation, and the run's estimates of the
    error, which only the basis ``flexibility`` has.
    """
    reference, values = full_motion(scene)[3].displacement, np.full((3, len(coordinates)), np.nan)
    largest = max(coordinates)
    if basis != "flexibility":
        of, largest = models(scene, basis, largest, band)
    for column, r in enumerate(coordinates):
        if r > largest:
            continue
        try:
            if basis == "flexibility":
                loaded = scene_of(scene, basis, r)
                outcome = pmr.run(loaded)
                assert outcome is not None  # as on the first rank
                model, estimate = outcome.reduced, outcome.result.summary["estimate"]
                values[2, column] = (estimate or {}).get("beam") or np.nan
            else:
                loaded, model = scene_of(scene, basis, max(coordinates)), of(r)
            runs = [pmr.simulate(loaded, model) for _ in range(REPEATS)]
        except (pmr.SimulationError, pmr.InputError):
            continue
        values[0, column], values[1, column] = nrms(runs[0].displacement, reference), min(one.seconds for one in runs)
    return {"beam": values[0], "seconds": values[1], "estimate": values[2]}


def main(settings: Settings, out: Path, jobs: int) -> Chapter:
    """Compute all scenes and bases, save the errors, and return the chapter of the report."""
    common = {"coordinates": settings["coordinates"], "band": settings["band"]}
    names = [(scene, basis) for scene in settings["scenes"] for basis in NAMES]
    found = rows(row, [common | {"scene": scene, "basis": basis} for scene, basis in names], out, jobs)
    results = {(Path(scene).stem, basis): one for (scene, basis), one in zip(names, found, strict=True)}
    for one in results.values():  # what the full model's round-off decides is left out
        one["shown"] = np.where(np.nan_to_num(one["beam"]) > settings["round_off"], one["beam"], np.nan)
        one["ratio"] = one["estimate"] / one["shown"]
    sizes = np.array(settings["coordinates"])
    figures = {
        f"{scene}.{basis}.{r}": float(error)
        for (scene, basis), one in results.items()
        for r, error in zip(sizes, one["beam"], strict=True)
    }
    ratios = np.concatenate([one["ratio"][sizes >= 5] for one in results.values()])
    figures |= {"ratio.least": float(np.nanmin(ratios)), "ratio.largest": float(np.nanmax(ratios))}
    save(out, figures=figures)
    return chapter(results, settings["coordinates"], Findings(figures))


def chapter(results: dict[tuple[str, str], Row], sizes: list[int], findings: Findings) -> Chapter:
    """Return the chapter of the report on these rows, by scene and basis."""
    scenes, figures = list(dict.fromkeys(scene for scene, _ in results)), findings.figures
    few = 6 if 6 in sizes else sizes[len(sizes) // 2]
    gains = {scene: figures[f"{scene}.modes.{few}"] / figures[f"{scene}.flexibility.{few}"] for scene in scenes}
    least, most = min(gains, key=lambda scene: gains[scene]), max(gains.values())
    ratio = " to ".join(significant(figures[f"ratio.{end}"], 3) for end in ("least", "largest"))
    over_r = (
        "Normalised RMS error along the beam against the full model, over the number of coordinates. Errors that the "
        "full model's round-off decides are left out, and so are models that can't move."
    )
    over_time = (
        "The same errors over the time that the compiled simulator takes, in the second scene: the fastest of five "
        "simulations, measured while other runs were under way."
    )
    words = {scene: scene.replace("_", " ") for scene in scenes}
    errors = Grid(
        f"Error along the beam with {few} coordinates.",
        ("scene", *NAMES.values()),
        tuple((words[scene], *(_percent(figures[f"{scene}.{basis}.{few}"]) for basis in NAMES)) for scene in scenes),
    )
    ratios = Grid(
        "Estimate over true error, by the number of coordinates.",
        ("scene", *map(str, sizes)),
        tuple(
            (
                words[scene],
                *("–" if np.isnan(one) else significant(one, 3) for one in results[scene, "flexibility"]["ratio"]),
            )
            for scene in scenes
        ),
    )
    return Chapter(
        anchor="residual",
        title="Residual flexibility",
        headline=f"The flexibility of the modes left out makes {few} free modes {significant(gains[least], 2)} to "
        f"{significant(most, 2)} times more accurate, least in the scene {words[least]}.",
        key_numbers=[
            *(
                KeyNumber(format_percent(figures[f"{s}.flexibility.{few}"]), f"{words[s]}, {few} coordinates")
                for s in scenes[:2]
            ),
            KeyNumber(ratio, "estimate over true error"),
        ],
        paragraphs=[
            "A basis of fixed vectors has to carry the kink under the slider wherever it goes; even the full model's "
            "own motion, decomposed afterwards, takes twenty vectors for that. Modes with the flexibility of those "
            "left out have it as a small table in the slider's position.",
            "The estimate needs no full model: it is made of the model's own four enrichment modes and attachment "
            "modes for its loads, and contains a margin of a quarter.",
        ],
        blocks=[
            Block(
                "Error over the number of coordinates",
                (drawing("residual-errors", draw_errors, over_r, results, sizes),),
                grids=(errors, ratios),
            ),
            Block("Error over time", (drawing("residual-time", draw_time, over_time, results, scenes[:2][-1]),)),
        ],
    )


def _percent(error: float) -> str:
    """Return an error in per cent as text, a dash for NaN."""
    return "–" if np.isnan(error) else format_percent(error)


def draw_errors(results: dict[tuple[str, str], Row], sizes: list[int]) -> Figure:
    """Draw the errors of all bases over the number of coordinates, one panel for each scene."""
    scenes = list(dict.fromkeys(scene for scene, _ in results))
    lines = -(-len(scenes) // 2)
    gaps = {"wspace": 0.05, "hspace": 0.3}
    figure, axes = make_sheet(
        WIDE,
        0.7 + 1.45 * lines,
        rows=lines,
        columns=2,
        margins={"top": 0.7},
        sharex=True,
        sharey=True,
        gridspec_kw=gaps,
    )
    for ax in axes.flat[len(scenes) :]:
        ax.set_visible(False)
    for ax, scene in zip(axes.flat, scenes, strict=False):
        for number, basis in enumerate(NAMES):
            shown = results[scene, basis]["shown"]
            ax.plot(np.array(sizes)[np.isfinite(shown)], shown[np.isfinite(shown)], **curve_style(number, 2.2))
        ax.set_title(scene.replace("_", " "), loc="left", pad=3.0)
    log_axis(axes[0, 0], float(np.nanmin([one["shown"] for one in results.values()])), 1.0)
    for ax in axes[:, 0]:
        ax.set_ylabel("e_NRMS (–)")
    for ax in axes[-1]:
        ax.set_xlabel("Number of coordinates (–)")
    _draw_legend(figure)
    return figure


def draw_time(results: dict[tuple[str, str], Row], scene: str) -> Figure:
    """Draw the errors of all bases in one scene over the compiled simulator's time."""
    figure, axes = make_sheet(WIDE, 2.8, margins={"top": 0.5})
    ax = axes[0, 0]
    for number, basis in enumerate(NAMES):
        shown = np.isfinite(results[scene, basis]["shown"])
        seconds, error = (results[scene, basis][name][shown] for name in ("seconds", "shown"))
        ax.plot(1e3 * seconds, error, **curve_style(number, 2.2))
    seconds, errors = (np.concatenate([line.get_data()[k] for line in ax.lines]) for k in (0, 1))
    log_x(ax, 0.9 * float(seconds.min()), 1.1 * float(seconds.max()))
    log_axis(ax, float(errors.min()), float(errors.max()))
    ax.set_xlabel("Time of the whole simulation in ms")
    ax.set_ylabel("e_NRMS (–)")
    _draw_legend(figure)
    return figure


def _draw_legend(figure: Figure) -> None:
    """Draw the legend of all bases in two rows, filled row by row."""
    handles = [Line2D([], [], label=label, **curve_style(number, 2.2)) for number, label in enumerate(NAMES.values())]
    by_column = [handle for column in range(3) for handle in handles[column::3]]
    figure.legend(handles=by_column, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=3, borderaxespad=0.25)


if __name__ == "__main__":
    run(main, SETTINGS, __doc__)
