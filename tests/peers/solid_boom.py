"""Reference boom as 20-node solids of CalculiX, one across the wall, and its matrices by CalculiX."""

import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

LENGTH, WIDTH, HEIGHT, WALL = 6.0, 0.3, 0.4, 0.008
YOUNG, POISSON, DENSITY = 210e9, 0.3, 7850.0
_OUTLINE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) / 2.0


@dataclass(frozen=True)
class SolidBoom:
    """Mesh of the boom: points (N, 3) in m, cells (C, 20) in the order of C3D20R, sets of nodes by name."""

    points: np.ndarray
    cells: np.ndarray
    sets: dict[str, np.ndarray]

    def write(self, folder: Path, step: Sequence[str], held: str = "") -> Path:
        """Write job.inp with a step, and return its path; `held` names a set that is clamped."""
        lines = ["*NODE, NSET=NALL"]
        lines += [f"{i + 1}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(self.points)]
        lines += ["*ELEMENT, TYPE=C3D20R, ELSET=EALL"]
        for i, cell in enumerate(self.cells + 1):
            lines += [f"{i + 1}, " + ", ".join(map(str, cell[:15])) + ",", ", ".join(map(str, cell[15:]))]
        for name, nodes in self.sets.items():
            lines += [f"*NSET, NSET={name}", *(f"{n + 1}," for n in nodes)]
        lines += ["*MATERIAL, NAME=M", "*ELASTIC", f"{YOUNG:.12e}, {POISSON}", "*DENSITY", f"{DENSITY}"]
        lines += ["*SOLID SECTION, MATERIAL=M, ELSET=EALL", *(["*BOUNDARY", f"{held}, 1, 3"] if held else [])]
        (folder / "job.inp").write_text("\n".join([*lines, *step]) + "\n")
        return folder / "job.inp"

    def matrices(self, folder: Path) -> Path:
        """Write job.sti, job.mas and job.dof of the body that nothing holds, and return the path of job.sti."""
        self.write(folder, ["*STEP", "*FREQUENCY, SOLVER=MATRIXSTORAGE", "4", "*END STEP"])
        subprocess.run(["ccx", "job"], cwd=folder, capture_output=True, timeout=600, check=False)  # it exits with 201
        return folder / "job.sti"

    def frequencies(self, count: int, folder: Path) -> np.ndarray:
        """Lowest `count` frequencies in Hz, clamped at the tail."""
        self.write(folder, ["*STEP", "*FREQUENCY", f"{count}", "*END STEP"], held="TAIL")
        subprocess.run(["ccx", "job"], cwd=folder, capture_output=True, timeout=600, check=True)
        found = []
        for line in (folder / "job.dat").read_text().splitlines():
            parts = line.split()
            if len(parts) == 5 and parts[0] == str(len(found) + 1):
                found.append(float(parts[2]) / (2.0 * np.pi))
        return np.array(found[:count])


def solid_boom(along: int, wide: int, high: int) -> SolidBoom:
    """Mesh the boom with `along` cells along the axis, `wide` and `high` along the walls of width and of height."""
    corners = np.cumsum([0, wide, high, wide, high])
    counts = (along, int(corners[-1]), 1)
    used = np.indices([2 * n + 1 for n in counts]).transpose(1, 2, 3, 0)
    number = np.full(used.shape[:3], -1)
    real = (used % 2).sum(axis=-1) <= 1  # vertices and middles of edges
    real[:, -1] = False  # the last is the first again
    number[real] = np.arange(real.sum())
    number[:, -1] = number[:, 0]
    u, v, w = (used[real][:, k] / (2.0 * counts[k]) for k in range(3))
    around = np.stack([np.interp(v, corners / corners[-1], _OUTLINE[:, k]) for k in range(2)], axis=1)
    size = np.array([WIDTH, HEIGHT]) + WALL * (2.0 * w[:, None] - 1.0)
    points = np.column_stack([LENGTH * u, around * size])
    a, b = (g.ravel() for g in np.meshgrid(2 * np.arange(along), 2 * np.arange(corners[-1]), indexing="ij"))
    # x, around, outwards: a right-handed cell of C3D20R
    low = [(0, 0), (2, 0), (2, 2), (0, 2)]
    middle = [(1, 0), (2, 1), (1, 2), (0, 1)]
    order = [(p, q, r) for r in (2, 0) for p, q in low] + [(p, q, r) for r in (2, 0) for p, q in middle]
    order += [(p, q, 1) for p, q in low]
    cells = np.stack([number[a + p, b + q, r] for p, q, r in order], axis=1)
    x, y, z = points.T
    outer = {"BOTTOM": z + (HEIGHT + WALL) / 2, "TOP": z - (HEIGHT + WALL) / 2}
    outer |= {"RIGHT": y + (WIDTH + WALL) / 2, "LEFT": y - (WIDTH + WALL) / 2}
    sets = {name: np.flatnonzero(np.abs(gap) < 1e-9) for name, gap in outer.items()}
    sets |= {"TAIL": np.flatnonzero(x < 1e-9), "TIP": np.flatnonzero(x > LENGTH - 1e-9)}
    return SolidBoom(points, cells, sets)
