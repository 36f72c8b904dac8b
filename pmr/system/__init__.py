"""Systems of bodies and the contacts between them, on which simulators work."""
