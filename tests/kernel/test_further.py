"""Further outputs and continuous time: beside balances of forces in NumPy, rotations of SciPy, and differences."""

import numpy as np
import plain_machines
import pytest
from compare.test_luffing_cylinder import FOOT, LENGTH, LUG, MASS, G, raised
from kernels import evaluate
from scipy.spatial.transform import Rotation

import pmr
from pmr import System
from pmr.files.arrays import Array
from pmr.kernel.kernel import Kernel
from pmr.kernel.state import BoundStep, Settings, State
from pmr.scene.mechanism import CYLINDER
from pmr.simulation.modal import modal_form
from pmr.simulation.moving import MovingFrame
from pmr.simulation.native.form import SystemForm
from pmr.system.assembly import Assembly

STEP = 2e-3
CRANE = (
    *("compare.against=[]", "section.mesh.elements=6", "frame.second_order=true", "time.end=0.1"),
    *(f"section.joint.{ring}.0.{key}" for ring in ("tail", "mouth") for key in ("length=0.9", "at=0.45")),
    "section.joint.cylinder.stiffness=5e7",
    "frame.base.rx={kind='sine',amplitude=2.0,frequency=1.5}",
    "frame.base.rz={kind='sine',amplitude=3.0,frequency=0.7}",
    f"time.step={STEP}",
    "frame.ground={height=1.5, masses=[{name='m', mass=9e3, at=[-0.5, 0.1, -0.6], inertia=[9e3, 8e3, 9e3]}], "
    "outriggers=[{name='a', at=[3.0, 2.0]}, {name='b', at=[-3.0, 2.0]}, {name='c', at=[-3.0, -2.0]}, "
    "{name='d', at=[3.0, -2.0]}]}",
)


class Moved:
    """A crane on a ship, and its state after some steps of motions that no scene has."""

    def __init__(self) -> None:
        self.system: System = pmr.reduce(pmr.load_scene(plain_machines.CRANE, [*CRANE])).system
        frame = MovingFrame.from_system(self.system)
        assert frame is not None
        self.frame: MovingFrame = frame
        self.forms = {name: modal_form(body) for name, body in self.system.reduced.items()}
        self.kernel = Kernel.of(self.system, self.forms, frame)
        self.state = State(self.kernel, Settings(STEP, 0.9))
        self.rng, self.motions = np.random.default_rng(8), frame.start.copy()
        n = len(frame.paths)
        self.motions[0, :n] += [0.7171, 0.3131]
        self.state.start_in_frame("equilibrium", self.motions)
        for _ in range(20):
            self.motions[0] += STEP * self.rng.uniform(0.0, 0.1, len(frame.drivers))
            self.motions[1:, :n] = self.rng.uniform(-0.2, 0.2, (2, n))
            self.motions[1:, n + len(frame.loads) : n + len(frame.loads) + len(frame.angles)] = 0.1
            self.state.step_in_frame(self.motions)

    def coordinates(self, modal: Array) -> dict[str, Array]:
        """Coordinates of the bodies from modal ones (modes,)."""
        ends = np.cumsum([form.body.size for form in self.forms.values()])[:-1]
        parts = np.split(modal[SystemForm(self.system, self.forms).mode_columns], ends)
        return {name: form.X @ z for (name, form), z in zip(self.forms.items(), parts, strict=True)}


@pytest.fixture(scope="module")
def moved() -> Moved:
    return Moved()


@pytest.mark.slow
def test_reactions_are_what_balances_the_body(moved: Moved) -> None:
    r"""Phi^T (B f + w - M q" - D q' - K q - C^T lambda) with accelerations by the whole system."""
    system, state, assembly = moved.system, moved.state, Assembly(moved.system)
    f, c = np.split(state.drivers[len(system.paths) :], [len(system.input_names)])
    q, v = moved.coordinates(state.z), moved.coordinates(state.v)
    s = dict(zip(system.paths, state.drivers, strict=False))
    rows, forces = assembly.contact_rows(system.side_coordinates(s)), state.outputs()[1]
    whole = {name: np.concatenate([x[one] for one in system.bodies]) for name, x in (("q", q), ("v", v))}
    right = assembly.B @ f - assembly.D @ whole["v"] - assembly.K @ whole["q"] - rows.C.T @ forces
    at = {name: np.arange(place.start, place.stop) for name, place in assembly.coordinate_slices.items()}
    base = system.reduced["base"]
    reactions = base.reactions
    assert reactions is not None and reactions.carried is not None and base.carriers is not None
    found = reactions.inputs @ f[: len(base.input_names)] - reactions.damping[:, : base.size] @ v["base"]
    found = found - reactions.stiffness[:, : base.size] @ q["base"]
    for term, amplitude in zip(system.terms, c, strict=True):
        on = np.concatenate([at[name] for name in term.bodies])
        for key, A in term.arrays.items():
            moving = whole["q" if key == "stiffness" else "v"][on]
            right[on] -= amplitude * (A @ moving)
            if "base" in term.supports:
                found = found - amplitude * (term.supports["base"] @ moving)
    accelerations = np.linalg.solve(assembly.M.toarray(), right)[at["base"]]
    found = found - reactions.inertia[:, : base.size] @ accelerations
    for side, x in zip(system.sides, system.side_coordinates(s), strict=True):
        if side.place.body == "base":
            weights = side.sign * system.row(side.place).weights(x).toarray()[0]
            found = found - forces[side.contact] * (weights @ reactions.carried)
    names = moved.kernel.names("further")
    assert names[: len(found)] == tuple(f"reaction of base: {name}" for name in reactions.names)
    np.testing.assert_allclose(
        state.further()[: len(found)], found + _pin(moved), rtol=0.0, atol=1e-8 * np.abs(found).max()
    )


