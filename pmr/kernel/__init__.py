"""The compiled step of reduced bodies and their contacts (docs/kernel.md)."""
