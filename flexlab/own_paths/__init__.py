"""Desired motions in plain Python: what a user's file declares, and the code that runs it.

    import math
    from flexlab import OwnPath, option

    class Heart(OwnPath):
        "The middle draws a heart."
        size = option(0.1, "m", low=0, high=0.3)
        period = option(4.0, "s", low=0.5, high=60)

        def position(self, t):
            phase = 2 * math.pi * t / self.period
            x = self.size * math.sin(phase) ** 3
            y = self.size * (0.8 * math.cos(phase) - 0.3 * math.cos(2 * phase))
            return x, 0.75 + y, 0.0

`declaration` reads what a file declares without running it, `execution` runs it, `child` does so in a process of its own.
"""
