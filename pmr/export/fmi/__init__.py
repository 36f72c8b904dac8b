"""A reduced model as a functional mock-up unit (FMI 2.0 and 3.0): the compiled kernel, and a file with the system."""
