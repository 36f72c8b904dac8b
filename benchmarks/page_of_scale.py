"""Chapters of the page about `benchmarks.scale` and `benchmarks.messages`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks import figures, messages
from benchmarks.scale import own_memory
from pmr.report.blocks import Block, Chapter, Grid, KeyNumber
from pmr.report.figures import drawing
from pmr.report.numbers import SPACE, format_input, format_quantity, significant

STAGES = {
    "mesh": "mesh",
    "assembly": "assembly",
    "modes": "free modes",
    "projection": "projection",
    "flexibility": "flexibility",
    "total": "total",
}
COMPARED = {
    "frequencies": "frequencies",
    "modes": "modes",
    "rows": "G",
    "inputs": "H",
    "outputs": "X",
}


def scale(found: Mapping[str, Any], prefix: str) -> Chapter:
    """Build the chapter about the reference boom as a shell of more and more coordinates."""
    done = [record for record in found["records"] if record["seconds"]]
    if not done:
        return Chapter(
            anchor=prefix, title="", headline="No size was finished.", paragraphs=_unfinished(found["records"])
        )
    largest = max(done, key=lambda record: (record["size"], -record["ranks"]))
    caption = (
        "Seconds of each stage, and memory above that of a process which has loaded the libraries only, against the "
        "full model's coordinates; filled: one rank, open: two."
    )
    return Chapter(
        anchor=prefix,
        title="",
        headline=f"{_memory(sum(largest['peak_MB']))} and {_took(largest['seconds']['total'])} from the mesh to the "
        f"reduced model for {format_input(largest['size'])} coordinates.",
        key_numbers=[
            KeyNumber(
                _took(largest["seconds"]["total"]), f"{format_input(largest['size'])} coordinates, {_ranks(largest)}"
            ),
            KeyNumber(_memory(sum(largest["peak_MB"])), "peak memory of all its ranks"),
            KeyNumber(_each(largest), "for each coordinate"),
        ],
        paragraphs=[
            "workflows/boom_shell.toml with finer and finer cells: ten coordinates with residual flexibility, its "
            "inertia, 4 enrichment modes, twelve pads. Flexibility is one factorisation of the stiffness and a static "
            "solve for each load and for each of the moving pads' 546 carriers, its inertia a second solve for each. "
            "The answers, the matrices and the factor fill the memory; nothing is dense with the model's size squared. "
            "Of several ranks each holds the factor.",
            "Seconds are wall time of the slowest rank. Processor time is that of all ranks together: less than the "
            "wall time where others use the cores too, and more where ranks wait for one another, which counts as "
            "busy. Load: processes that wanted to run, others' included, before and after each run.",
            *_unfinished(found["records"]),
        ],
        blocks=[
            Block(
                "Time and memory",
                drawings=(drawing(f"{prefix}-stages", figures.scale, caption, found),),
                grids=(_seconds(done), _peaks(done), _exponents(found["exponents"])),
            ),
            *([Block("One rank and two", grids=(_agreement(found["agreement"]),))] if found["agreement"] else []),
        ],
    )


def shares(found: Mapping[str, Any], prefix: str) -> Chapter:
    """Build the chapter about what each of several ranks solves, sends and holds."""
    done = [record for record in found["records"] if record["each"]]
    several = [record for record in done if record["ranks"] > 1]
    if not several:
        return Chapter(
            anchor=prefix, title="", headline="Nothing was counted.", paragraphs=_unfinished(found["records"])
        )
    last = several[-1]
    share = messages.share(last)
    stages = [stage for stage in (*STAGES, "rest") if stage in share]
    by_stage = Grid(
        f"Of the rank with most, {format_input(last['size'])} coordinates on {last['ranks']} ranks.",
        ("stage", "columns solved", "messages", "collective calls", "sent"),
        tuple(
            (
                STAGES.get(stage, stage),
                format_input(share[stage]["columns"]),
                format_input(share[stage]["messages"]),
                format_input(share[stage]["collectives"]),
                _sent(share[stage]["message_bytes"] + share[stage]["collective_bytes"]),
            )
            for stage in stages
        ),
    )
    columns = [f"time on {network}" for network in messages.NETWORKS]
    by_size = Grid(
        "Of the rank with most; memory above what the libraries take, beside the model's.",
        ("coordinates", "columns solved", "messages", "collective calls", "sent", *columns, "memory", "model"),
        tuple(
            (
                f"{format_input(record['size'])} {_on(record)}",
                *(format_input(messages.total(record, kind)) for kind in ("columns", "messages", "collectives")),
                _sent(messages.sent(record)),
                *(
                    _took(messages.seconds(record, *network)) if record["ranks"] > 1 else ""
                    for network in messages.NETWORKS.values()
                ),
                _memory(max(messages.memory(record))),
                _memory(messages.planned_memory(record["size"], record["ranks"])),
            )
            for record in done
        ),
    )
    return Chapter(
        anchor=prefix,
        title="",
        headline=f"A rank of {last['ranks']} sends {_sent(messages.sent(last))} for {format_input(last['size'])} "
        "coordinates.",
        paragraphs=[
            "Messages, bytes and solved columns are counted, and memory is measured; nothing here depends on how many "
            "cores there are or how busy they are. Times are what all of a rank's messages take one after the other, "
            "with an assumed delay of each and an assumed speed of the network: "
            + "; ".join(
                f"{name}: {format_quantity(latency, 's')}, {_sent(int(speed))} a second"
                for name, (latency, speed) in messages.NETWORKS.items()
            )
            + ". A collective call counts as log2 of the ranks messages.",
            *_unfinished(found["records"]),
        ],
        blocks=[Block("A rank's share", grids=(by_stage, by_size))],
    )


def _sent(amount: int) -> str:
    """Format a number of bytes."""
    return format_quantity(float(amount), "B")


def _seconds(done: Sequence[Mapping[str, Any]]) -> Grid:
    """Build the table of each stage's wall time."""
    rows = tuple(
        (
            f"{format_input(record['size'])} {_on(record)}",
            *(_took(record["seconds"][stage]) for stage in STAGES),
            _took(record["processor"]),
            " to ".join(significant(load, 2) for load in record["load"]),
        )
        for record in done
    )
    return Grid("Wall time of each stage.", ("coordinates", *STAGES.values(), "processor", "load"), rows)


