"""Every experiment of Weyrer, Gerstmayr, Mikkola and Orzechowski, each figure and table of it in one report."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import combinations
import convergence
import error_map
import histories
import speed
from experiment import Settings, report, run

from pmr.report.blocks import Chapter

TITLE = "Model order reduction of a sliding beam using a global basis: every experiment"
EXPERIMENTS: dict[str, ModuleType] = {
    "histories": histories,
    "convergence": convergence,
    "combinations": combinations,
    "error_map": error_map,
    "speed": speed,
}
#: Settings of each experiment that differ from its own.
SETTINGS: dict[str, Settings] = {name: {} for name in EXPERIMENTS}


def main(settings: Settings, out: Path, jobs: int) -> list[Chapter]:
    """Run all experiments, each into a folder of `out`, and return their chapters."""

    def chapter_of(name: str, module: ModuleType) -> Chapter:
        """Run one experiment, write its own report, and return its chapter."""
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        own: Chapter = module.main(module.SETTINGS | settings[name], folder, jobs)
        report(folder, [own])
        return own

    return [chapter_of(name, module) for name, module in EXPERIMENTS.items()]


if __name__ == "__main__":
    run(main, SETTINGS, __doc__, TITLE)
