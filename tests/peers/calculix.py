"""Shell models for CalculiX (ccx) as an independent peer: 8-node shells with reduced integration, S8R."""

import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Mean:
    """Spring of a stiffness in N/m on a weighted mean of the displacements of N nodes.

    Shares (N,) are those of the displacements in `direction` 1 to 3, shares (N, 3) those of all three.  An infinite
    stiffness holds the mean at zero.
    """

    shares: np.ndarray
    direction: int
    stiffness: float
    mass: float = 0.0  # that moves as the mean does, kg (kg m^2 of a rotation)

    @property
    def terms(self) -> list[str]:
        """Terms of an equation, the largest first.

        ccx reads 20 characters of a number, and no exponent behind them.
        """
        shares = self.shares
        if shares.ndim == 1:
            shares = np.outer(shares, np.arange(1, 4) == self.direction)
        return terms(shares)


def terms(shares: np.ndarray) -> list[str]:
    """Terms of an equation from shares (N, 3) of all displacements, the largest first."""
    found = sorted(zip(*np.nonzero(shares), strict=True), key=lambda at: -abs(shares[at]))
    return [f"{n + 1}, {d + 1}, {shares[n, d]:.12e}" for n, d in found]


@dataclass
class Deck:
    """Shell model as an input file of ccx.

    points (N, 3) in m; quads (Q, 8), vertices, then middles of sides; `thickness` of the walls in m, of all or of each
    quad (Q,); `sets` of nodes by name; `held`, tuples of a set, its first and its last degree of freedom from 1 to 6;
    `means`, the springs.
    """

    points: np.ndarray
    quads: np.ndarray
    thickness: float | np.ndarray
    young: float = 210.0e9
    poisson: float = 0.3
    density: float = 7850.0
    sets: Mapping[str, np.ndarray] = field(default_factory=dict)
    held: Sequence[tuple[str, int, int]] = ()
    means: Sequence[Mean] = ()

    def _lines(self) -> list[str]:
        """Lines of the input file without steps."""
        lines = ["*NODE, NSET=NALL"]
        lines += [f"{i + 1}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(self.points)]
        of_quads = np.broadcast_to(self.thickness, len(self.quads))
        walls = dict(enumerate(np.unique(of_quads), start=1))
        for k, wall in walls.items():
            lines += [f"*ELEMENT, TYPE=S8R, ELSET=WALL{k}"]
            of_wall = [(i, self.quads[i]) for i in np.flatnonzero(of_quads == wall)]
            lines += [f"{i + 1}, " + ", ".join(str(n + 1) for n in quad) for i, quad in of_wall]
        for name, nodes in self.sets.items():
            lines += [f"*NSET, NSET={name}", *(f"{n + 1}," for n in nodes)]
        lines += ["*MATERIAL, NAME=M", "*ELASTIC", f"{self.young:.12e}, {self.poisson}", "*DENSITY", f"{self.density}"]
        for k, wall in walls.items():
            lines += [f"*SHELL SECTION, MATERIAL=M, ELSET=WALL{k}", f"{wall:.12e}"]
        lines += ["*BOUNDARY"]
        lines += [f"{name}, {first}, {last}" for name, first, last in self.held]
        for number, mean in enumerate(self.means, start=1):
            lines += self._mean(number, mean)
        return lines

    def _mean(self, number: int, mean: Mean) -> list[str]:
        """Lines of a mean: an equation if it is rigid, else a node that moves as the mean does, on a spring.

        The node has no mass unless the mean has one.
        """
        terms = mean.terms
        if np.isinf(mean.stiffness):
            return ["*EQUATION", f"{len(terms)}", *terms]
        node, element = len(self.points) + number, len(self.quads) + number
        of_mass = [
            *(f"*ELEMENT, TYPE=MASS, ELSET=MASS{number}", f"{element + len(self.means)}, {node}"),
            *(f"*MASS, ELSET=MASS{number}", f"{mean.mass:.12e}"),
        ]
        return [
            *("*NODE", f"{node}, 0.0, 0.0, {number}.0"),
            *(f"*NSET, NSET=MEAN{number}", f"{node},"),
            *(f"*ELEMENT, TYPE=SPRING1, ELSET=SPRING{number}", f"{element}, {node}"),
            *(f"*SPRING, ELSET=SPRING{number}", "1", f"{mean.stiffness:.12e}"),
            *(of_mass if mean.mass else ()),
            *("*BOUNDARY", f"{node}, 2, 3"),
            *("*EQUATION", f"{len(terms) + 1}", f"{node}, 1, -1.0", *terms),
        ]

    def frequencies(self, count: int, folder: Path) -> np.ndarray:
        """Lowest `count` frequencies in Hz."""
        output = self._run(["*STEP", "*FREQUENCY", f"{count}", "*END STEP"], folder, "dat")
        values = []
        for line in output.splitlines():
            parts = line.split()
            if len(parts) == 5 and parts[0].isdigit() and int(parts[0]) == len(values) + 1:
                values.append(float(parts[3]))
            if len(values) == count:
                break
        return np.array(values)

    def buckling_factors(self, loads: Sequence[tuple[int, int, float]], count: int, folder: Path) -> np.ndarray:
        """Lowest `count` factors by which loads (node, direction 1 to 3, N) buckle the shell."""
        step = [
            "*STEP", "*BUCKLE", f"{count}", "*CLOAD", *(f"{n + 1}, {d}, {f:.12e}" for n, d, f in loads), "*END STEP",
        ]  # fmt: skip
        found = [line.split() for line in self._run(step, folder, "dat").splitlines()]
        return np.array([float(parts[1]) for parts in found if len(parts) == 2 and parts[0].isdigit()])

    def displacements(
        self, loads: Sequence[tuple[int, int, float]], name: str, folder: Path, *, large: bool = False
    ) -> np.ndarray:
        """Static displacements (k, 3) in m of the k nodes of a set, under loads (node, direction 1 to 3, N).

        If `large`, they are found in the deformed geometry.
        """
        step = ["*STEP, NLGEOM", "*STATIC", "0.25, 1.0"] if large else ["*STEP", "*STATIC"]
        step += ["*CLOAD", *(f"{n + 1}, {d}, {f:.12e}" for n, d, f in loads)]
        step += [f"*NODE PRINT, NSET={name}", "U", "*END STEP"]
        found = {}  # of several increments the last one
        for line in self._run(step, folder, "dat").splitlines():
            parts = line.split()
            if len(parts) == 4 and parts[0].isdigit():
                found[int(parts[0]) - 1] = [float(x) for x in parts[1:]]
        return np.array([found[n] for n in self.sets[name]])

    def resting(self, acceleration: np.ndarray, forces: Mapping[int, float], folder: Path) -> dict[int, float]:
        """Displacement in m of some means at rest, under an acceleration (3,) of all walls and forces in N on means."""
        g = float(np.linalg.norm(acceleration))
        walls = len(np.unique(np.broadcast_to(self.thickness, len(self.quads))))
        along = ", ".join(f"{c / g:.12e}" for c in acceleration)
        step = ["*STEP", "*STATIC", "*DLOAD", *(f"WALL{k}, GRAV, {g:.12e}, {along}" for k in range(1, walls + 1))]
        nodes = {number: len(self.points) + number + 1 for number in forces}
        step += ["*CLOAD", *(f"{nodes[number]}, 1, {force:.12e}" for number, force in forces.items())]
        for number in forces:
            step += [f"*NODE PRINT, NSET=MEAN{number + 1}", "U"]
        lines = self._run([*step, "*END STEP"], folder, "dat").splitlines()
        rows = [parts for parts in map(str.split, lines) if len(parts) == 4 and parts[0].isdigit()]
        found = {int(row[0]): float(row[1]) for row in rows}
        return {number: found[node] for number, node in nodes.items()}

    def _run(self, step: Sequence[str], folder: Path, result: str) -> str:
        """Run ccx with a step, and return the text of a result file."""
        (folder / "deck.inp").write_text("\n".join([*self._lines(), *step]) + "\n")
        done = subprocess.run(["ccx", "deck"], cwd=folder, capture_output=True, text=True, timeout=600, check=False)
        assert done.returncode == 0, done.stdout[-2000:]
        return (folder / f"deck.{result}").read_text()


def grid(place, n: tuple[int, int], closed: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """8-node rectangles of the unit square with vertices at ``place(u, v)``: points, quads, and node numbers.

    The numbers (2 n_u + 1, 2 n_v + 1) are those of nodes at half steps, -1 in the middle of a rectangle.  If `closed`,
    nodes at v = 1 are those at v = 0.
    """
    nu, nv = n
    number = np.full((2 * nu + 1, 2 * nv + 1), -1)
    used = np.ones(number.shape, bool)
    used[1::2, 1::2] = False
    if closed:
        used[:, -1] = False
    number[used] = np.arange(used.sum())
    if closed:
        number[:, -1] = number[:, 0]
    i, j = np.nonzero(used)
    points = place(i / (2 * nu), j / (2 * nv))
    a, b = (g.ravel() for g in np.meshgrid(2 * np.arange(nu), 2 * np.arange(nv), indexing="ij"))
    steps = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
    return points, np.stack([number[a + p, b + q] for p, q in steps], axis=1), number
