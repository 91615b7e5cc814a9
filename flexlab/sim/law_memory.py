"""What a control law remembers: where it begins, and what passes from one law to the next."""

import numpy as np

from flexlab.control.law import Start, laws
from flexlab.physics.plant import Workspace
from flexlab.scenario import Scenario
from flexlab.sim.closed_loop import System, memory_slice


def memory_parts(scenario: Scenario, system: System, y: np.ndarray) -> dict[str, np.ndarray]:
    """Views of the named parts of the memory in y."""
    memory = y[memory_slice(system)]
    slices = laws()[scenario.controller.kind].memory_slices(len(scenario.arms))
    return {name: memory[part] for name, part in slices.items()}


def start_memory(scenario: Scenario, system: System, y: np.ndarray, ws: Workspace) -> None:
    """Give the memory in y the values with which the law begins at this state, where they are not zero."""
    law = laws()[scenario.controller.kind]
    if law.start is None:
        return
    parts = memory_parts(scenario, system, y)
    gains = system.control.gains.view(law.gains_type).view(np.recarray)[0]
    for name, values in law.start(Start(ws.truth[0], gains)).items():
        parts[name][:] = values


def carry_memory(
    old: Scenario, old_system: System, old_y: np.ndarray, new: Scenario, system: System, y: np.ndarray
) -> None:
    """Copy the parts of the memory that both laws have by name and length; the others stay zero."""
    before = memory_parts(old, old_system, old_y)
    for name, part in memory_parts(new, system, y).items():
        if name in before and len(before[name]) == len(part):
            part[:] = before[name]
