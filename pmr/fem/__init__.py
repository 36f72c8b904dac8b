"""FEniCSx and PETSc: differences between their versions, objects distributed over ranks, factorisations."""
