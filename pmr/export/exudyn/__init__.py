"""A reduced system as a standalone Python script for Exudyn."""
