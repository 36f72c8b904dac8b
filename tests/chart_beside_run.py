"""Compare a machine at a point of its load chart with a run at rest that has the load as a mass at its tip."""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from random_machines import G, random_machine

from pmr import Response
from pmr.compare.evaluation import evaluate_motion
from pmr.compare.forces import rope_forces
from pmr.compare.second_order import second_order_effect
from pmr.files import npz
from pmr.files.arrays import Array
from pmr.reduction.bodies import join_bodies, reduce_bodies
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.scene.mechanism import CYLINDER
from pmr.simulation import Excitation
from pmr.simulation.excitation import side_positions
from pmr.simulation.native import systems
from pmr.simulation.reactions import with_forces_on_machine
from pmr.simulation.statics.loaded import LoadedStates
from pmr.simulation.statics.postures import HOOK, MACHINE_WEIGHT, WEIGHT, PostureMatrices, with_hook
from pmr.studies import tasks
from pmr.studies.allowed import Place
from pmr.studies.chart_models import compute_postures
from pmr.studies.charting import allow_row
from pmr.studies.limits import KINDS, Limit
from pmr.studies.tasks import scene_arguments
from pmr.system.assembly import Assembly

Point = tuple[float, float, float]
POLYGON = ((2.0, 1.6), (-2.2, 1.6), (-2.2, -1.6), (2.0, -1.6))
MACHINE = {"name": "carrier", "mass": 9000.0, "at": (-0.6, 0.0, -0.8)}
HEIGHT = 1.5


@dataclass(frozen=True)
class Chart:
    """Limits at one point, the loads that they allow, and error bars, in kg and (`bar`) as shares of the limits.

    `error` is without the play of pads, and `reduction` the part of it that is due to reduction.
    """

    limits: Sequence[Limit]
    load: Array
    error: Array
    reduction: Array
    bar: Array


def scene_of(plain: Mapping[str, Any]) -> Scene:
    """Validate and check a scene."""
    scene = Scene.model_validate(plain)
    check_scene(scene)
    return scene


