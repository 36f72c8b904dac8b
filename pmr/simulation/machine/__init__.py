r"""A machine that moves by itself below a boom: its motion is found with the boom's, step by step.

With P and L the linear and angular momentum of machine and boom about the ground's origin, along its axes,

.. math::
    P_{n+1} = P_n + h \tilde F, \qquad L_{n+1} = L_n + h \tilde{\mathfrak M}

hold to round-off, so that a machine without springs in space keeps both, while the boom bends and telescopes.  The
machine's velocity is that which these momenta need with what the boom's coordinates have of them
(`pmr.simulation.free_base`); the coordinates follow the kernel's step in the frame that the machine moves.

- `carrying`: what of machine and boom the kernel has, and what drives them,
- `motion`: the start, and the steps that the kernel takes (src/machine.c).

The motion is then that of a frame (`pmr.simulation.frame_motion`), in which everything else goes on.
"""
