"""A PD law from which PythonFMU makes a unit (https://github.com/NTNU-IHB/PythonFMU)."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

AXES, SIDES = ("x", "y", "theta"), ("left", "right")
SEEN = [f"{name}_{axis}" for name in ("pose", "pose_rate", "desired_pose", "desired_rate") for axis in AXES]
SEEN += [f"weight_{side}_{axis}" for side in SIDES for axis in AXES]
ANSWERED = [f"input_{side}_{axis}" for side in SIDES for axis in AXES]


class PdOfAnotherTool(Fmi2Slave):
    """PD with weight compensation."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.gain, self.effort = 20000.0, 0.0
        tuned = Fmi2Causality.parameter, Fmi2Variability.tunable
        self.register_variable(Real("gain", causality=tuned[0], variability=tuned[1], start=self.gain))
        self.register_variable(Real("effort", causality=Fmi2Causality.output))
        for name in SEEN:
            setattr(self, name, 0.0)
            self.register_variable(Real(name, causality=Fmi2Causality.input, start=0.0))
        for name in ANSWERED:
            setattr(self, name, 0.0)
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def exit_initialization_mode(self):
        self.do_step(0.0, 0.0)

    def do_step(self, current_time, step_size):
        for axis in AXES:
            e = getattr(self, f"pose_{axis}") - getattr(self, f"desired_pose_{axis}")
            e_dot = getattr(self, f"pose_rate_{axis}") - getattr(self, f"desired_rate_{axis}")
            self.effort = 0.5 * (-self.gain * e - 800.0 * e_dot)
            for side in SIDES:
                setattr(self, f"input_{side}_{axis}", getattr(self, f"weight_{side}_{axis}") + self.effort)
        return True
