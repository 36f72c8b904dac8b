"""From a structure to its full model: operators, loads, outputs, pads, and what solves eigenproblems on it."""