def _pin(moved: Moved) -> Array:
    """What the luffing cylinder adds to the pin: its force along its line, and the force across that stands for it."""
    names, frame = moved.kernel.names("further"), moved.frame.scene.frame
    assert frame is not None
    added = np.zeros(sum(name.startswith("reaction of base:") for name in names))
    if CYLINDER in names and frame.cylinder is not None:
        angle = moved.motions[0, moved.frame.drivers.index("luffing")]
        along = moved.state.further()[names.index(CYLINDER)] * frame.cylinder.direction(angle)
        across = moved.state.outputs()[0][moved.kernel.names("outputs").index("base: force of luffing cylinder")]
        for axis, value in (("x", along[0]), ("z", along[1] + across)):
            added[names.index(f"reaction of base: pin {axis}")] = value
    return added


@pytest.mark.slow
def test_the_tip_is_where_rotations_take_it(moved: Moved) -> None:
    at = dict(zip(moved.frame.drivers, moved.motions[0], strict=True))
    y = dict(zip(moved.kernel.names("outputs"), moved.state.outputs()[0], strict=True))
    scene = moved.frame.scene
    assert scene.frame is not None
    u = [y.get(f"fly: tip {axis}", 0.0) for axis in "xyz"]
    reach = at["middle"] + at["fly"] + scene.sections[-1].length
    rocked = Rotation.from_euler("ZYX", [at[f"base.{axis}"] for axis in ("rz", "ry", "rx")])
    turned = rocked * Rotation.from_euler("ZY", [at.get("slewing", 0.0), -at["luffing"]])
    expected = turned.apply(np.array(scene.frame.tail_position) + u + [reach, 0.0, 0.0])
    first = moved.kernel.names("further").index("tip in space X")
    np.testing.assert_allclose(moved.state.further()[first : first + 3], expected, rtol=1e-13)


@pytest.mark.slow
def test_values_change_along_a_seed_as_differences_say(moved: Moved) -> None:
    """Central differences over h: h^2 / 6 of the third derivative off, and round-off over h."""
    state, kernel, rng = moved.state, moved.kernel, moved.rng
    here = evaluate(state, moved.motions)
    for name, value in (("outputs", state.outputs()[0]), ("forces", state.outputs()[1]), ("further", state.further())):
        np.testing.assert_allclose(here[name], value, rtol=0.0, atol=1e-7 * np.abs(value).max())
    seed, nothing, h = rng.normal(size=moved.motions.shape), np.zeros(kernel.modes), 1e-6
    along = evaluate(state, moved.motions, (seed, nothing, nothing))
    ends = [evaluate(state, moved.motions + sign * h * seed) for sign in (1.0, -1.0)]
    for name, slope in along.items():
        expected = (ends[0][name] - ends[1][name]) / (2.0 * h)
        assert np.abs(expected).max() > 0.0
        np.testing.assert_allclose(slope, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.slow
def test_outputs_of_outriggers_are_the_same_alone_and_among_all_others(moved: Moved) -> None:
    """Alone, they are found without displacements of the bodies if no force on the ground depends on these."""
    first = moved.kernel.outputs + moved.kernel.forces
    alone = BoundStep(moved.state, [first + k for k in range(moved.kernel.ground)])
    moved.motions[0] += STEP * moved.rng.uniform(0.0, 0.1, len(moved.frame.drivers))
    moved.state.step_in_frame(moved.motions)
    assert alone.observe() == 0
    np.testing.assert_array_equal(alone.values, moved.state.ground)
    assert np.ptp(alone.values) > 1e4


def test_the_cylinder_carries_the_weight() -> None:
    """Beside the triangle of pivot, foot and lug: the arm is its height over the cylinder."""
    system = pmr.reduce(raised({"kind": "smooth_ramp", "times": [0.0, 2.0], "values": [0.3, 0.9]})).system
    frame = MovingFrame.from_system(system)
    assert frame is not None
    kernel = Kernel.of(system, {name: modal_form(body) for name, body in system.reduced.items()}, frame)
    state, motions = State(kernel, Settings(STEP)), frame.start
    for angle in (-0.2, 0.3, 1.2):
        motions[0, frame.drivers.index("luffing")] = angle
        state.start_in_frame("equilibrium", motions)
        lug = Rotation.from_euler("z", angle).apply([*LUG, 0.0])[:2]
        arm = (FOOT[0] * lug[1] - FOOT[1] * lug[0]) / np.linalg.norm(lug - FOOT)
        further = dict(zip(kernel.names("further"), state.further(), strict=True))
        assert further[CYLINDER] == pytest.approx(MASS * G * LENGTH * np.cos(angle) / arm, rel=1e-5)
