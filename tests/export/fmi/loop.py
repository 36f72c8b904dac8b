"""Crane that a valve raises: a PID controller on angle and tip, and a cylinder whose oil is elastic."""

from dataclasses import dataclass, field

STEP, STEPS = 1e-3, 1000
#: Angle that is asked for, rad, and what is read: deflection of the tip in m and force of the luffing support in N.
WANTED = 0.3
READ = ("fly: tip z", "base: force of luffing cylinder")
#: What the unit calls them.
VARIABLES = ("fly_tip_z", "force_of_base_force_of_luffing_cylinder")
#: 1/s, 1/s^2, 1/m of the controller; rad/N of the oil; rad/s of valve and lines.
GAINS, OIL, LINES = (2.0, 0.5, 0.1), 2e-8, 20.0


@dataclass
class Luffing:
    """Motion of the luffing angle (value, rate, second rate), with the states of controller and oil."""

    angle: list[float]
    wanted: float = WANTED
    turned: float = field(init=False)  # rad, by the oil that has flown
    summed: float = 0.0
    before: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Start with the oil that belongs to the angle."""
        self.turned = self.angle[0]

    def led_on(self, tip: float, force: float) -> list[float]:
        """Take a step, and return the angle and its rates of order one to three within it.

        `tip` in m and `force` in N are those at its start; afterwards `angle` holds the values at its end.
        """
        (tip_before, at_start), (kp, ki, kd) = self.before or (tip, force), GAINS
        x, rate, second = self.angle
        self.summed += ki * (self.wanted - x) * STEP
        flow = kp * (self.wanted - x) + self.summed - kd * (tip - tip_before) / STEP
        self.turned += flow * STEP
        asked = self.turned + OIL * (force - at_start)
        third = (LINES**2 * (asked - x) - 2.0 * LINES * rate - second) / STEP
        self.before = tip, at_start
        self.angle = [
            x + STEP * (rate + STEP / 2.0 * (second + STEP / 3.0 * third)),
            rate + STEP * (second + STEP / 2.0 * third),
            second + STEP * third,
        ]
        return [x, rate, second, third]
