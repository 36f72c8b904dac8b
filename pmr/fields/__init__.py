"""Fields over a body's points and cells, and stresses as rows on a model's coordinates; FEniCSx is not needed."""
