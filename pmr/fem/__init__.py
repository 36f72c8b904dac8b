"""FEniCSx, PETSc and SLEPc: which versions these are, what is spread over ranks, factorisations."""
