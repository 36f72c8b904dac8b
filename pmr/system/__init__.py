"""Reduced models of bodies, and systems of bodies and the contacts between them, on which simulators work."""
