"""Load charts beside full order at random places: the reduction's part of the error bars."""

import os
from pathlib import Path

import numpy as np
import plain_machines
import pytest
from chart_beside_full import beside, crane, random_places

from pmr.scene import load_any
from pmr.scene.ground import MachineMass
from pmr.studies.limits import Limit

pytestmark = pytest.mark.slow

TELESCOPE = Path(__file__).with_name("telescope.toml")
POLYGON = ((2.5, 2.5), (-2.5, 2.5), (-2.5, -2.5), (2.5, -2.5))
MACHINE = (MachineMass(name="carrier", mass=14000.0, at=(-0.5, 0.0, -1.0)),)
#: Without the luffing cylinder and tipping: forces at the pivot are those of reduced models (`test_chart_beside_run`).
LIMITS = [
    Limit(name="stress", of="stress", most=120e6),
    Limit(name="pads", of="pad", most=40e3),
    Limit(name="cylinders", of="cylinder", most=15e3),
    Limit(name="support", of="support", most=100e3, which=("*luffing*",)),
    Limit(name="tip", of="deflection", most=0.3),
    Limit(name="expression", of="expression", expression='abs(force["cylinder of fly"]) + 0.1 * load', most=16e3),
    Limit(name="buckling", of="buckling", least=3.0),
    Limit(name="frequency", of="frequency", least=0.5),
]


def test_a_planar_telescope_of_soft_sections() -> None:
    """At 95 % of the places, of what all limits allow; the bars are no more than 2 % of the loads.

    The last three of 20 places that were drawn beforehand, among which pads govern too; all of them in a full sweep.
    """
    count = 20 if os.environ.get("PMR_SWEEP") == "full" else 3
    limits = [
        Limit(name="pads", of="pad", most=40e3),
        Limit(name="tip", of="deflection", most=0.6),
        Limit(name="buckling", of="buckling", least=3.0),
        Limit(name="frequency", of="frequency", least=0.3),
    ]
    rng = np.random.default_rng(20)
    along = [rng.uniform(0.7, 4.5, 20) for _ in range(2)]
    scene = load_any(TELESCOPE, ["frame.second_order=true"])
    found = beside(scene, np.column_stack([*along, rng.uniform(0.0, 1.3, 20)])[-count:], limits, 1e5)
    governs = np.nanargmin(found.load, axis=1)
    least, bars = (one[np.arange(count), governs] for one in (found.load, found.error))
    assert found.agreed.sum() >= 0.95 * count and (bars <= 0.02 * least).all() and len(set(governs.tolist())) > 1
    assert found.inside[found.known].mean() >= 0.95


def test_the_crane_in_space_by_all_limits() -> None:
    """At 95 % of the places by each limit; it buckles sideways, where errors of two models cancel.

    The last four of 20 places that were drawn beforehand, all of them in a full sweep.
    """
    count = 20 if os.environ.get("PMR_SWEEP") == "full" else 4
    found = beside(crane(), random_places(261)[-count:], LIMITS, 1e5)
    known, inside = found.known, found.inside & found.known
    assert found.agreed.sum() >= 0.95 * count
    assert (known.sum(axis=0) >= np.array([20] * 6 + [15, 20, 8]) * count // 20).all()
    assert (inside.sum(axis=0) >= 0.95 * known.sum(axis=0)).all()
    assert (found.error <= 0.05 * found.load)[known].all()


def test_a_boom_with_a_shell() -> None:
    """Pads, deflection, a probe and the field of all walls, where the last section is a shell of 1,300 coordinates.

    At one of ten places that were drawn beforehand, at all of them in a full sweep.
    """
    changes = ["sections.fly.masses=[]", "frame.second_order=true", "section.mesh.elements=6"]
    changes += ["sections.fly.mesh={size=0.32,along=1.5}"]
    # pads three times as long, with a third of the stations on each path
    changes += [f"section.joint.{ring}.0.{key}" for ring in ("tail", "mouth") for key in ("length=0.9", "at=0.45")]
    changes += [f"{of}.joint.extension.values=[0.6, 4.2]" for of in ("section", "sections.fly")]  # no pads overlap
    changes += ["sections.fly.probes=[{name='top',at=[2.0,0.0,0.163],measures=['stress']}]"]
    limits = [
        Limit(name="pads", of="pad", most=40e3),
        Limit(name="tip", of="deflection", most=0.15),
        Limit(name="top", of="stress", most=60e6),
        Limit(name="field", of="field", which=("fly",), most=100e6),
    ]
    rng = np.random.default_rng(2611)
    along = [rng.uniform(0.7, 4.2, 10) for _ in range(2)]
    places = np.column_stack([*along, rng.uniform(0.0, 1.3, 10)])
    some = places if os.environ.get("PMR_SWEEP") == "full" else places[:1]
    found = beside(load_any(plain_machines.CRANE_SHELL, changes), some, limits, 3e4)
    assert found.known[:, :4].all() and found.inside[:, :4].all()
    assert (found.error[:, :2] <= 1e-3 * found.load[:, :2]).all()  # stresses are local, their bars larger
