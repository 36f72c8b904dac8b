"""Chapters of the benchmarks' page: a function for each section, which takes its results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from benchmarks import figures
from benchmarks.page_of_scale import scale, shares
from benchmarks.waited_for import allowed
from pmr.report.blocks import Block, Chapter, Grid, KeyNumber
from pmr.report.figures import drawing
from pmr.report.numbers import SPACE, format_input, format_percent, format_quantity, significant

WAYS = {
    "callbacks": "Exudyn, callbacks (the paper's way)",
    "callbacks, Jacobian kept": "the same, Jacobian kept (modified Newton)",
    "updates": "Exudyn, updates once a step",
    "march": "march, all modes kept",
    "march, outputs only": "march, 51 outputs kept",
}
STAGES = {"assemble": "assembly", "snapshots": "snapshots", "pod": "POD", "project": "projection"}


def approaches(found: Mapping[str, Any], prefix: str) -> Chapter:
    """Build the chapter about both cases of the paper by each simulator, and about six coordinates."""
    numbers, grids = [], []
    for name, case in found["cases"].items():
        ratio = case["reduced"]["ratio"]["callbacks"]["of_median"]
        label = f"march against the paper's way, {case['coordinates']['reduced']} coordinates, {name} case"
        numbers.append(KeyNumber(_times(ratio), label))
        for size in ("reduced", "full"):
            grids.append(_ways(name, size, case))
    small = found["small"]
    rows = tuple(
        (
            name,
            format_quantity(t["min"], "s"),
            format_quantity(t["median"], "s"),
            format_quantity(t["min"] / small["steps"], "s"),
        )
        for name, t in small["seconds"].items()
    )
    caption = (
        f"Six coordinates, evolved case: {format_input(small['span'], 's')} in {format_input(small['steps'])} "
        "steps, every step's outputs kept."
    )
    grids.append(Grid(caption, ("basis and outputs", "least", "median", "a step"), rows))
    grids.append(_in_exudyn(found["in_exudyn"]))
    return Chapter(
        anchor=prefix,
        title="",
        headline=f"{numbers[-1].value} faster than the paper's way with 20 coordinates, on the same trajectory.",
        key_numbers=numbers,
        paragraphs=[
            "Callbacks are the paper's way: dense matrices, and Python called for rows, their Jacobian and loads in "
            "every iteration; rows and loads are looked up there, not evaluated, which favours it. Whether a "
            "Jacobian is kept the paper does not say, so both were measured. Updates set rows and loads "
            "once a step; the full beam is sparse then. Times are those of the solver, difference is the largest one "
            "of the transverse displacement over all nodes and steps to march, all modes kept. In march, the time is "
            "that of all steps; the change of coordinates before and after, once a simulation, is not in it."
        ],
        blocks=[Block("Solver time and agreement", grids=tuple(grids))],
    )


def _in_exudyn(found: Mapping[str, Any]) -> Grid:
    """Build the table of the evolved case in Exudyn."""
    rows = [
        (
            WAYS.get(way, way),
            str(found["coordinates"][way]),
            format_quantity(t["min"], "s"),
            format_quantity(t["median"], "s"),
            _times(found["ratio"][way]["of_median"]) if way in found["ratio"] else "–",
            format_percent(found["error"][way]),
        )
        for way, t in found["seconds"].items()
    ]
    heads = ("way", "coordinates", "least", "median", "over residual flexibility", "error along the beam")
    return Grid("Evolved case in Exudyn: fewer coordinates, and no constraint to solve for.", heads, tuple(rows))


def _ways(name: str, size: str, case: Mapping[str, Any]) -> Grid:
    """Build the table of one case and one model (`size`) by each simulator."""
    found = case[size]
    base, shares = found["seconds"]["march"], found["share_of_span"]
    rows = []
    for way, times in found["seconds"].items():
        difference = found["difference"].get(way)
        rows.append(
            (
                WAYS[way],
                format_quantity(times["min"], "s"),
                format_quantity(times["median"], "s"),
                _times(times["median"] / base["median"]),
                "–" if difference is None else format_quantity(difference, "m", 2),
            )
        )
    part = min(shares.values())
    note = f" Callbacks: eight stretches that make up {format_percent(part)} of the time span, extrapolated." * (
        part < 1.0
    )
    repeats = max(times["repeats"] for times in found["seconds"].values())
    caption = f"{name.capitalize()} case, {case['coordinates'][size]} coordinates, {repeats} repeats.{note}"
    return Grid(caption, ("way", "least", "median", "over march", "difference"), tuple(rows))


def latency(found: Mapping[str, Any], prefix: str) -> Chapter:
    """Build the chapter about the time of one step from Python."""
    rows = tuple(
        (name, *(format_quantity(1e-9 * times[q], "s") for q in ("median", "p99", "p99.9", "worst")))
        for name, times in found["ns"].items()
    )
    caption = f"Called from Python, {format_input(found['calls'])} steps, the clock's own time taken off."
    columns = ("model and outputs", "median", "99 %", "99.9 %", "worst")
    first = found["ns"]["r = 20, tip"]
    return Chapter(
        anchor=prefix,
        title="",
        headline=f"{format_quantity(1e-9 * first['median'], 's', 2)} a step with 20 coordinates.",
        key_numbers=[
            KeyNumber(format_quantity(1e-9 * first["median"], "s"), "one step, 20 coordinates, median"),
            KeyNumber(format_quantity(1e-9 * first["p99"], "s"), "99 of 100 steps take less"),
            KeyNumber(_times(1e6 / first["median"]), "faster than the step of 1 ms"),
        ],
        paragraphs=[
            "Each step is timed on its own while the slider moves all the time, so that rows are evaluated in every "
            "step. The worst is the operating system's doing: another process had the core. Real-time kernels and "
            "isolated cores are the remedy; the step itself allocates nothing and makes no system call."
        ],
        blocks=[Block("Latency", grids=(Grid(caption, columns, rows),))],
    )


def fmu(found: Mapping[str, Any], prefix: str) -> Chapter:
    """Build the chapter about the time of one communication step of FMUs."""
    rows = tuple(
        (name, format_quantity(t["min"], "s"), format_quantity(t["median"], "s"))
        for name, t in found["seconds"].items()
    )
    caption = (
        f"Seconds of the processor, {format_input(found['steps'])} internal steps in a row: all inputs set, one "
        "step done, all displacements read."
    )
    name, first = next(iter(found["seconds"].items()))
    return Chapter(
        anchor=prefix,
        title="",
        headline=f"{format_quantity(first['median'], 's', 2)} an internal step of the {name}.",
        blocks=[Block("FMI 2.0, called from C", grids=(Grid(caption, ("model", "least", "median"), rows),))],
    )


def growth(found: Mapping[str, Any], prefix: str) -> Chapter:
    """Build the chapter about the time of a step over the size of a model."""
    modes, full = found["modes"], found["full"]
    caption = (
        "Time of a step while the slider moves. Left: the full beam's modes, the lowest r of them; right: full beams "
        "of more and more elements. Lines: fitted to the larger sizes."
    )
    rows = tuple(
        (f"{size} {what}", f"{format_quantity(1e-9 * ns, 's')}", f"{format_quantity(1e-9 * ns / size, 's')}")
        for what, key in (("modes", "modes"), ("coordinates (full beam)", "full"))
        for size, ns in zip(found[key]["size"], found[key]["ns"], strict=True)
    )
    others = tuple(
        (f"{size} {what}", format_quantity(1e-9 * ns, "s"), format_quantity(1e-9 * (ns - found[key]["ns"][0]), "s"))
        for what, key in ((f"rows, {found['rows']['coordinates']} modes", "rows"),
                          (f"outputs, {found['outputs']['coordinates']} modes", "outputs"))
        for size, ns in zip(found[key]["size"], found[key]["ns"], strict=True)
    )  # fmt: skip
    booms, (joint, beside) = found["booms"], (1e6 * part for part in found["booms"]["fitted"])
    counts = zip(*(booms[key] for key in ("sections", "contacts", "coordinates")), strict=True)
    times = zip(*booms["seconds"].values(), strict=True)
    sections = tuple(
        (*map(str, sizes), *(format_quantity(one, "s") for one in taken))
        for sizes, taken in zip(counts, times, strict=True)
    )
    powers = ", ".join(f"{significant(power, 2)} ({name})" for name, power in booms["exponents"].items())
    said = (
        "Processor time of booms of n sections on pads that hold both ways: a step, the error estimate of "
        f"{booms['steps']} steps, frequencies at a place. Powers of the number of joints: {powers}. "
        f"A step takes {joint:.2g} (n - 1) + {beside:.2g} (n - 2) microseconds, for joints and for sections between, "
        f"at most {100 * booms['off']:.0f} % off."
    )
    return Chapter(
        anchor=prefix,
        title="",
        headline=f"A step costs r to the power of {significant(modes['exponent'], 2)} and n to that of "
        f"{significant(full['exponent'], 2)}.",
        key_numbers=[
            KeyNumber(significant(modes["exponent"], 2), "exponent in the modes r, from 32 on"),
            KeyNumber(significant(full["exponent"], 2), "exponent in the full beam's coordinates, from 100 on"),
        ],
        blocks=[
            Block(
                "Cost against size",
                drawings=(drawing(f"{prefix}-size", figures.growth, caption, found),),
                grids=(
                    Grid("A step, and its share of each mode.", ("size", "a step", "each"), rows),
                    Grid("Moving rows and outputs.", ("size", "a step", "more than the first"), others),
                    Grid(said, ("sections", "contacts", "coordinates", *booms["seconds"]), sections),
                ),
            )
        ],
    )


def peer(found: list[Mapping[str, Any]], prefix: str) -> Chapter:
    """Build the chapter about POD and projection beside pyMOR."""
    known = [one for one in found if one["installed"]]
    if not known:
        return Chapter(anchor=prefix, title="", headline="pyMOR is not installed, so nothing was compared.")
    blocks = []
    for one in known:
        rows = tuple(
            (
                f"{'POD' if step == 'pod' else 'projection'}: {way}",
                format_quantity(t["min"], "s"),
                format_quantity(t["median"], "s"),
            )
            for step, ways in one["seconds"].items()
            for way, t in ways.items()
        )
        agreement = tuple(
            (
                {"qr_svd": "QR and SVD", "method_of_snapshots": "method of snapshots"}[method],
                format_input(a["modes"]),
                significant(a["sigma"], 2),
                significant(a["sigma_last"], 2),
                significant(a["angle"], 2),
            )
            for method, a in one["agreement"].items()
        )
        times = Grid("Seconds.", ("step and way", "least", "median"), rows)
        apart = Grid(
            "pyMOR's singular values and basis beside pmr's (TSQR): differences over the largest value, relative one "
            f"of value {one['coordinates']}, largest angle between the spaces in rad. Projected matrices in the same "
            f"basis differ by {significant(one['matrices']['M'], 2)} (M) and {significant(one['matrices']['K'], 2)} "
            "(K) of the largest entry.",
            ("pyMOR's method", "modes", "σ / σ(1)", "last σ", "angle"),
            agreement,
        )
        heading = f"{one['snapshots']} snapshots of {format_input(one['size'])} coordinates"
        blocks.append(Block(heading, grids=(times, apart)))
    return Chapter(
        anchor=prefix,
        title="",
        headline="The same basis and matrices as pyMOR's QR; its default, the method of snapshots, loses the tail.",
        paragraphs=[
            "The pool is the evolved case's, truncated to 20 vectors. pmr's projection gives all of a reduced model: "
            "M, D, K, inputs, outputs and the moving rows as exact cubics; pyMOR's that of M and K."
        ],
        blocks=blocks,
    )


def waited_for(found: Mapping[str, Mapping[str, Any]], prefix: str) -> Chapter:
    """Build the chapter about what users wait for, with the gain over an earlier checkout if that was measured."""

    def cells(one: Mapping[str, Any]) -> tuple[str, ...]:
        """Cells of a row's values."""
        before = one["earlier"]
        figures = [_in_unit(one[key], one["unit"]) for key in ("before", "asked", "here")]
        quicker = [_in_unit(before, one["unit"]), _times(before / one["here"])] if before else ["–", "–"]
        return (*figures, format_quantity(one["wall"], "s"), format_quantity(one["processor"], "s"), *quicker)

    held = {name: one["here"] <= allowed(one) for name, one in found.items()}
    rows = tuple(
        (name, *cells(one), "holds" if held[name] else one["limit"] or "missed") for name, one in found.items()
    )
    heads = ("", "first", "asked", "here", "wall time", "processor", "earlier checkout here", "times as quick", "")
    return Chapter(
        anchor=prefix,
        title="",
        headline=f"{sum(held.values())} of {len(found)} take no more than is asked.",
        blocks=[
            Block(
                "Commands and more",
                text="First: what was measured before anything was done about it. Where an earlier checkout ran in "
                "turn here, this one is to be as many times as quick. With nothing compiled: neither modules of "
                "Python nor a platform's C library.",
                grids=(Grid("Commands with what they start; the least of up to three times.", heads, rows),),
            )
        ],
    )


