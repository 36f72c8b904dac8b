"""Export of models and results to files that other programs read; each format has a module or folder of its own."""
