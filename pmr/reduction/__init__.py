"""From a full model and its snapshots to a reduced model: bases, Galerkin projection, residual flexibility."""
