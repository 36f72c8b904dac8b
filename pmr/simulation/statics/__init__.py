"""Systems at rest: equilibrium, response to a load that grows, buckling; and swings after stopping or hoisting."""
