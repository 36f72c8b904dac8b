"""Reports of results: one HTML page and one PDF of runs or studies; nothing is computed for them but their form."""
