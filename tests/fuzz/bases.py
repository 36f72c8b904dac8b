"""Small scenes of every kind, each a fraction of a second, from which mutations start."""

from typing import Any

BEAM: dict[str, Any] = {
    "title": "Beam",
    "body": {"model": "beam2d", "profile": {"length": 5.0, "bending_stiffness": 5.0e4, "mass_per_length": 78.0}},
    "mesh": {"elements": 10},
    "supports": [{"on": 0.0, "kind": "pinned"}],
    "slider": {"path": {"kind": "ramp", "times": [0.05, 0.15], "values": [1.25, 3.75]}},
    "loads": [{"name": "F", "on": 5.0, "direction": "z", "signal": -50.0}],
    "time": {"end": 0.2, "step": 2e-3, "rho_inf": 0.9},
    "reduction": {"basis": "eigenmodes", "snapshots": 4, "modes": 4, "coordinates": 8, "positions": "nodes"},
    "simulation": {"simulators": ["march"]},
}
PAPER: dict[str, Any] = BEAM | {
    "title": "Paper",
    "body": {"model": "beam2d", "profile": BEAM["body"]["profile"] | {"axial": True, "axial_stiffness": 2.0e7}},
    "loads": [
        {
            "name": "F",
            "on": 5.0,
            "signal": {"kind": "chirp", "amplitude": 50.0, "times": [0.0, 0.1, 0.2], "frequencies": [1.0, 10.0, 1.0]},
        }
    ],
    "reduction": {
        "basis": "paper",
        "snapshots": 5,
        "modes": 6,
        "coordinates": 12,
        "positions": "nodes",
        "solver": "dense",
    },
    "simulation": {"simulators": ["march", "exudyn"]},
    "compare": {"against": ["full", "ancf"], "ancf_elements": 6},
    "published": {"source": "a paper", "errors": {"reduced_vs_full": {"tip": 0.01}}, "max_displacement": 0.05},
}
FLEXIBLE: dict[str, Any] = BEAM | {
    "title": "Flexible",
    "slider": {"path": {"kind": "smooth_ramp", "times": [0.0, 0.2], "values": [1.5, 2.5]}, "offsets": [0.0, 0.8]},
    "damping": {"ratio": 0.01, "frequencies": [1.0, 50.0]},
    "loads": [
        {"name": "F", "on": 5.0, "signal": {"kind": "sine", "amplitude": 50.0, "frequency": 3.0, "phase": 0.1}},
        {"name": "T", "on": 2.5, "direction": "ry", "signal": {"kind": "step", "time": 0.1, "after": 5.0}},
        {
            "name": "G",
            "on": 4.0,
            "signal": {
                "kind": "sum",
                "terms": [{"kind": "table", "times": [0.0, 0.1, 0.2], "values": [0.0, 9.0, 3.0]}],
            },
        },
    ],
    "reduction": {"basis": "free_modes", "flexibility": True, "coordinates": 5},
    "simulation": {"simulators": ["march"], "repeats": 1, "full": "auto"},
    "accuracy": {"tolerance": 0.05, "outputs": ["beam", "pad_force"], "mesh": True},
}
BOOM: dict[str, Any] = {
    "title": "Boom",
    "body": {"model": "beam3d", "box": {"length": 6.0, "width": 0.3, "height": 0.4, "wall": 0.008},
     "material": {"young": 210e9, "poisson": 0.3, "density": 7850.0}, "shear": True},
    "mesh": {"elements": 20},
    "pads": [{"name": "tail", "at": 0.15, "faces": {"bottom": [-0.1, 0.1], "top": [0.0], "left": [0.0],
     "right": [0.0]}}, {"name": "mouth", "moving": True, "faces": {"bottom": [-0.1, 0.1], "top": [0.0], "left": [0.0],
     "right": [0.0]}}],
    "supports": [{"name": "cylinder", "on": "tail", "directions": ["x"], "stiffness": "rigid"}],
    "masses": [{"name": "payload", "on": "tip", "mass": 250.0}],
    "slider": {"path": {"kind": "smooth_ramp", "times": [0.0, 0.1, 0.2], "values": [1.5, 1.8, 1.5]}},
    "loads": [{"name": "tip force", "on": "tip", "direction": "z", "signal": {"kind": "sine", "amplitude": 2000.0,
     "frequency": 5.0}}],
    "gravity": {"acceleration": 9.80665, "direction": [0.0, 0.0, -1.0], "rise": 0.1},
    "damping": {"ratio": 0.005, "frequencies": [10.0, 60.0]},
    "time": {"end": 0.2, "step": 2e-3},
    "observe": {"start": 0.2, "end": 5.8, "count": 9},
    "reduction": {"coordinates": 6},
    "recovery": {"every": 0.02, "stress": True, "frames": 3, "series": False},
}  # fmt: skip
PUSHING: dict[str, Any] = BOOM | {
    "title": "Pads that push",
    "pads": [pad | {"unilateral": True, "clearance": 1e-4, "stiffness": 1e7} for pad in BOOM["pads"]],
    "compare": {"against": []},
}
PLANAR_BOOM: dict[str, Any] = BOOM | {
    "title": "Planar boom",
    "body": {key: value for key, value in BOOM["body"].items() if key != "shear"} | {"model": "beam2d"},
    "recovery": {"every": 0.02, "stress": False, "frames": 3, "series": False},
}
SHELL: dict[str, Any] = BOOM | {
    "title": "Shell",
    "body": {"model": "shell", "box": {"length": 2.0, "width": 0.3, "height": 0.4, "wall": 0.008}},
    "mesh": {"size": 0.15, "along": 0.25},
    "slider": {"path": 1.0},
    "observe": {"start": 0.2, "end": 1.8, "count": 5},
    "time": {"end": 0.05, "step": 1e-3},
    "reduction": {"coordinates": 4},
    "compare": {"against": []},
    "recovery": {"every": 0.025, "stress": True, "frames": 2, "series": False},
}
DOUBLED: dict[str, Any] = BOOM | {
    "title": "Doubled",
    "body": BOOM["body"]
    | {
        "box": BOOM["body"]["box"]
        | {
            "doublers": [
                {"start": 0.0, "end": 0.7, "thickness": 0.006},
                {"start": 0.4, "end": 1.5, "thickness": 0.004, "faces": ["bottom", "left"], "side": "inner"},
            ]
        }
    },
}
TAPERED: dict[str, Any] = DOUBLED | {
    "title": "Tapered",
    "body": DOUBLED["body"]
    | {
        "box": DOUBLED["body"]["box"]
        | {
            "frames": [0.3, 3.0, 5.2],
            "frame_depth": 0.04,
            "tip_taper": {"length": 1.5, "height": 0.3, "width": 0.2, "wall": 0.006},
            "tail_taper": {"length": 0.5, "wall": {"bottom": 0.006, "sides": 0.005, "top": 0.008}},
        }
    },
}
MOVED: dict[str, Any] = BOOM | {
    "title": "Boom on a machine that moves by itself",
    "gravity": {"rise": 0.0},
    "frame": {
        "pivot": [0.0, 0.0, 0.0],
        "luffing": {"kind": "smooth_ramp", "times": [0.0, 0.2], "values": [0.3, 0.6]},
        "machine": {
            "mass": 3000.0,
            "center": [0.0, 0.0, -0.5],
            "inertia": [1000.0, 2000.0, 2000.0],
            "free": ["z", "ry"],
            "stiffness": {"z": 2e6, "ry": 3e6},
            "damping": {"z": 2e4, "ry": 3e4},
            "rate": {"z": 0.01},
        },
    },
}
LUFFED: dict[str, Any] = BOOM | {
    "title": "Boom raised by oil",
    "gravity": {"rise": 0.0},
    "frame": {
        "pivot": [0.0, 0.0, 0.0],
        "luffing": "free",
        "luffing_start": 0.3,
        "cylinder": {
            "foot": [0.5, -0.6],
            "lug": [1.2, -0.15],
            "stroke": [0.6, 1.3],
            "oil": {
                "areas": [8e-3, 5e-3],
                "dead_volumes": [2e-4, 3e-4],
                "hose_volumes": [0.0, 1e-3],
                "supply": 20e6,
                "back_pressure": 1e6,
                "valve": {
                    "opening": {"kind": "smooth_ramp", "times": [0.0, 0.1], "values": [0.0, 0.5]},
                    "gain": [2e-7, 1e-7],
                    "dead_band": 0.05,
                },
                "counterbalance": {"setting": 9e6, "ratio": 3.0, "range": 4e6, "gain": 2e-7},
            },
        },
    },
}
#: How often each is taken.
BASES = (
    *(BEAM, PAPER, FLEXIBLE, BOOM, BEAM, FLEXIBLE, BOOM, PUSHING, PLANAR_BOOM, BEAM, FLEXIBLE, BOOM, SHELL),
    *(DOUBLED, TAPERED, MOVED, LUFFED),
)