def _in_unit(value: float, unit: str) -> str:
    """Format a value with its unit."""
    return format_quantity(value, unit) if unit else _times(value)


def chart(found: Mapping[str, Mapping[str, float]], prefix: str) -> Chapter:
    """Build the chapter about the wall time of a load chart, report included."""
    columns = ("wall", "processor", "asked")
    rows = tuple((name, *(format_quantity(one[column], "s") for column in columns)) for name, one in found.items())
    cores = min(one["cores"] for one in found.values())
    text = (
        "A crane of three sections as beams in space at 40 extensions and 20 angles, with ten limits and error bars. "
        "With the reduction cached: after a limit was changed, every load is computed again."
    )
    grid = Grid(f"On {cores:.0f} cores, two workers; the wall time is asked for.", ("load chart", *columns), rows)
    worst = max(one["wall"] / one["asked"] for one in found.values())
    headline = f"{100.0 * worst:.0f}{SPACE}% of the time that is asked for, at most."
    return Chapter(anchor=prefix, title="", headline=headline, blocks=[Block("Load chart", text=text, grids=(grid,))])


def offline(found: Mapping[str, Any], prefix: str) -> Chapter:
    """Build the chapter about everything before a simulation."""
    caption = "Seconds of each stage against the full model's coordinates; filled: one rank, open: two."
    rows = []
    for record in found["records"]:
        seconds = (format_quantity(record["seconds"][s], "s") if s in record["seconds"] else "–" for s in STAGES)
        error = record.get("first_frequency_error")
        memory = record.get("peak_MB_a_rank")
        rows.append(
            (
                f"{format_input(record['size'])} on {record['ranks']}",
                *seconds,
                "–" if memory is None else f"{format_input(round(memory))}{SPACE}MB",
                "–" if error is None else significant(error, 2),
            )
        )
    fitted = tuple(
        (f"{ranks} rank{'s' if ranks != '1' else ''}", *(significant(e[s], 2) if s in e else "–" for s in STAGES))
        for ranks, e in found["exponents"].items()
    )
    notes = sorted(
        {note for record in found["records"] for note in record["notes"] if note.startswith(("snap", "fail"))}
    )
    return Chapter(
        anchor=prefix,
        title="",
        headline="From a hundred coordinates on, and where double precision ends.",
        paragraphs=[
            "Five positions with six eigenmodes each (SLEPc, shift and invert with MUMPS), POD by TSQR, 20 "
            "coordinates. Round-off in the stiffness matrix grows with the fourth power of the number of elements: the "
            "last column is the largest relative error of the first frequency against the closed form. From some 1,500 "
            "elements on pmr warns; beyond 10,000 the beam's frequencies mean nothing any more, and the larger sizes "
            "say how long the algorithms take, not that such a mesh should be used. Two ranks on two cores share "
            "their memory bandwidth.",
            *notes,
        ],
        blocks=[
            Block(
                "Offline",
                drawings=(drawing(f"{prefix}-stages", figures.offline, caption, found),),
                grids=(
                    Grid(
                        "Coordinates and ranks; seconds of the slowest rank; peak memory of a rank.",
                        ("run", *STAGES.values(), "memory", "frequency error"),
                        tuple(rows),
                    ),
                    Grid("Exponents over the coordinates, fitted from 1,000 on.", ("on", *STAGES.values()), fitted),
                ),
            )
        ],
    )


def _times(ratio: float) -> str:
    """Format a ratio."""
    return f"{significant(ratio, 3)}{SPACE}×"


#: Title and content of each section, in the order of the page.
PAGES: Mapping[str, tuple[str, Callable[[Any, str], Chapter]]] = {
    "approaches": ("The paper's cases in every way", approaches),
    "latency": ("One step", latency),
    "fmu": ("An FMU's step", fmu),
    "growth": ("Cost against size", growth),
    "waited for": ("What is waited for", waited_for),
    "chart": ("A load chart", chart),
    "peer": ("POD and projection beside pyMOR", peer),
    "offline": ("Before the simulation", offline),
    "scale": ("A shell before the simulation", scale),
    "messages": ("What several ranks solve, send and hold", shares),
}
