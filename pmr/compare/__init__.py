"""How far simulations are apart, and how far a reduced model is off."""
