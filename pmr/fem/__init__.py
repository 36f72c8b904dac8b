"""FEniCSx, PETSc and SLEPc: differences between their versions, objects distributed over ranks, factorisations."""
