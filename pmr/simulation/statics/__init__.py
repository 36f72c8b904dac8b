"""Systems at rest: equilibrium, what a load that grows does, buckling, stops and lifting off."""
