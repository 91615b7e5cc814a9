"""A heart: x and y are sums of sines and cosines, so that it repeats smoothly."""

from math import cos, pi, sin

from flexlab import OwnPath, option


class Heart(OwnPath):
    """The beam's middle draws a heart, once in a period, and the beam sways with it."""

    size = option(0.1, "m", low=0, high=0.3)
    sway = option(0.05, "rad", low=0, high=0.5)
    height = option(0.75, "m", low=0.3, high=1.2, title="Height of its middle")
    period = option(4.0, "s", low=0.5, high=60, symbol="T", slider=(1, 10))

    def position(self, t):
        phase = 2 * pi * t / self.period
        x = sin(phase) ** 3
        y = (13 * cos(phase) - 5 * cos(2 * phase) - 2 * cos(3 * phase) - cos(4 * phase)) / 16
        return self.size * x, self.height + self.size * y, self.sway * sin(phase)
