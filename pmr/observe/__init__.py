"""Virtual sensing: what a boom carries and suffers, estimated from few sensors by reduced models, with bands."""
