"""Parameters of generalized-alpha, for integrators of the tests' own."""

from dataclasses import dataclass


@dataclass(frozen=True)
class GeneralizedAlpha:
    """Parameters of generalized-alpha (Chung and Hulbert, Journal of Applied Mechanics 60, 1993, eq. 25)."""

    step: float  # s
    rho_inf: float

    @property
    def alpha_m(self) -> float:
        """Share of the old acceleration in the mean of accelerations."""
        return (2.0 * self.rho_inf - 1.0) / (self.rho_inf + 1.0)

    @property
    def alpha_f(self) -> float:
        """Share of the old forces in the mean of forces."""
        return self.rho_inf / (self.rho_inf + 1.0)

    @property
    def gamma(self) -> float:
        """Newmark's parameter of rates."""
        return 0.5 + self.alpha_f - self.alpha_m

    @property
    def beta(self) -> float:
        """Newmark's parameter of coordinates."""
        return (self.gamma + 0.5) ** 2 / 4.0

    @property
    def gains(self) -> tuple[float, float]:
        """Factors by which a new acceleration enters the coordinates (s^2) and the rates (s) of a step."""
        gain = (1.0 - self.alpha_f) / (1.0 - self.alpha_m)
        return self.beta * self.step**2 * gain, self.gamma * self.step * gain
