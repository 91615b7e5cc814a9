"""Control laws in plain Python: what a user's file declares, and the code that runs it.

    from flexlab import OwnLaw, gain, memory

    class SoftPD(OwnLaw):
        "Task-space PD with weight compensation."
        position_gain = gain(20000.0, "N/m, N·m/rad", low=0, high=1e6)
        velocity_gain = gain(800.0, "N·s/m, N·m·s/rad", low=0, high=1e5)

        def act(self, at):
            e, e_dot = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
            return at.weights + at.shared(-self.position_gain * e - self.velocity_gain * e_dot)

`class_text` gives the text of a class, `declaration` reads what a file declares without running it, `measurement` is what the
law sees, `execution` runs it, `child` does so in a process of its own.
"""