def chart(
    plain: Mapping[str, Any],
    extensions: Mapping[str, float],
    angle: float,
    wind: float,
    at_load: float,
    point: Point | None = None,
    error: bool = True,
) -> Chart:
    """Load chart at one point with limits of all kinds, each chosen so that about `at_load` kg reaches it.

    `angle` is the luffing angle in degrees, `wind` a force at the tip in N; the load hangs at `point`.  Error bars
    without `error` are not a number.
    """
    if unknown := KINDS.keys() - OTHERS - VALUES.keys():
        raise NotImplementedError(f"what a run says of limits of {unknown}")
    scene = scene_of(plain)
    hooked = with_hook(scene, point)
    at = {"extensions": {name: [x] for name, x in extensions.items()}, "luffing": [np.deg2rad(angle)], "slewing": [0.0]}
    common: dict[str, Any] = {"up_to": 4.0 * at_load, "error": error}
    made = compute_postures(scene_arguments(hooked) | common | {"at": at}, {})
    own = npz.record_from_arrays(
        PostureMatrices, {n.removeprefix("reduced."): a for n, a in made.arrays.items() if n.startswith("reduced.")}
    )
    amounts = [{WEIGHT: 1.0, MACHINE_WEIGHT: 1.0, HOOK: 1.0, "wind": wind}.get(part, 0.0) for part in own.loads.names]
    place = Place(own, 0, amounts, G)
    limits = list[Limit]()
    state = LoadedStates.from_states([place.equilibria.state(at_load)])
    lacking = {
        "stress": not any("stress" in name for name in own.output_names),
        "rope": not own.columns.ropes,
        "lug": not own.columns.lugs,
        **dict.fromkeys(("tipping", "outrigger", "lift-off"), own.ground is None),
    }
    for kind in KINDS:
        if kind in OTHERS or lacking.get(kind):
            continue
        if kind == "overturning":
            machine = {**MACHINE, "mass": 1.0}
            light = Limit(name=kind, of=kind, polygon=POLYGON, machine=[machine], height=HEIGHT, factor=1.3)
            tipping = light.tipping_moments(own, 0, amounts)
            load = at_load * (tipping.tip_moment + state.outputs[0] @ tipping.tip_derivative.T)
            more = (2.3 * load + state.outputs[0] @ tipping.boom.T - load) / -tipping.machine - 1.3 * load * 0.0
            mass = float(max(np.max(more[np.isfinite(more)]), 500.0))
            limits.append(light.model_copy(update={"machine": (light.machine[0].model_copy(update={"mass": mass}),)}))
            continue
        key = "least" if kind in ("buckling", "frequency", "lift-off") else "most"
        unit = Limit(name=kind, of=kind, **{key: 1.0})
        value = float(unit.share(own, 0, amounts)(state)[0])
        value = 1.0 / value if key == "least" and value > 0.0 else value
        if np.isfinite(value) and value > 0.0:
            limits.append(unit.model_copy(update={key: value}))
    asked = scene_arguments(hooked) | common | {"gravity": G, "rows": [0, 1]}
    asked["limits"] = [one.model_dump(mode="json") for one in limits]
    cases = [{"weight": 1.0, "machine": 1.0, "load": 1.0, "hoisted": 0.0, "loads": {"wind": wind}}]
    found = allow_row(asked | {"cases": cases, "left": []}, {"postures": made}).arrays
    load = found["load"][0][: len(limits)]
    if not error:
        unknown = np.full(len(limits), np.nan)
        return Chart(limits, load, unknown, unknown, unknown)
    whole, reduction, play = (found[name][0][: len(limits)] for name in ("error", "error.reduction", "error.play"))
    bars = whole - np.nan_to_num(play)  # the run has the play of the chart
    bar = np.full(len(limits), np.nan)
    for k, limit in enumerate(limits):
        if load[k] > 0.0:
            step = max(bars[k], 1e-4 * load[k])
            pair = [place.equilibria.state(max(load[k] + way * step, 0.0)) for way in (-1.0, 0.0)]
            if all(one.in_equilibrium for one in pair):
                low, high = place.share(limit)(LoadedStates.from_states(pair))
                bar[k] = abs(high - low) * bars[k] / step
    return Chart(limits, load, bars, reduction, bar)


