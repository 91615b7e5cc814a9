"""Control laws and paths in plain Python: what a person's file declares, and the code that runs it.

from flexlab import OwnLaw, gain, memory

class SoftPD(OwnLaw):
"Task-space PD with weight compensation."
position_gain = gain(20000.0, "N/m, N·m/rad", low=0, high=1e6)
velocity_gain = gain(800.0, "N·s/m, N·m·s/rad", low=0, high=1e5)

def act(self, at):
e, e_dot = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
return at.weights + at.shared(-self.position_gain * e - self.velocity_gain * e_dot)

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
"""
