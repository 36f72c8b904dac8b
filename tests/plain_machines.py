"""Cranes with rigid walls and pads that hold both ways: quick to reduce and linear, for tests and benchmarks."""

from pathlib import Path

_FOLDER = Path(__file__).parent / "machines"
CRANE, CRANE_SHELL = _FOLDER / "crane.toml", _FOLDER / "crane_shell.toml"
HOIST, OUTRIGGERS = _FOLDER / "hoist.toml", _FOLDER / "crane_outriggers.toml"
