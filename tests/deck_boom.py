"""A box boom as a deck of Abaqus: half a tube in a file of its own, of which two instances are tied to each other."""

from pathlib import Path

WIDTH, HEIGHT, LENGTH, WALL = 0.3, 0.4, 3.0, 0.008
#: Cells across the bottom, up a side and along half of the boom.
ACROSS, UP, ALONG = 2, 3, 6


def write_boom(folder: Path) -> Path:
    """Write the deck and the file that it includes; the part stands upright, and its instances are laid along x."""
    y = [WIDTH * (k / ACROSS - 0.5) for k in range(ACROSS)]
    z = [HEIGHT * (k / UP - 0.5) for k in range(UP)]
    ring = [*((a, -HEIGHT / 2) for a in y), *((WIDTH / 2, b) for b in z)]
    ring += [(-a, -b) for a, b in ring]
    m, last = len(ring), ALONG - 1

    def node(i: int, j: int) -> int:
        return 1 + i * m + j % m

    part = ["*PART, NAME=half", "*NODE"]
    for i in range(ALONG + 1):
        part += [f"{node(i, j)}, {-b!r}, {a!r}, {LENGTH / 2 * i / ALONG!r}" for j, (a, b) in enumerate(ring)]
    part += ["*ELEMENT, TYPE=S4, ELSET=walls"]
    for i in range(ALONG):
        part += [
            f"{node(i, j)}, {node(i, j)}, {node(i + 1, j)}, {node(i + 1, j + 1)}, {node(i, j + 1)}" for j in range(m)
        ]
    first = 0
    for name, count in (("bottom", ACROSS), ("left", UP), ("top", ACROSS), ("right", UP)):
        part += [f"*ELSET, ELSET={name}, GENERATE"]
        part += [f"{node(0, j)}, {node(last, j)}, {m}" for j in range(first, first + count)]
        first += count
    part += ["*ELSET, ELSET=lower, GENERATE", f"1, {m}"]
    part += ["*ELSET, ELSET=upper, GENERATE", f"{node(last, 0)}, {node(last, m - 1)}"]
    part += [
        "*SURFACE, NAME=begin", "lower, E4", "*SURFACE, NAME=end", "upper, E2", "*NSET, NSET=_own", "1", "*END PART",
    ]  # fmt: skip
    (folder / "half.inc").write_text("\n".join(part) + "\n")
    deck = ["*HEADING", "Boom", "*INCLUDE, INPUT=half.inc", "*ASSEMBLY, NAME=boom"]
    for name, at in (("rear", 0.0), ("front", LENGTH / 2)):
        deck += [
            f"*INSTANCE, NAME={name}, PART=half", f"0., 0., {at!r}", "0., 0., 0., 0., 1., 0., 90.", "*END INSTANCE",
        ]  # fmt: skip
    deck += ["*NSET, NSET=tail, INSTANCE=rear, GENERATE", f"1, {m}"]
    deck += ["*NSET, NSET=tip, INSTANCE=front, GENERATE", f"{node(ALONG, 0)}, {node(ALONG, m - 1)}"]
    deck += ["*TIE, NAME=joint", "front.begin, rear.end", "*END ASSEMBLY"]
    deck += ["*BOUNDARY", "tail, 1, 1", "*STEP", "*FREQUENCY", "4", "*END STEP"]
    (folder / "boom.inp").write_text("\n".join(deck) + "\n")
    return folder / "boom.inp"
