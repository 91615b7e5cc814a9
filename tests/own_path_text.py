"""A path in plain Python for tests in several folders."""

from flexlab.control.path import forget_path, paths
from flexlab.own import hosts
from flexlab.own import path as own_path
from flexlab.own.files import PATH_FILES

ROUND = '''"""A path of one's own."""

from math import cos, pi, sin

from flexlab import OwnPath, option


class RoundTrip(OwnPath):
    """An ellipse, once in a period.

    The rest of this text is not shown.
    """

    radius = option(0.1, "m", low=0, high=2, symbol="R")
    centre = option((0.0, 0.75, 0.0), "m, m, rad", low=-2, high=2)
    period = option(2.0, "s", low=0.1, high=20)

    def position(self, t):
        turn = 2 * pi * t / self.period
        return self.centre + [self.radius * sin(turn), 0.5 * self.radius * cos(turn), 0.1 * sin(turn)]
'''


def forget_own_paths() -> None:
    """Forget all paths in Python, and run further ones in this process."""
    hosts.close_all()
    hosts.run_apart(False)
    hosts._allowed.clear()
    own_path._made_table.cache_clear()
    PATH_FILES._added.clear()
    for kind in [kind for kind, path in paths().items() if isinstance(path, own_path.PythonPath)]:
        forget_path(kind)
