"""The scenario: everything that defines one experiment, as frozen, validated data.

Names are words; each field's metadata gives its symbol, unit and range (see `flexlab.quantities`). `parse_scenario` turns
plain data into a `Scenario` or raises `ScenarioError` with one sentence per problem; `Scenario.replace` changes fields by
path (`"payload.bending_stiffness"`). Presets and files are in `flexlab.presets`.
"""

from flexlab.control.controller import Controller, PayloadModel, SensorNoise
from flexlab.control.laws.adaptive_sliding_mode import AdaptiveSlidingMode
from flexlab.control.laws.computed_torque import ComputedTorque
from flexlab.control.laws.no_control import NoControl
from flexlab.control.laws.proportional_derivative import ProportionalDerivative
from flexlab.control.laws.vibration_damping import VibrationDamping
from flexlab.control.paths.sine import SineTrajectory
from flexlab.scenario.arms import Arm
from flexlab.scenario.payload import FIXED_COORDINATES, Boundary, ModalDamping, NodalDamping, Payload, StiffnessDamping
from flexlab.scenario.scenario import Initial, Scenario, Simulation, parse_scenario

__all__ = [
    "FIXED_COORDINATES",
    "AdaptiveSlidingMode",
    "Arm",
    "Boundary",
    "ComputedTorque",
    "Controller",
    "Initial",
    "ModalDamping",
    "NoControl",
    "NodalDamping",
    "Payload",
    "PayloadModel",
    "ProportionalDerivative",
    "Scenario",
    "SensorNoise",
    "Simulation",
    "SineTrajectory",
    "StiffnessDamping",
    "VibrationDamping",
    "parse_scenario",
]
