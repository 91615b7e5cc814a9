"""The detailed fields in a real browser: folders, switches, allowed ranges and buttons that restore a value."""

import pytest
from lab_page import LabPage, wait_until

from flexlab.lab.panel.sections import CHOSEN, GROUPS, SWITCHES, present
from flexlab.presets import load_preset, preset_names
from flexlab.quantities import Part
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import ENGINE
from flexlab.sim.world import World


def shown_in_sections(path: str) -> bool:
    """Whether a field has a place among the sliders or menus of the upper folders."""
    name = path.rsplit(".", 1)[-1]
    return Scenario().about(path).slider is not None or name == "shaper" or path in CHOSEN


def leaves(part: Part, path: str = "") -> list[str]:
    found = []
    for name in type(part).model_fields:
        inner, value = f"{path}.{name}" if path else name, getattr(part, name)
        if name in ("kind", "title", "watch") or inner == ENGINE:
            continue
        found += leaves(value, inner) if isinstance(value, Part) else [inner]
    return found


def test_every_field_of_a_scenario_can_be_reached_in_the_panel() -> None:
    scenario = Scenario()
    offered = {path for group in GROUPS for path in present(scenario, group)}
    missing = [path for path in leaves(scenario) if path not in offered and not shown_in_sections(path)]
    assert missing == ["initial.beam_coordinates"], (
        "it has as many numbers as the mesh; a mode's button or a file sets it"
    )
    observing = scenario.replace({"controller.control_period": 1e-3, "controller.kind": "lqr"})
    offered |= {path for group in GROUPS for path in present(observing, group)}
    assert set(SWITCHES) <= offered


@pytest.mark.parametrize("name", preset_names())
def test_switches_start_with_a_value_that_the_scenario_accepts(name: str) -> None:
    scenario = load_preset(name)
    for path, (_, begin) in SWITCHES.items():
        if any(path in present(scenario, group) for group in GROUPS):
            scenario.replace({path: begin(scenario)})


def test_limits_sampling_and_arms_are_set_in_their_folders(page: LabPage) -> None:
    page.press("Pause")  # Nothing here needs motion, and a still page costs a quarter of the time.
    page.open_tab("Motors, sampling and sensors")
    page.enter("Input delay d (samples)", "3")
    page.wait_for_text("give the control period (controller.control_period) a value in s")
    assert page.snapshot.scenario.controller.input_delay == 0
    page.switch("Sampled control")
    wait_until(lambda: page.snapshot.scenario.controller.control_period == 0.001, "the control is sampled")
    page.enter("Input delay d (samples)", "2")
    wait_until(lambda: page.snapshot.scenario.controller.input_delay == 2, "with a delay")
    page.switch("Limited torques")
    wait_until(lambda: page.snapshot.scenario.controller.torque_limit == (400.0, 400.0, 400.0), "and limits")
    page.enter("Torque limit per joint τ_max (N·m)", "90")
    wait_until(lambda: page.snapshot.scenario.controller.torque_limit == (90.0, 400.0, 400.0), "one by one")
    page.open_tab("Torques")
    page.wait_for_text("limit 1 (N·m)")
    page.picture("details")
    page.switch("Limited torques")
    wait_until(lambda: page.snapshot.scenario.controller.torque_limit is None, "and off again")
    page.open_tab("Left arm")
    run = page.snapshot.run_number
    page.enter("Link masses m (kg)", "9")
    wait_until(lambda: page.snapshot.scenario.left_arm.link_mass == (9.0, 8.0, 4.0), "one mass is changed")
    assert page.snapshot.scenario.right_arm is not None
    assert page.snapshot.scenario.right_arm.link_mass == (8.0, 8.0, 4.0)
    wait_until(lambda: page.snapshot.run_number > run, "a new arm begins a new run")
    back = page.page.get_by_role("button").filter(has_text="↺")
    fields = ("left_arm.link_mass", "controller.input_delay", "controller.control_period")
    wait_until(lambda: back.count() == 3, "each change has its way back on the screen")
    for left, changed in zip((2, 1, 0), fields, strict=True):
        usual = load_preset("paper").get(changed)
        back.last.click()
        wait_until(
            lambda changed=changed, usual=usual: page.snapshot.scenario.get(changed) == usual, f"{changed} goes back"
        )
        wait_until(lambda left=left: back.count() == left, "its small button goes", 20)
    assert page.snapshot.scenario == load_preset("paper")
    assert not page.errors


def test_a_payload_is_filled_from_the_panel(page: LabPage) -> None:
    World(page.snapshot.scenario.replace({"payload.mass_change.factor": 3.0})).advance(2)  # Compile it beforehand.
    page.enter("Duration of the change of mass T_μ (s)", "0.5")
    page.enter("Final mass over initial mass (1: constant) μ", "3")
    wait_until(
        lambda: page.snapshot.scenario.payload.mass_change.factor == 3, "the payload is to weigh three times as much"
    )
    wait_until(lambda: page.snapshot.latest.own["payload_mass"][-1] == 3, "it is filled")
    page.wait_for_text("Start of the change of mass t_μ (s)")
    page.picture("filled")
    page.enter("Final mass over initial mass (1: constant) μ", "90")
    page.wait_for_text("0.05 to 20")
    assert page.snapshot.scenario.payload.mass_change.factor == 3
    assert not page.errors


def test_the_menu_of_the_grips_makes_them_compliant(page: LabPage) -> None:
    compliant = page.snapshot.scenario.replace({"grips.model": "compliant"})
    World(compliant).advance(2)  # Compile it beforehand.
    page.open_tab("Grips")
    page.choose("How the grips hold the beam", "compliant")
    wait_until(lambda: page.snapshot.scenario.grips.model == "compliant", "the grips are to give way")
    wait_until(lambda: abs(page.snapshot.latest.own["left_grip_displacement"][-1]).max() > 0, "they do")
    along = "Stiffness of the grips: along the beam, across, turning k_g (N/m, N/m, N·m/rad), N/m"
    page.enter(along, "200000")
    wait_until(lambda: page.snapshot.scenario.grips.stiffness == (2e5, 1e5, 1e4), "one of them is stiffer")
    page.picture("compliant")
    page.enter(along, "0")
    page.wait_for_text("1 to 10⁹")
    assert page.snapshot.scenario.grips.stiffness == (2e5, 1e5, 1e4)
    page.choose("Where the controller measures the pose", "payload")
    wait_until(lambda: page.snapshot.scenario.grips.measured_at == "payload", "as a camera does")
    assert not page.errors
