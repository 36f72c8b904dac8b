"""Names of the matrices and inputs that a moving frame and axial forces add to a body (docs/moving_frame.md)."""

from __future__ import annotations

#: T_k = int rho v . (e_k x u), antisymmetric: an angular velocity makes 2 omega_k T_k q', its rate alpha_k T_k q.
ROTATING = tuple(f"rotating {k}" for k in "xyz")
#: N_jk = int rho (v_j u_k + v_k u_j) / 2: omega x (omega x u) makes sum_jk omega_j omega_k N_jk - |omega|^2 M.
CARRIED = tuple(f"carried {jk}" for jk in ("xx", "yy", "zz", "xy", "xz", "yz"))
#: Geometric stiffness of the axial force N that, in a body held at its tail, a unit acceleration of the frame makes,
#: a_x = 1 m/s^2 or a_x = x in 1/s^2 (compression: N < 0), and a tension of 1 N at the tip.
AXIAL = ("axial uniform", "axial linear", "axial tip")
#: Inputs M times the constant fields e_j, in m/s^2, and M times the fields x_k e_j ("inertia jk"), in 1/s^2.
CONSTANT = tuple(f"inertia {j}" for j in "xyz")
LINEAR = tuple(f"inertia {j}{k}" for j in "xyz" for k in "xyz")
