"""The scenario: everything that defines one experiment, as frozen, validated data.

Names are words; each field's metadata gives its symbol, unit and range (see `flexlab.quantities`). `parse_scenario` turns
plain data into a `Scenario` or raises `ScenarioError` with one sentence per problem; `Scenario.replace` changes fields by
path (`"payload.bending_stiffness"`). Presets and files are in `flexlab.presets`.
"""

from flexlab.scenario.arms import Arm
from flexlab.scenario.payload import Payload
from flexlab.scenario.scenario import Scenario, parse_scenario

__all__ = ["Arm", "Payload", "Scenario", "parse_scenario"]
