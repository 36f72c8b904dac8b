"""The boom in Exudyn's renderer: what is drawn is where its outputs say."""

from dataclasses import replace

import exudyn as exu
import free_boom
import numpy as np
import pytest
from free_turret import Turret

from pmr import InputError
from pmr.simulation import Excitation
from pmr.simulation.exudyn import add_drawing, add_sensors, add_system
from pmr.simulation.exudyn.solver import BoomDrawing, section_tubes

pytestmark = pytest.mark.slow  # a boom is reduced


def show(turret: Turret) -> None:
    """What the solver ended with, as the renderer would."""
    data = turret.mbs.systemData
    data.SetSystemState(data.GetSystemState(exu.ConfigurationType.Current), exu.ConfigurationType.Visualization)
    data.SetTime(turret.scene.time.end, exu.ConfigurationType.Visualization)


def test_what_is_drawn_is_where_the_outputs_are() -> None:
    """On a turret that turns, pushed from the side while a rod draws it out; ten times as bent where asked for."""
    gust = "sections.fly.loads.gust.signal={kind='constant', amount=2000.0}"
    scene = free_boom.scene("time.end=0.04", gust)
    turret = Turret(scene, initialAngularVelocity=[0.8, -0.5, 1.1])
    turret.draw(rod=50.0, s=0.6, rate=0.5)
    turret.add()
    sensors = add_sensors(turret.mbs, turret.items)
    number = add_drawing(turret.mbs, turret.items, scene)
    plain, bent = (BoomDrawing(turret.mbs, turret.items, scene, scale) for scale in (1.0, 10.0))
    turret.solve()
    show(turret)
    y = turret.mbs.GetSensorStoredData(sensors.sOutputs)[-1, 1:]
    base = turret.base()
    _, _, _, R = base.kinematics(turret.x[-1], turret.x_t[-1])
    out = base.paths.extensions(turret.t[-1], turret.z[-1], turret.z_t[-1]).value
    for drawn, scale in ((plain, 1.0), (bent, 10.0)):
        for k, (name, points) in enumerate(zip(scene.names, drawn.axes(), strict=True)):
            own = (points - base.origin(turret.x[-1])) @ R - scene.frame.tail_position
            at = {f"{name}: {one} at {x:g} m": (x, j) for x in (0.0, 0.5, 1.0, 1.5) for j, one in ((1, "y"), (2, "z"))}
            at |= {f"{name}: tip {one}": (2.0, j) for j, one in ((1, "y"), (2, "z"))}
            for output, (x, axis) in at.items():
                row = own[np.argmin(np.abs(own[:, 0] - out[: k + 1].sum() - x))]
                assert row[axis] == pytest.approx(scale * y[sensors.output_names.index(output)], abs=1e-12)
                assert row[0] == pytest.approx(out[: k + 1].sum() + x, abs=1e-12)
    assert np.abs(y).max() > 1e-4
    fly = plain.graphics()[1]
    points = np.reshape(fly["points"], (5, 4, 3))
    np.testing.assert_allclose(np.linalg.norm(points[:, 1] - points[:, 0], axis=1), 0.21, rtol=1e-6)
    assert len(np.reshape(fly["triangles"], (-1, 3))) == 2 * 4 * 4
    # what Exudyn's renderer has, without a window
    known = turret.renderer.GetGraphicsData()["triangles"]
    own = known["points"][(known["items"][:, 1] == int(exu.ItemType.Object)) & (known["items"][:, 2] == int(number))]
    assert len(own) == 2 * 2 * 4 * 4
    np.testing.assert_allclose(own[len(own) // 2 :, 0], points.reshape(-1, 3)[fly["triangles"][:, 0]], atol=1e-6)


def test_a_boom_on_the_ground_is_where_its_frame_has_it() -> None:
    scene, container = free_boom.scene(), exu.SystemContainer()
    mbs, excitation = container.AddSystem(), Excitation.from_scene(scene)
    items = add_system(mbs, free_boom.system(), excitation.paths, excitation.loads, terms=excitation.terms)
    drawn = BoomDrawing(mbs, items, scene)
    mbs.Assemble()
    base, fly = drawn.axes()
    R, out = scene.frame.rotation(np.array([0.0]))[0], scene.extension(1).value(0.0)
    np.testing.assert_allclose((R.T @ base[0]), scene.frame.tail_position, atol=1e-6)
    np.testing.assert_allclose((R.T @ fly[-1])[:1], scene.frame.tail_position[0] + out + 2.0, atol=1e-6)
    assert R[2, 0] == pytest.approx(np.sin(0.3))


def test_a_section_that_tapers_is_drawn_as_it_does() -> None:
    plain, taper = free_boom.scene(), "sections.fly.body.box.tip_taper={length=0.5,height=0.12}"
    fly, height = section_tubes(free_boom.scene(taper), free_boom.system())[1], plain.sections[1].body.box.height
    drawn = np.ptp(fly.outline[:, :, 1], axis=1)
    expected = np.interp(fly.x, [0.0, 1.5, 2.0], [height, height, 0.12])
    assert drawn == pytest.approx(expected, rel=1e-12) and drawn[-1] < 0.8 * drawn[0]


def test_what_is_refused() -> None:
    turret = Turret(free_boom.scene())
    turret.add()
    (first, body), *others = turret.system.bodies.items()
    body = replace(body, output_kinds=("other",) * len(body.output_names))
    blind = replace(turret.items.parts.equations.system, bodies={first: body, **dict(others)}, terms=(), terms_of=None)
    turret.items.parts.equations.system = blind
    with pytest.raises(InputError, match="stations"):
        add_drawing(turret.mbs, turret.items, turret.scene)
