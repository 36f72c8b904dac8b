"""Systems at rest: equilibrium, response to a load that grows, buckling, stopping and hoisting."""
