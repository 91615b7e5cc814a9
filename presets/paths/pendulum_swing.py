"""A swing that dies out: a damped oscillation that begins and ends at rest."""

from math import cos, exp, pi

from flexlab import OwnPath, option


class PendulumSwing(OwnPath):
    """The beam's middle swings from side to side as a pendulum does, less far each time, and stands still at the end."""

    swing = option(0.15, "m", low=0, high=0.5, title="First swing")
    swing_time = option(1.0, "s", low=0.2, high=10, title="Time of a swing", slider=(0.4, 3))
    decay = option(0.6, "1/s", low=0, high=5)
    duration = option(5.0, "s", low=0.5, high=60)

    def position(self, t):
        # Quintic, so that velocity and acceleration are zero at either end.
        begun = min(t / self.swing_time, 1.0)
        left = min((self.duration - t) / self.swing_time, 1.0)
        window = begun**3 * (10 - 15 * begun + 6 * begun**2) * left**3 * (10 - 15 * left + 6 * left**2)
        x = self.swing * exp(-self.decay * t) * cos(2 * pi * t / self.swing_time) * window
        return x, 0.75 - 0.5 * x * x, 0.3 * x
