"""What simulators work on."""
