"""How models, systems and results describe themselves in an interactive session."""

from __future__ import annotations

import pmr


def test_models_and_results_describe_themselves_in_three_lines() -> None:
    """Of arrays a reader sees meaning and number, not thousands of entries."""
    scene = pmr.load_scene("paper_simple", ["time.end=0.01", "compare.against=[]"])
    outcome = pmr.run(scene)
    for described in (outcome.reduced, outcome.system, outcome.result, outcome.result.responses["reduced"]):
        lines = repr(described).splitlines()
        assert len(lines) == 3 and all(len(line) < 160 for line in lines)
        assert lines[0].startswith(type(described).__name__)
