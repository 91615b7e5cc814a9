"""A law in plain Python sees all that built-in laws see: two of them, rewritten in Python, give the same runs."""

from pathlib import Path

import numpy as np
import pytest

import flexlab
from flexlab.control.law import USUAL_GAUGES
from flexlab.own import hosts
from flexlab.own.files import law_kind
from flexlab.own.law import add_own_law
from flexlab.own.measurement import Believed, Measurement
from flexlab.physics.law_input import LAW_INPUT
from flexlab.presets import load_preset
from flexlab.sim.build import build_beam, payload_row

NOISY = {
    "controller.sensor_noise.pose": [1e-5, 1e-5, 1e-5],
    "controller.sensor_noise.pose_rate": [1e-4, 1e-4, 1e-4],
    "controller.sensor_noise.strain": 1e-7,
    "controller.input_delay": 2,
    "controller.model.stiffness_factor": 1.1,
    "controller.wanted_internal_force": 15.0,
}


@pytest.mark.parametrize("changes", [{}, NOISY], ids=["exact", "noisy and late"])
@pytest.mark.parametrize(("kind", "file"), [("lqr", "observed_lqr"), ("composite", "damped_sliding_mode")])
def test_a_built_in_law_rewritten_in_python_gives_the_same_run(kind: str, file: str, changes: dict, root: Path):
    if kind == "composite" and changes:
        changes = changes | {"controller.input_delay": 0, "controller.sensor_noise.strain": 0.0}
    built_in = load_preset("paper").replace({"controller.kind": kind, "controller.control_period": 1e-3, **changes})
    own = load_preset("paper").replace(
        {
            "controller.kind": law_kind(root / "presets" / "laws" / f"{file}.py"),
            "controller.control_period": 1e-3,
            **changes,
        }
    )
    one, other = (flexlab.simulate(scenario, 0.5, check=True) for scenario in (built_in, own))
    np.testing.assert_allclose(other.pose, one.pose, rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.midspan_deflection, one.midspan_deflection, rtol=0, atol=1e-9)
    forces = np.abs(one.joint_torque).max()
    np.testing.assert_allclose(other.joint_torque, one.joint_torque, rtol=0, atol=1e-9 * forces)


SEES = '''import numpy as np
from flexlab import OwnLaw, readout

class Sees(OwnLaw):
    """Holds the pose and shows what it is told."""
    squeeze = readout("N")
    wanted = readout("N")
    gauges = readout("1")
    strain = readout("1")

    def act(self, at):
        self.squeeze, self.wanted = at.internal_force, at.wanted_force
        self.gauges, self.strain = len(at.gauge_places), at.strains[0]
        e, e_dot = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
        return at.weights + at.shared(-2e4 * e - 2e3 * e_dot)
'''


@pytest.mark.parametrize("apart", [False, True], ids=["here", "apart"])
def test_a_law_sees_the_internal_force_the_gauges_and_strains(apart: bool):
    hosts.run_apart(apart)
    changes = {"controller.kind": add_own_law(SEES, "sees.py").kind, "controller.wanted_internal_force": 15.0}
    changes["gravity"] = 9.81  # The beam sags.
    still = load_preset("paper").replace({"trajectory.kind": "hold"}).replace(changes)
    run = flexlab.simulate(still, 1.5, check=True)
    along = np.array([np.cos(run.pose[-1, 2]), np.sin(run.pose[-1, 2]), 0.0])
    felt = 0.5 * (run.internal_force[-1, 0] - run.internal_force[-1, 1]) @ along
    assert felt == pytest.approx(15.0, abs=1e-3)
    assert run["squeeze"][-1] == pytest.approx(felt, abs=1e-3)
    assert run["wanted"][-1] == 15.0
    assert run["gauges"][-1] == len(USUAL_GAUGES)
    place, h = USUAL_GAUGES[0] * still.payload.length, 1e-3
    w = [run.beam_coordinates @ payload_row(still.payload, place + ahead) for ahead in (-h, 0.0, h)]
    strain = -0.5 * still.payload.thickness * (w[0] - 2 * w[1] + w[2]) / h**2
    np.testing.assert_allclose(run["strain"], strain, rtol=0, atol=1e-6 * np.abs(strain).max())
    assert np.abs(strain).max() > 1e-6


def test_the_modes_that_a_law_sees_are_those_of_the_believed_beam():
    law = add_own_law(SEES, "sees.py")
    scenario = load_preset("paper").replace({"controller.kind": law.kind})
    believed = Believed(law.derive(scenario)["plant"].tobytes())
    beam = build_beam(scenario.payload)
    order = np.argsort(beam.modes.omega)[:8]
    omega, V = beam.modes.omega[order], beam.modes.V[:, order]
    np.testing.assert_allclose(believed.omega, omega, rtol=1e-12)
    np.testing.assert_allclose(believed.modes.frequencies, omega / (2 * np.pi), rtol=1e-12)
    shape = payload_row(scenario.payload, float(believed.modes.places[5])) @ V
    np.testing.assert_allclose(np.abs(believed.modes.shapes[5]), np.abs(shape), rtol=1e-9, atol=1e-12)
    stiffer = Believed(law.derive(scenario.replace({"controller.model.stiffness_factor": 4.0}))["plant"].tobytes())
    np.testing.assert_allclose(stiffer.omega, 2 * believed.omega, rtol=1e-12)


def test_joint_angles_that_a_law_sees_lie_within_half_a_turn():
    now = np.zeros(1, LAW_INPUT)[0]
    now["arm_count"], now["x"] = 2, (0.0, 0.0, 3.0)
    now["direction"][:2] = [(np.cos(a), np.sin(a), np.cos(b), np.sin(b)) for a, b in ((3.0, -3.0), (0.5, 1.0))]
    angles = Measurement(now, 0.001, lambda: None).joint_angles  # type: ignore[arg-type]  # No belief is asked for.
    np.testing.assert_allclose(angles, [[3.0, 2 * np.pi - 6.0, 6.0 - 2 * np.pi], [0.5, 0.5, 2.0 - np.pi]], atol=1e-12)


def test_the_net_force_that_a_law_sees_leaves_out_the_payload_s_weight():
    now = np.zeros(1, LAW_INPUT)[0]
    now["arm_count"], now["m"], now["gravity"] = 2, 2.0, 9.81
    at = Measurement(now, 0.001, lambda: None)  # type: ignore[arg-type]  # As above.
    np.testing.assert_allclose(at.net_force(np.ones((2, 3))), [2.0, 2.0 - 19.62, 2.0])
