"""A control law in plain Python for tests in several folders."""

from flexlab.control.law import forget_law, laws
from flexlab.own import hosts
from flexlab.own.law import PythonLaw

PD = '''"""A law of one's own."""

from flexlab import OwnLaw, gain, memory, readout


class OwnPD(OwnLaw):
    """PD with weight compensation, which adds up its error.

    The rest of this text is not shown.
    """

    position_gain = gain((2e4, 2e4, 2e4), "N/m, N·m/rad", low=0, high=1e6, symbol="P")
    velocity_gain = gain(800.0, "N·s/m, N·m·s/rad", low=0, high=1e5, symbol="D")
    error_sum = memory(3)
    calls = memory(1, start=5)
    push = readout("N", "common force along x")

    def act(self, at):
        e, e_dot = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
        self.error_sum += e
        self.calls += 1
        common = -self.position_gain * e - self.velocity_gain * e_dot
        self.push = common[0]
        return at.weights + at.shared(common)
'''


def at_work(body: str) -> str:
    """Return the PD law with more statements at the start of `act`."""
    lines = "".join(f"        {line}\n" for line in body.strip("\n").split("\n"))
    return "import os, sys, json\n" + PD.replace("        e, e_dot", f"{lines}        e, e_dot", 1)


def forget_own_laws() -> None:
    """Forget all laws in Python, and run further ones in this process."""
    hosts.run_apart(False)
    for kind in [kind for kind, law in laws().items() if isinstance(law, PythonLaw)]:
        forget_law(kind)


def allow_no_own_laws() -> None:
    """Forget all laws in Python and that any text may run, as in a new process."""
    hosts.close_all()
    hosts._allowed.clear()
    forget_own_laws()
