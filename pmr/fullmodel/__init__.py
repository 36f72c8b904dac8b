"""From a structure to its full model: operators, loads, outputs, pads, and eigensolvers for it."""
