"""
An emergency stop on outriggers
===============================

A boom at full reach is lowered at a steady speed and stopped.  Its machine stands on four outriggers.  The boom swings
on after the stop, and so do the forces of the outriggers: with the shorter stop one of them lifts off.
"""

import matplotlib.pyplot as plt

import pmr
from pmr.report.document import render_runs
from pmr.report.sections import chapter
from pmr.scene import Scene

faces = {"bottom": [-0.06, 0.06], "top": [-0.06, 0.06], "left": [0.0], "right": [0.0]}
pads = [{"at": 0.2, "faces": faces, "unilateral": False}]
own = {"mesh": {"elements": 8}, "reduction": {"coordinates": 10, "estimate": False}}
box = {"length": 7.0, "width": 0.30, "height": 0.40, "wall": 0.007}
out = {"kind": "constant", "amount": 5.5}
ground = {
    "height": 1.5,
    "slope": [0.0, 1.0],
    "masses": [
        {"name": "carrier", "mass": 5000.0, "at": [-0.5, 0.0, -0.8], "inertia": [5e3, 1.4e4, 1.6e4]},
        {"name": "turntable", "mass": 1000.0, "at": [-0.8, 0.0, -0.1], "slews": True},
    ],
    "outriggers": [
        {"name": "front left", "at": [2.2, 2.0]},
        {"name": "front right", "at": [2.2, -2.0]},
        {"name": "rear left", "at": [-2.2, 2.0]},
        {"name": "rear right", "at": [-2.2, -2.0]},
    ],
}


def stopped(seconds: float) -> pmr.RunResult:
    """Run of a boom that is stopped within so many seconds, from 8 degrees a second at 15 degrees."""
    times = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 2.5 + seconds, 4.0, 6.0]
    values = [31.0, 30.0, 27.0, 23.0, 19.0, 15.0, *[15.0 - 4.0 * seconds] * 3]
    frame = {
        "pivot": [0.0, 0.0, 0.0],
        "unit": "degrees",
        "slewing": {"kind": "constant", "amount": 35.0},
        "luffing": {"kind": "table", "times": times, "values": values},
        "ground": ground,
    }
    scene = Scene.model_validate({
        "title": "Emergency stop",
        "frame": frame,
        "sections": [
            {"name": "base", "body": {"model": "beam3d", "box": box}, **own,
             "supports": [{"name": "clamp", "on": "tail", "kind": "clamped"}]},
            {"name": "fly", "body": {"model": "beam3d", "box": box | {"width": 0.26, "height": 0.36, "wall": 0.006}},
             **own, "joint": {"extension": out, "tail": pads, "mouth": pads},
             "masses": [{"name": "basket", "on": "tip", "mass": 250.0, "at": [7.4, 0.3, 0.0]}]},
        ],
        "damping": {"ratio": 0.01, "frequencies": [1.0, 30.0]},
        "compare": {"against": [], "richer": "none"},
        "time": {"end": 6.0, "step": 5e-3},
        "simulation": {"repeats": 1},
    })  # fmt: skip
    return pmr.run(scene).result


results = {seconds: stopped(seconds) for seconds in (1.0, 0.25)}
for seconds, result in results.items():
    stand = result.summary["ground"]
    least = min(stand["margins"], key=lambda of: of["min"])
    lifted = [of["name"] for of in stand["outriggers"] if "lifted" in of]
    print(f"stopped in {seconds:g} s: least margin {1e-3 * least['min']:.0f} kN m over {least['name']}; "
          f"lifts off: {', '.join(lifted) or 'none'}")  # fmt: skip

# %%
figure, rows = plt.subplots(2, 1, figsize=(7, 5), sharex=True, layout="constrained")
for (seconds, result), axes in zip(results.items(), rows, strict=True):
    response = result.responses["reduced"]
    for leg in ground["outriggers"]:
        axes.plot(response.t, 1e-3 * response.other(f"force of outrigger {leg['name']}"), label=leg["name"])
    axes.set(ylabel="force in kN", title=f"stopped within {seconds:g} s")
rows[-1].set_xlabel("time in s")
rows[0].legend(ncols=2)
plt.show()

# %%
# The page of the last run's report.

report = render_runs([chapter(result, "stop")])
