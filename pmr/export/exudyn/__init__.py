"""A reduced model as a standalone Python script for Exudyn."""