@dataclass(frozen=True)
class Run:
    """Run at rest, with `mass` kg at the tip."""

    scene: Scene
    system: Any
    response: Response
    mass: float
    offset: Array  # (3,) m from the end of the axis

    def value(self, limit: Limit) -> float:
        """Value at the start of the run of the quantity that a limit is about."""
        return float(VALUES[limit.of](self, limit))

    def _ropes(self) -> dict[str, float]:
        """Forces of ropes, or of what pulls them."""
        return {name: abs(force[0]) for name, force in rope_forces(self.scene, self.response).items()}

    def _cylinders(self) -> dict[str, float]:
        """Forces of the sections' cylinders."""
        names = self.scene.names[1:]
        return {name: abs(float(self.response.force(f"force of cylinder of {name}")[0])) for name in names}

    def _frequency(self) -> float:
        """Lowest natural frequency in Hz."""
        excitation = Excitation.from_scene(self.scene)
        x, c = side_positions(self.system, excitation)[0], excitation.amplitudes(self.system.term_names)[0]
        return float(Assembly(self.system).frequencies(x, 1, c)[0])

    def _stress(self) -> float:
        """Largest stress of all probes, from bending, axial force and torsion: (sum of s^2 + 3 t^2)^(1/2)."""
        probes = dict[str, list[float]]()
        for name in self.response.other_names:
            if " stress " in name:
                weight = 3.0 if name.endswith("torsion") else 1.0
                probes.setdefault(name.partition(" stress ")[0], []).append(weight * self.response.other(name)[0] ** 2)
        return float(np.sqrt(max(map(sum, probes.values()))))

    @property
    def lifts(self) -> bool:
        """Whether a unilateral pad is open; frequencies and buckling factors of a run assume closed pads."""
        pushing = ~np.isnan(self.system.clearance)
        names = [f"force of {name}" for name, one in zip(self.system.contact_names, pushing, strict=True) if one]
        return any(not self.response.force(name)[0] > 0.0 for name in names)

    def _support(self) -> float:
        """Largest resultant force of a support: of springs along z, of a pin or a clamp along all axes."""
        springs = [abs(one) for one in self.response.of("support")[0]]
        units = dict(zip(self.response.other_names, self.response.other_units, strict=True))
        rigid = [name for name, unit in units.items() if unit == "N" and name.startswith("reaction of s0: ")]
        return float(max([*springs, np.linalg.norm([self.response.other(name)[0] for name in rigid])]))

    def _lug(self) -> float:
        """Largest force of a lug of the pin across the boom: all of the force along y, and half of the other forces.

        The moments about x and z press opposite forces along z and x on the lugs.
        """
        x, y, z, rx, rz = (
            self.response.other(f"reaction of s0: pin {axis}")[0] for axis in ("x", "y", "z", "rx", "rz")
        )
        spacing = float(self.scene.sections[0].supports[0].lug_spacing or np.nan)
        lugs = ([x / 2.0 - way * rz / spacing, y, z / 2.0 + way * rx / spacing] for way in (-1.0, 1.0))
        return float(max(map(np.linalg.norm, lugs)))

    def tipping(self, limit: Limit) -> float:
        """Use of a limit of overturning, from the moments of the run's forces about each edge."""
        angle = np.deg2rad(float(self.scene.frame.luffing.value(0.0)))
        base = {
            key: np.deg2rad(float(one.value(0.0)))
            for key, one in (self.scene.frame.base.motions if self.scene.frame.base else {}).items()
        }
        turned = _about_y(-angle)
        ground = _about_y(base.get("ry", 0.0)) @ _about_x(base.get("rx", 0.0))
        down = ground.T @ [0.0, 0.0, -G]
        response, names = self.response, ("x", "y", "z", "rx", "ry", "rz")
        wrench = [
            response.other(f"reaction of pivot {axis}")[0]
            if f"reaction of pivot {axis}" in response.other_names
            else 0.0
            for axis in names
        ]
        force, moment = turned @ wrench[:3], turned @ wrench[3:]
        tip = np.zeros(3)
        for k, one in enumerate(response.outputs[: len(response.output_names)]):
            if one.kind == "tip" and one.body == self.scene.names[-1]:
                tip["xyz".index(one.direction)] = response.displacement[0, k]
        along = sum(float(path.value(0.0)) for path in self.scene.paths.values()) + self.scene.sections[-1].length
        place = turned @ (np.array(self.scene.frame.tail_position) + [along, 0.0, 0.0] + self.offset + tip)
        corners = [np.array([*one, -limit.height]) for one in limit.polygon]
        corners = corners[::-1]
        if _area(limit.polygon) > 0.0:
            corners = corners[::-1]
        worst = -np.inf
        for first, second in zip(corners, corners[1:] + corners[:1], strict=True):
            edge = (second - first) / np.linalg.norm(second - first)
            load = edge @ np.cross(place - first, self.mass * down)
            every = edge @ (moment + np.cross(-first, force))
            machine = sum(edge @ np.cross(np.array(one.at) - first, one.mass * down) for one in limit.machine)
            worst = max(worst, limit.factor * load / (load - every - machine))
        return float(worst)


