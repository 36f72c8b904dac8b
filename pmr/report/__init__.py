"""Reports of results: one HTML page and one PDF for runs or for studies; they show results and compute no new ones."""