def _peaks(done: Sequence[Mapping[str, Any]]) -> Grid:
    """Build the table of peak memory after each stage, by rank, and for each coordinate."""
    rows = tuple(
        (
            f"{format_input(record['size'])} {_on(record)}",
            *(_memory(sum(record["peak_MB_after"][stage])) for stage in STAGES if stage != "total"),
            _memory(max(record["peak_MB"])),
            _memory(sum(record["peak_MB"])),
            _each(record),
        )
        for record in done
    )
    heads = ("coordinates", *(name for stage, name in STAGES.items() if stage != "total"), "a rank", "all", "each")
    caption = (
        "Peak memory: of all ranks up to the end of each stage; of the largest rank; of all; and for each coordinate, "
        "without what the libraries take."
    )
    return Grid(caption, heads, rows)


def _exponents(found: Mapping[str, Mapping[str, float]]) -> Grid:
    """Build the table of exponents over the number of coordinates."""
    heads = {**STAGES, "processor": "processor", "memory": "memory"}
    rows = tuple(
        (f"{ranks} rank{'s' if ranks != '1' else ''}", *(significant(fitted[name], 2) for name in heads))
        for ranks, fitted in found.items()
        if fitted
    )
    return Grid("Exponents over the coordinates, fitted to all sizes.", ("on", *heads.values()), rows)


def _agreement(found: Sequence[Mapping[str, Any]]) -> Grid:
    """Build the table of differences between the models of one rank and of two."""
    rows = tuple((format_input(one["size"]), *(significant(one[name], 2) for name in COMPARED)) for one in found)
    caption = (
        "Largest relative difference between the models of one rank and of two: frequencies; modes; tables of the "
        "rows' flexibility G, of rows and inputs H, of outputs and rows X, over the largest "
        "value of the same row, input or output. H and X, between the pads and places far from them, are what little "
        "remains after the modes are taken away."
    )
    return Grid(caption, ("coordinates", *COMPARED.values()), rows)


def _unfinished(records: Sequence[Mapping[str, Any]]) -> list[str]:
    """Sentences on the runs that did not finish or have notes."""
    return [
        f"Cells of {format_input(1e3 * record['cells'], 'mm')}, {_ranks(record)}: {'; '.join(record['notes'])}."
        for record in records
        if record.get("notes")
    ]


def _on(record: Mapping[str, Any]) -> str:
    """Words for the number of ranks in a row's name."""
    return f"on {record['ranks']}"


def _ranks(record: Mapping[str, Any]) -> str:
    """Words for the number of ranks in a sentence."""
    return "one rank" if record["ranks"] == 1 else f"{record['ranks']} ranks"


def _took(seconds: float) -> str:
    """Format a time given in s, from ten minutes on in min."""
    return format_quantity(seconds, "s") if seconds < 600.0 else f"{significant(seconds / 60.0)}{SPACE}min"


def _memory(megabytes: float) -> str:
    """Format an amount of memory given in MB, in GiB."""
    return f"{significant(megabytes / 1024.0)}{SPACE}GiB"


def _each(record: Mapping[str, Any]) -> str:
    """Format the memory for each coordinate, in kB."""
    return f"{significant(own_memory(record) * 1.024**2 * 1e3 / record['size'], 2)}{SPACE}kB"