#: What a run says at its start of the quantity of each kind of limit; of overturning, the share that is used.
VALUES: dict[str, Callable[[Run, Limit], float]] = {
    "stress": lambda run, limit: run._stress(),
    "pad": lambda run, limit: max(abs(run.response.of("pad")[0])),
    "deflection": lambda run, limit: np.linalg.norm(run.response.of("tip", body=run.scene.names[-1])[0]),
    "luffing": lambda run, limit: abs(run.response.other(CYLINDER)[0]),
    "rope": lambda run, limit: max(run._ropes().values()),
    "cylinder": lambda run, limit: max((run._cylinders() | run._ropes()).values()),
    "support": lambda run, limit: run._support(),
    "lug": lambda run, limit: run._lug(),
    "tipping": lambda run, limit: run.response.of("tipping")[0].max(),
    "outrigger": lambda run, limit: run.response.of("outrigger")[0].max(),
    "lift-off": lambda run, limit: run.response.of("outrigger")[0].min(),
    "buckling": lambda run, limit: second_order_effect(run.scene, run.system.bodies).least_factor,
    "frequency": lambda run, limit: run._frequency(),
    "overturning": lambda run, limit: run.tipping(limit),
}
#: Kinds of limits that other tests compare: those of a user, the field, which takes shells, and pulls of the cylinder.
OTHERS = {"function", "expression", "field", "luffing-pull"}


def _area(polygon: Sequence[tuple[float, float]]) -> float:
    """Twice the signed area of a polygon."""
    x, y = np.array(polygon).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _about_y(angle: float) -> Array:
    """Rotation matrix about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _about_x(angle: float) -> Array:
    """Rotation matrix about x."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def run(plain: Mapping[str, Any], wind: float, mass: float, point: Point | None = None) -> Run:
    """Simulate the machine at rest with `mass` kg at its tip, or at `point`, and a force of the wind in N."""
    changed = copy.deepcopy(dict(plain))
    last = changed["sections"][-1]
    payload = {"name": "payload", "on": "tip", "mass": mass} | ({"at": point} if point else {})
    last["masses"] = [*last.get("masses", ()), payload]
    last["loads"][0]["signal"]["amount"] = wind
    changed["gravity"] = {"rise": 0.0}
    scene = scene_of(changed)
    system = join_bodies(scene, reduce_bodies(scene, tasks.bodies_of(scene)))
    excitation = Excitation.from_scene(scene)
    moved = systems.simulate(system, excitation, systems.start_of(system, excitation))
    end = (scene.sections[-1].length, 0.0, 0.0)
    response = with_forces_on_machine(scene, evaluate_motion(system, moved))
    return Run(scene, system, response, mass, np.subtract(point or end, end))


def beside(seed: int, offset: Point | None = None) -> list[tuple[str, float, float, float]]:
    """Compare a random machine's load chart with runs: a row (kind, load in kg, use - 1, bar) for each limit.

    The use of a limit is that of the run under the load that the chart allows; the bar is the error bar as a share of
    the limit.  The load hangs at `offset` in m from the end of the axis.
    """
    plain, extensions, angle = random_machine(seed)
    rng = np.random.default_rng([seed, 47])
    wind = float(rng.choice([0.0, rng.uniform(-300.0, 300.0)]))
    end = (scene_of(plain).sections[-1].length, 0.0, 0.0)
    point = None if offset is None else tuple(np.add(end, offset).tolist())
    found = chart(plain, extensions, angle, wind, float(rng.uniform(200.0, 900.0)), point)
    rows, runs = [], dict[float, Run]()
    for limit, load, bar in zip(found.limits, found.load, found.bar, strict=True):
        if not load > 0.0 or not np.isfinite(bar):
            continue
        key = float(load)
        near = next((one for one in runs if abs(one - key) < 1e-7 * key), None)
        there = runs[near] if near is not None else runs.setdefault(key, run(plain, wind, key, point))
        if limit.of == "overturning":
            share = there.value(limit)
        elif limit.of == "buckling" and there.lifts:
            continue
        elif limit.least is not None:
            share = limit.least / there.value(limit)
        else:
            share = there.value(limit) / float(limit.most or 1.0)
        rows.append((limit.of, key, share - 1.0, float(bar)))
    return rows
