"""A load chart: the load that each limit allows a boom at every extension and angle, with error bars."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import cached_property
from itertools import compress
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.errors.environment import check_installed
from pmr.results.quantities import UNBENT_WALLS, stress_remark
from pmr.scene import Scene
from pmr.scene.choice import is_planar
from pmr.scene.hints import hints, table_hints
from pmr.scene.keys import Usual, key_error
from pmr.scene.members import members
from pmr.scene.tomlfiles import Change
from pmr.simulation.statics.postures import HOOK, with_hook, with_winds
from pmr.studies import tasks
from pmr.studies.chart_draft import Range, check_at_rest, check_slewing, extension_rows
from pmr.studies.chart_models import compute_postures, compute_richer_postures
from pmr.studies.chart_points import Stop, replaced_mass_warnings
from pmr.studies.charting import allow_row, errors_not_covered
from pmr.studies.duty import NOT_LIMITED, ChartLoads, DutyTable, LeastLoads, least_allowed, payload_of
from pmr.studies.limits import STABILITY, STABILITY_WORDS, Limit
from pmr.studies.load_cases import CLASSES, Hoist, LoadCase, Wind, hoisting_factor
from pmr.studies.study import StudyBase, StudyResults, csv_text
from pmr.studies.tasks import Plan, Scalar, Task

#: Limits on what the machine stands on.
ON_GROUND = frozenset(("tipping", "outrigger", "lift-off", "overturning"))
#: Most points of a chart.
MOST_POINTS = 200_000


class Study(StudyBase):
    """Loads that `limits` and stability allow at all `extensions` and angles, in all `cases`.

    `change` holds keys of the scene.  Masses with ``payload = true`` are left out, because the load that is looked for
    takes their place.

    Figures, which are numbers: ``points`` and ``limits``, of all points and limits.  For each limit, numbers of points:
    ``governs.<name>``, at which the limit allows the smallest load; ``never.<name>``, at which no load up to `up_to`
    reaches the limit; ``at_no_load.<name>``, at which the limit is exceeded without a load.  ``in_doubt`` is the number
    of points at which the error bars leave open which limit governs.  For each case out of service, ``stands.<name>``
    is the number of points at which no limit is exceeded.  ``outward.most`` is the largest distance in m by which
    deflections under the allowed load move the tip away from the pivot.

    With masses that are payloads, ``payload`` is their sum in kg.  ``payload.load`` is the smallest load in kg, less
    its error, that the chart allows in the postures of the scene's run.  This posture is at ``payload.t`` in s, at the
    angle ``payload.luffing`` in degrees and with the boom length ``payload.length`` in m; ``payload.limit`` is the name
    of the limit.
    """

    kind: Literal["chart"] = Field(description="Kind of study")
    scene: Path = Field(description="The scene, which has a frame that luffs")
    change: dict[str, Any] = Field(default={}, description="Keys of the scene to change")
    up_to: Annotated[float, Field(gt=0.0), Usual(0.02, 1e4, "boom", "kg")] = Field(
        description="Largest load that is looked for, kg"
    )
    point: tuple[float, float, float] | None = Field(
        default=None,
        description="Place of the load in the axes of the last section, m, moving with the tip; by default the tip",
    )
    extensions: Range | tuple[float | dict[str, float], ...] = Field(
        default=(), description="Extensions in m: the same for all sections, or by name; none for a single body"
    )
    luffing: Range | tuple[float, ...] = Field(description="Luffing angles, in the scene's unit")
    slewing: tuple[float, ...] = Field(
        default=(0.0,),
        min_length=1,
        description="Slewing angles, in the scene's unit; the smallest load over all of them counts",
    )
    limits: tuple[Limit, ...] = Field(default=(), description="Limits in addition to stability")
    cases: tuple[LoadCase, ...] = Field(
        default=(LoadCase(name="rest"),),
        min_length=1,
        description="Load cases: which loads act together, with which factors",
    )
    classes: dict[str, tuple[float, float]] = Field(
        default=CLASSES, description="Hoisting classes: phi2,min and beta2 in s/m; by default of EN 13001-2, drives HD1"
    )
    hoist: Hoist | None = Field(default=None, description="How the load is hoisted off the ground")
    stops: tuple[Stop, ...] = Field(
        default=(), description="Stops of luffing or slewing, simulated at the points that limits govern"
    )
    error_bars: bool = Field(default=True, description="Whether the error of the reduction is estimated at each point")
    spreadsheet: bool = Field(
        default=False, description="Whether the duty table is also written as duty.xlsx, which needs openpyxl"
    )

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        """Refuse equal names, a limit called `STABILITY`, and cases of which none is in service.

        Hoisting classes that do not exist are refused, too.
        """
        named = {"limits": [limit.name for limit in self.limits], "cases": [case.name for case in self.cases]}
        for what, names in named.items():
            if len(set(names)) < len(names) or (what == "limits" and STABILITY in names):
                raise ValueError(f"names of {what} must differ, and {STABILITY!r} is there without being asked for")
        if not any(case.in_service for case in self.cases):
            raise ValueError("a case with a load is needed: those with load = 0 are out of service")
        classes = {f"cases[{k}]": case.hoisting_class for k, case in enumerate(self.cases)}
        classes |= {"hoist": self.hoist.hoisting_class} if self.hoist else {}
        for key, name in classes.items():
            if name is not None and name not in self.classes:
                raise key_error(f"{key}.hoisting_class", name, f"one of {', '.join(self.classes)} is allowed")
        return self

    def plan(self) -> Plan:
        """Return a task for each row of extensions, and the tasks of all rows: postures and a richer model.

        Raises InputError in these cases:

        - A limit, case or angle does not fit the scene.
        - No chart can be made of the scene.
        - There are too many points.
        - A spreadsheet is asked for, but openpyxl is not installed.
        """
        scene, rows, size = self._scene, self._extension_rows, self._row_size
        if self.spreadsheet:
            check_installed("openpyxl")
        for limit in self.limits:
            limit.check(scene)
        if len(rows) * size > MOST_POINTS:
            raise InputError("study", "extensions", len(rows), f"at most {MOST_POINTS} points are allowed in all")
        for key, angles in (("luffing", self._luffing_angles), ("slewing", self.slewing)):
            scene.present_frame.refuse_without_unit(key, angles, "study")
        radian = scene.present_frame.radian
        points = [(row, a / radian, b / radian) for row, a, b in self._chart_points]
        held = {name: float(path.value(0.0)) for name, path in scene.paths.items() if name not in scene.names}
        at = {
            "extensions": {name: [(held | row)[name] for row, *_ in points] for name in scene.paths},
            "luffing": [float(a) for _, a, _ in points],
            "slewing": [float(b) for *_, b in points],
        }
        boom = tasks.scene_arguments(with_hook(scene, self.point))
        richer = boom | {"at": at}
        postures = richer | {
            "up_to": self.up_to,
            "error": self.error_bars,
            "fields": sorted({name for limit in self.limits if limit.of == "field" for name in limit.which}),
            "turned": sorted({stop.of for stop in self.stops}),
        }
        common_tasks = {"postures": Task("postures", compute_postures, postures, cost=10.0, label="the reduced model")}
        if self.error_bars:
            label = "the richer model for error bars"
            common_tasks["model"] = Task("model", compute_richer_postures, richer, cost=20.0, label=label)
        needs = {name: task.key for name, task in common_tasks.items()}
        hoisted = sum(mass.mass for mass in scene.sections[-1].masses if mass.hoisted)
        row_arguments = boom | {
            "up_to": self.up_to,
            "limits": [limit.model_dump(mode="json") for limit in self.limits],
            "cases": [case.acting_amounts(self.classes, hoisted) for case in self._in_service],
            "left": [case.acting_amounts(self.classes, hoisted) for case in self._out_of_service],
            "gravity": scene.gravity.acceleration if scene.gravity else 0.0,
            "stops": [{"of": stop.of, "speed": stop.speed / radian, "within": stop.within} for stop in self.stops],
            "warnings": [*self._replaced_masses, *self._scope_warnings],
            "hoist": self.hoist and [self.hoist.rope_stiffness, self.hoist.speed],
            "point": self.point,
        }
        runs = []
        for k, row in enumerate(rows):
            parameters: dict[str, Scalar] = {f"extension.{name}": value for name, value in row.items()}
            arguments = row_arguments | {"rows": [k * size, (k + 1) * size]}
            out = " + ".join(f"{value:.4g}" for value in row.values())
            label = f"loads at extensions {out} m" if out else "loads"
            runs.append(Task(f"row{k + 1}", allow_row, arguments, needs, parameters, label=label))
        return Plan(tuple(runs), tuple(common_tasks.values()))

    def figures(self, results: StudyResults) -> Mapping[str, Scalar]:
        """Return the figures of all points of the chart, by name.

        The keys are those in the docstring of `Study`: ``points``, ``limits``, ``governs.<name>`` and so on.  With
        `hoist` there are also ``hoist.least``, ``hoist.most`` and, for a hoisting class, ``hoist.class``.
        """
        table = self.table(results)
        names, loads = self.names, self.loads(table)
        figures: dict[str, Scalar] = {"points": len(loads.load), "limits": len(names)}
        figures["in_doubt"] = int(loads.may_govern.any(axis=1).sum())
        for k, name in enumerate(names):
            figures |= {
                f"governs.{name}": int((loads.which == k).sum()),
                f"never.{name}": int(np.isnan(loads.load[:, k]).sum()),
                f"at_no_load.{name}": int((loads.load[:, k] == 0.0).sum()),
            }
        if self.hoist is not None:
            factors = table["hoist"][np.isfinite(table["hoist"])]
            figures |= {"hoist.least": float(factors.min()), "hoist.most": float(factors.max())} if len(factors) else {}
            figures |= {} if (factor := self._class_factor) is None else {"hoist.class": factor}
        for k, case in enumerate(self._out_of_service):
            figures[f"stands.{case.name}"] = int((~table["passed"][:, k].any(axis=1)).sum())
        if np.isfinite(table["outward"]).any():
            figures["outward.most"] = float(np.nanmax(table["outward"]))
        return figures | self._payload_figures(results)

    @property
    def figure_names(self) -> list[str]:
        """Names that `figures` may have; those of payloads and of deflections are missing in some charts."""
        of_limits = [f"{figure}.{name}" for figure in ("governs", "never", "at_no_load") for name in self.names]
        of_hoist = [] if self.hoist is None else ["hoist.least", "hoist.most"]
        of_hoist += [] if self._class_factor is None else ["hoist.class"]
        stands = [f"stands.{case.name}" for case in self._out_of_service]
        of_payload = ["payload", *(f"payload.{key}" for key in ("t", "luffing", "length", "load", "limit"))]
        return ["points", "limits", "in_doubt", *of_limits, *of_hoist, *stands, "outward.most", *of_payload]

    def _payload_figures(self, results: StudyResults) -> dict[str, Scalar]:
        """Return the payload of the scene's run, and the posture of this run in which the chart allows least.

        The keys are those in the docstring of `Study`.  If no posture of the run is in the chart, ``payload`` is the
        only key.  The result is empty if the scene with `change` has no payload or is not valid.  It is also empty if
        the scene does not prescribe luffing angle and extensions.
        """
        with suppress(InputError):
            scene = scenes.vary(self.scene, [Change(self.change, "change")])
            luffing = None if scene.frame is None else scene.frame.luffing_signal
            if luffing is not None and not scene.free_extensions and (payload := payload_of(scene)):
                rows = [run.parameters for run in results.done]
                at = least_allowed(scene, self._least_loads(results), rows, self.up_to)
                if at is None:
                    return {"payload": payload}
                posture: dict[str, Scalar] = {"t": at.t, "luffing": float(np.rad2deg(at.luffing)), "length": at.length}
                posture |= {"load": at.load, "limit": self.names[at.limit] if at.limit >= 0 else NOT_LIMITED}
                return {"payload": payload} | {f"payload.{key}": value for key, value in posture.items()}
        return {}

    def summary_line(self, results: StudyResults) -> str:
        """Return a line with the least and the largest load to use in kg, which is less its error bar.

        The line also says at how many points the boom is not permitted even empty, which errors no error bar contains,
        or that the chart has no error bars, and whether the scene's run lifts more than allowed.  If no limit is
        reached at any point, the line says only that.
        """
        points, table = len(self._chart_points), self.table(results)
        loads = self.loads(table)
        if not np.isfinite(loads.least).any():
            alone = f"; only {STABILITY_WORDS} was evaluated; [[limits]] of the study adds others"
            hint = "" if self.limits else alone
            return f"no limit is reached up to {self.up_to:.10g} kg at any of {points} points{hint}"
        permitted = loads.lower_bound[loads.lower_bound > 0.0]
        empty = points - len(permitted)
        never = f"not permitted, even empty, at {empty} of {points} points"
        if not len(permitted):
            return never
        most = f"{np.floor(permitted.max()):.0f} kg"
        if permitted.max() >= self.up_to:
            most = f"more than {self.up_to:.10g} kg, where the search ends,"
        use = "use" if self.error_bars else "the limits allow"
        carried = f"{use} {np.floor(permitted.min()):.0f} to {most}"
        where = f"at the other {len(permitted)}" if empty else f"at {points} points"
        first = f"{never}; " if empty else ""
        lacking, run = errors_not_covered(table["not_covered"]), self._payload_figures(results)
        payload, allowed = float(run.get("payload") or 0.0), float(run.get("payload.load", np.inf) or 0.0)
        lifted = (
            f"; the scene's run lifts {payload:.10g} kg, and the chart allows {np.floor(allowed):.0f} kg in one of "
        )
        lifted += f"its postures, by {run.get('payload.limit')}"
        more = lifted if allowed < payload else ""
        off = f"error bars taken off; errors that no bar contains: {lacking}"
        bars = off if self.error_bars else "without error bars"
        return f"{first}{carried} {where}, by all limits, {bars}{more}"

    @property
    def _in_service(self) -> list[LoadCase]:
        """Load cases in which a load hangs at the tip."""
        return [case for case in self.cases if case.in_service]

    @property
    def _out_of_service(self) -> list[LoadCase]:
        """Load cases in which no load hangs at the tip."""
        return [case for case in self.cases if not case.in_service]

    @property
    def _class_factor(self) -> float | None:
        """Dynamic factor of `hoist`'s hoisting class at its speed; None without a class."""
        if self.hoist is None or self.hoist.hoisting_class is None:
            return None
        return hoisting_factor(self.classes[self.hoist.hoisting_class], self.hoist.speed)

    @property
    def names(self) -> list[str]:
        """Names of all limits; the last one is the name of stability."""
        return [*(limit.name for limit in self.limits), STABILITY]

    def table(self, results: StudyResults) -> dict[str, Any]:
        """Return the arrays, by name, of all points of the finished runs, in the order of the plan.

        The arrays are those of `pmr.studies.charting.allow_row` without those called ``at.<name>``; for P points and l
        limits they are for instance ``load`` (P, l) in kg, ``error`` (P, l) in kg and ``case`` (P, l).  Raises
        IndexError if no run is done.
        """
        parts = [results.arrays(run.key) for run in results.done]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0] if name[:3] != "at."}

    def loads(self, table: Mapping[str, NDArray[Any]]) -> ChartLoads:
        """Return the loads of all l limits at P points in `table`, whose arrays (P, l) `Study.table` returned."""
        return ChartLoads(table["load"], table["error"], self.up_to)

    def _least_loads(self, results: StudyResults) -> LeastLoads:
        """Return the smallest loads of all slewing angles in the finished runs."""
        return LeastLoads.from_rows([results.arrays(run.key) for run in results.done], len(self.slewing))

    def tables(self, results: StudyResults) -> Mapping[str, str | bytes]:
        """Return the contents of ``chart.csv``, ``duty.csv`` and ``duty.xlsx``; all three keys are always there.

        ``chart.csv`` has a row for each point of the finished runs; the other two hold the duty table
        (`pmr.studies.duty`).  They are empty until all runs are done: at the radius of an extension that is missing,
        the table would have the load of a shorter boom alone.  ``chart.csv`` is empty if no run is done, and
        ``duty.xlsx`` if the study does not ask for it.
        """
        if not results.done:
            return {"chart.csv": "", "duty.csv": "", "duty.xlsx": ""}
        done = [run.status == "done" for run in results.runs]
        points, table = compress(self._chart_points, np.repeat(done, self._row_size)), self.table(results)
        loads = self.loads(table)
        rows = [self._cells(table, loads, k, *point) for k, point in enumerate(points)]
        cells = [[_cell(value) for _, value in row] for row in rows]
        rows_of_chart = [run.parameters for run in results.done]
        duty = DutyTable.from_loads(self._least_loads(results), self.up_to, rows_of_chart) if all(done) else None
        return {
            "chart.csv": csv_text([head for head, _ in rows[0]], cells),
            "duty.csv": duty.csv(self.names) if duty else "",
            "duty.xlsx": duty.workbook(self.title, self.names) if duty and self.spreadsheet else "",
        }

    def _cells(
        self,
        table: Mapping[str, NDArray[Any]],
        loads: ChartLoads,
        k: int,
        row: Mapping[str, float],
        luffing: float,
        slewing: float,
    ) -> list[tuple[str, float | str]]:
        """Return pairs (column head, value) of the k-th row of ``chart.csv``; a value that is NaN is an empty cell.

        The point has extensions `row` in m and the angles `luffing` and `slewing` in the scene's unit; `table` is the
        one that `Study.table` returns, and `loads` are those in it.
        """
        angle, names = self._angle_unit, np.array(self.names)
        load, which, lower = loads.load[k], loads.which[k], float(loads.lower_bound[k])
        is_limited = which >= 0
        return [
            *((f"extension {name} [m]", extension) for name, extension in row.items()),
            (f"luffing [{angle}]", luffing),
            (f"slewing [{angle}]", slewing),
            ("radius [m]", table["place"][k, 0]),
            ("height [m]", table["place"][k, 1]),
            ("radius under load [m]", table["place"][k, 0] + table["outward"][k]),
            ("load [kg]", load[which] if is_limited else f">{self.up_to:.9g}"),
            ("lower bound [kg]", lower if is_limited or lower < self.up_to else f">{self.up_to:.9g}"),
            ("governed by", names[which] if is_limited else NOT_LIMITED),
            ("governing member", str(table["member"][k])),
            ("case", self._in_service[int(table["case"][k, which])].name if is_limited else ""),
            ("may govern", " | ".join(names[loads.may_govern[k]])),
            *([("hoisting factor", table["hoist"][k])] if self.hoist else []),
            *(
                (f"{case.name}, passed", " | ".join(names[passed]) or "none")
                for case, passed in zip(self._out_of_service, table["passed"][k], strict=True)
            ),
            *((f"{name} [kg]", value) for name, value in zip(self.names, load, strict=True)),
            *((f"{name} error [kg]", value) for name, value in zip(self.names, loads.error[k], strict=True)),
            ("not covered", str(table["not_covered"][k])),
        ]

    @property
    def _row_size(self) -> int:
        """Number of points in a row of the chart, which is a run of the study."""
        return len(self._luffing_angles) * len(self.slewing)

    def hints(self) -> list[str]:
        """Return a line for each unusual number of the study or its scene, and what the scene's model leaves out."""
        return [*table_hints(self, self._scene), *hints(self._scene, at_rest=True)]

    @property
    def _chart_points(self) -> list[tuple[dict[str, float], float, float]]:
        """All points: extensions in m by section, luffing and slewing angle in the scene's unit, slewing fastest."""
        return [(row, a, b) for row in self._extension_rows for a in self._luffing_angles for b in self.slewing]

    @cached_property
    def _scene(self) -> Scene:
        """The scene with `change` applied, without payloads, with second order, and with the winds of the cases.

        Raises InputError if no chart can be made of it, or if a case, a stop or `point` does not fit it.
        """
        scene = scenes.vary(self.scene, [Change(self.change, "change")])
        scene = scene.vary_sections(lambda part: {"masses": tuple(mass for mass in part.masses if not mass.payload)})
        if scene.frame is None or scene.frame.luffing is None:
            raise InputError("study", "scene", str(self.scene), "a scene whose [frame] has a luffing angle is allowed")
        if scene.gravity is None:
            raise InputError("study", "scene", str(self.scene), "a scene with [gravity] is allowed")
        check_at_rest(scene)
        check_slewing(scene, self.slewing)
        if self.point is not None and is_planar(members(scene)[-1]):
            raise InputError("study", "point", list(self.point), "a model in space is allowed with a point")
        loads = [load for part in scene.sections for load in part.loads if load.name != HOOK]
        forces = {load.name: load.acts == "force" for load in loads}
        for k, case in enumerate(self.cases):
            case.check_loads(f"cases[{k}]", forces)
        if any(stop.of == "slewing" for stop in self.stops) and scene.frame.slewing is None:
            raise InputError("study", "stops", "slewing", "a scene whose [frame] has a slewing angle is allowed")
        return self._with_winds(scene.with_keys(frame={"second_order": True}))

    def _with_winds(self, scene: Scene) -> Scene:
        """The scene with loads on its sections for the winds of the cases, except winds for which areas are given.

        Raises InputError in these cases:

        - No section can have such a load.
        - Wind comes from the side, but the boom is planar.
        - An azimuth is more than 2 pi, and the frame does not set the unit of angles.
        """
        frame, winds = scene.present_frame, dict[str, tuple[str, Wind]]()
        for k, case in enumerate(self.cases):
            if case.wind is not None and not case.wind.on:
                key = f"cases[{k}].wind"
                frame.refuse_without_unit(f"{key}.azimuth", case.wind.azimuth, "study")
                winds.setdefault(case.wind.section_load, (key, case.wind))
        blown = with_winds(scene, {name: (wind.azimuth, wind.shape) for name, (_, wind) in winds.items()})
        for name, (key, wind) in winds.items():
            blowing = next((load for part in blown.sections for load in part.loads if load.name == name), None)
            if blowing is None:
                allowed = "areas are needed, as no section has a box or wind of its own"
                raise InputError("study", f"{key}.on", None, allowed)
            if any(map(is_planar, members(scene))) and blowing.blows_sideways(frame.unit):
                allowed = "0 or half a turn is allowed on a planar beam, which side wind does not move"
                raise InputError("study", f"{key}.azimuth", wind.azimuth, allowed)
        return blown

    @property
    def _replaced_masses(self) -> list[str]:
        """Lines of `replaced_mass_warnings` on the scene of the study file and the scene of the chart.

        The list is empty if the scene of the study file is not valid without `change`.
        """
        with suppress(InputError):
            return replaced_mass_warnings(scenes.load_any(self.scene), self._scene, self.point)
        return []

    @property
    def _angle_unit(self) -> str:
        """Unit of the angles of luffing and slewing in the scene's frame."""
        return self._scene.present_frame.unit

    @property
    def _scope_warnings(self) -> list[str]:
        """Lines on what the chart leaves open: other slewing angles of a machine that may tip, strength, pads."""
        kinds, lines = {limit.of for limit in self.limits}, list[str]()
        if kinds & ON_GROUND and len(self.slewing) == 1:
            lines.append(
                f"all points are slewed by {self.slewing[0]:g} {self._angle_unit}: over a side or the rear the machine "
                "may carry less; several angles of slewing in the study tell"
            )
        if kinds and not kinds - ON_GROUND:
            lines.append(
                "the limits are those of the ground alone: whether stresses and forces of pads, cylinders and supports "
                "are allowed is not looked at"
            )
        elif (
            "stress" in kinds
            and not any(of.of == "pad" and not of.by_scene for of in self.limits)
            and stress_remark(self._scene)
        ):
            lines.append(
                "no limit of pad forces is set: walls may yield under pads at smaller loads, as stresses of beams are "
                f"{UNBENT_WALLS}"
            )
        return lines

    @cached_property
    def _extension_rows(self) -> list[dict[str, float]]:
        """Extensions in m by section, for each row of the chart; InputError if one is missing or out of range."""
        return extension_rows(self._scene, self.extensions)

    @cached_property
    def _luffing_angles(self) -> tuple[float, ...]:
        """Luffing angles in the scene's unit; raises InputError if the study names no angle."""
        angles = self.luffing.values if isinstance(self.luffing, Range) else self.luffing
        if not angles:
            raise InputError("study", "luffing", None, "at least one angle is allowed")
        return angles


def _cell(value: float | str) -> str:
    """Return a value as text: a number with nine digits, NaN as an empty text."""
    if isinstance(value, str):
        return value
    return "" if np.isnan(value) else f"{value:.9g}"
