"""Virtual sensing: payload, loads and forces of a boom, estimated from few sensors by reduced models."""
