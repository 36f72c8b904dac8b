"""Full models of bodies: matrices, loads, outputs and pads that are made from a structure, and their eigensolvers."""
