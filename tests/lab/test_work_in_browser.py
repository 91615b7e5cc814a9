"""What a person does: touch, compare, edit, keys and lessons, in a real browser."""

import json
import math
import time
from pathlib import Path

import numpy as np
import pytest
from lab_page import BEAM, EI, LabPage, wait_until

from flexlab.guide import lessons
from flexlab.lab.scene.arms import LINK_HEIGHTS
from flexlab.lab.scene.beam import SIDES
from flexlab.lab.scene.forces import held_point
from flexlab.presets import load_preset, load_scenario_file
from flexlab.sim.commands import Pull, Tap
from flexlab.sim.geometry import arm_points, beam_points


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Own presets are saved in the working directory, which must not be this checkout."""
    monkeypatch.chdir(tmp_path)


PRESS = 100
"""How long a click holds the mouse button, ms: long enough for the page to see the press."""


def stiffness(page: LabPage) -> float:
    return page.snapshot.scenario.payload.bending_stiffness


def hold(page: LabPage) -> None:
    page.hold()
    page.catch_up()


def upload(page: LabPage, file: Path) -> None:
    """Choose a file, and wait until the page is ready for the next one."""
    button = page.page.get_by_role("button", name="Open a file", exact=True)
    with page.page.expect_file_chooser() as chooser:
        button.click()
    assert page.page.locator("input[type=file]").first.input_value() == "", "the same file may be chosen again"
    chooser.value.set_files(file)
    wait_until(button.is_enabled, "the file has come")
    told = page.page.locator(".mantine-Notification-root").filter(has_text=file.name)
    wait_until(lambda: not any(word.is_visible() for word in told.all()), "no word is left that it is on its way")


def middle(page: LabPage, name: str) -> np.ndarray:
    """Place (x, y) of the middle of a drawn beam, m."""
    corners = """(name) => {
      let found = null;
      window.__viserMutable.nodeRefFromName[name].traverse((node) => { found ??= node.geometry?.attributes?.position; });
      return Array.from(found.array); }"""
    rings = np.reshape(page.page.evaluate(corners, name), (-1, SIDES, 3))
    return rings[len(rings) // 2, :, :2].mean(axis=0)


def held_now(page: LabPage) -> Pull:
    """The pull of the hand that holds on."""
    pull = page.session.lab_state.pulled
    assert pull is not None
    return pull


def pulls(page: LabPage) -> list[Pull]:
    return [event.command for event in page.snapshot.events if isinstance(event.command, Pull)]


@pytest.mark.usefixtures("new_lab")
def test_undo_redo_and_the_button_that_restores_the_value_of_the_preset(page: LabPage) -> None:
    def place() -> float:
        """Distance from what stands above the menu of presets down to the box of EI, px."""
        above = "document.querySelector('.fl-preset').closest('div').getBoundingClientRect().y"
        return page.box(EI).evaluate(f"box => box.getBoundingClientRect().y - {above}")

    before = place()
    page.enter(EI, "50")
    wait_until(lambda: stiffness(page) == 50.0, "the first change is taken")
    page.enter("Damping c (N·s/m)", "0.5")
    wait_until(lambda: page.snapshot.scenario.payload.damping.coefficient == 0.5, "both changes are taken")
    page.wait_for_text(", changed")
    assert place() == before, "no control moves away under a hand"
    page.key("Control+z")
    wait_until(lambda: page.snapshot.scenario.payload.damping.coefficient == 0.1, "the damping is back")
    assert stiffness(page) == 50.0
    page.key("Control+z")
    wait_until(lambda: stiffness(page) == 100.0, "the stiffness is back")
    wait_until(lambda: page.box(EI).input_value() == "100", "and the box shows it", 20)
    page.key("Control+Shift+z")
    wait_until(lambda: stiffness(page) == 50.0, "it is made again")
    wait_until(lambda: page.box(EI).input_value() == "50", "and the box shows it, its way back beside it", 20)
    page.page.get_by_role("button").filter(has_text="↺").first.click()
    wait_until(lambda: stiffness(page) == 100.0, "the small button goes back to the preset's value")
    wait_until(lambda: ", changed" not in page.text(), "nothing is changed any more", 20)
    page.key("Control+z")
    page.key("Control+z")
    page.key("Control+z")
    page.wait_for_text("nothing to undo")


def test_dragging_the_beam_pulls_it_and_clicking_taps_it(page: LabPage) -> None:
    page.choose("Preset", "soft-beam")
    wait_until(lambda: page.snapshot.name == "soft-beam", "the soft beam runs")
    hold(page)
    x, y = page.beam_pixel()
    mouse = page.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + 10, y + 20, steps=3)
    mouse.move(x + 40, y + 80, steps=8)
    wait_until(lambda: page.session.lab_state.pulled is not None, "somebody pulls")
    page.picture("pull")
    before = float(page.snapshot.latest.midspan_deflection[0])
    page.key("Space")
    wait_until(lambda: float(page.snapshot.latest.midspan_deflection[0]) < before - 5e-3, "the beam gives way", 20)
    mouse.up()
    wait_until(lambda: page.session.lab_state.pulled is None, "the hand lets go")
    wait_until(lambda: pulls(page)[-1].stiffness == 0, "the simulation lets go as well")
    assert abs(pulls(page)[0].position) < 0.05
    hold(page)
    x, y = page.beam_pixel()
    mouse.move(x, y)
    mouse.click(x, y, delay=PRESS)
    wait_until(lambda: any(isinstance(event.command, Tap) for event in page.snapshot.events), "the beam is tapped")
    page.open_tab("Events")
    page.wait_for_text("Let go of the beam")
    page.wait_for_text("Tap the beam")


def test_dragging_a_link_pulls_the_arm(page: LabPage) -> None:
    first = page.camera()
    page.open_tab("View")
    page.press("Overview")  # The middle of the link lies outside the first view.
    wait_until(lambda: math.dist(first, page.camera()) > 0.05, "the whole machine is in the picture")
    hold(page)
    points = arm_points(page.snapshot.scenario, page.snapshot.display)[0, 0]
    middle = 0.5 * (points[1] + points[2])
    x, y = page.pixel(*middle, LINK_HEIGHTS[1])
    mouse = page.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x - 10, y, steps=3)
    mouse.move(x - 60, y - 30, steps=8)
    pull = wait_until(lambda: page.session.lab_state.pulled, "somebody pulls")
    assert pull.link == (1, 2)
    assert pull.position == pytest.approx(0.3, abs=0.05)
    wait_until(lambda: held_now(page).target[0] < middle[0] - 0.1, "the hand is where the mouse is")

    def spring_force() -> float:
        now = held_now(page)
        return now.stiffness * math.dist(now.target, held_point(page.snapshot.scenario, page.snapshot.display, now))

    wait_until(lambda: page.label("/pull_force") == f"pull {spring_force():.1f} N", "the arrow says how hard")
    page.picture("pull-link")
    (client,) = page.session.server.get_clients()
    still = time.monotonic() + 2.0
    heard = page.session.guard.silence
    wait_until(lambda: time.monotonic() - heard(client) > still, "a page whose mouse is held still is heard of", 20)
    assert held_now(page).link == (1, 2)
    error = float(np.abs(page.snapshot.latest.tracking_error[0]).max())
    page.key("Space")
    wait_until(lambda: np.abs(page.snapshot.latest.tracking_error[0]).max() > error + 1e-4, "the arm gives way", 20)
    mouse.up()
    wait_until(lambda: page.session.lab_state.pulled is None, "the hand lets go")
    wait_until(lambda: pulls(page)[-1].stiffness == 0, "the simulation lets go as well")
    assert {pull.link for pull in pulls(page)} == {(1, 2)}
    page.open_tab("Events")
    page.wait_for_text("Let go of link 2 of the left arm")


def test_a_tap_has_the_chosen_impulse_and_place_and_its_ring_gives_a_shaper(page: LabPage) -> None:
    page.open_tab("Touch")
    page.enter("Tap impulse (N·s)", "0.02")
    page.enter("Tap place s/L", "0.25")
    page.press("Tap")
    wait_until(lambda: any(isinstance(event.command, Tap) for event in page.snapshot.events), "the tap is in the log")
    tap = next(event.command for event in page.snapshot.events if isinstance(event.command, Tap))
    assert tap.beam_position == pytest.approx(0.25 * 0.5)
    assert math.hypot(*tap.impulse) == pytest.approx(0.02)
    tapped = float(page.snapshot.latest.time[0])
    wait_until(lambda: page.snapshot.latest.time[0] > tapped + 0.2, "it rings")
    page.press("Fit the ring")
    page.wait_for_text("Shortest that suffices")
    page.press("Use zvd")
    wait_until(lambda: page.snapshot.scenario.trajectory.shaper == "zvd", "the path goes through the shaper")
    assert page.snapshot.scenario.trajectory.shaper_frequency == pytest.approx(45.5, rel=0.05)
    page.enter("Tap impulse (N·s)", "1000")
    page.wait_for_text("outside the allowed range 0.0001 to 100 N·s")
    assert page.session.runner.snapshot.playing


def test_a_kept_run_is_drawn_and_compared_with_the_next_one(page: LabPage) -> None:
    page.key("r")
    wait_until(lambda: float(page.snapshot.latest.time[0]) > 1.5, "a run to keep")
    page.open_tab("Compare")
    page.press("Keep this run")
    kept = wait_until(lambda: page.session.lab_state.kept, "it is kept")
    page.open_tab("Parameters")
    page.enter(EI, "40")
    page.choose("Speed", "1/8 ×")
    page.key("r")
    wait_until(lambda: float(page.snapshot.latest.time[0]) < 1.0, "the next run begins")
    page.open_tab("Compare")
    page.wait_for_text("Peak vibration (mm)")
    page.wait_for_text("Bending stiffness EI (N·m²)")
    assert "Residual vibration" not in page.text(), "this path has no stop"
    wait_until(
        lambda: page.page.evaluate("window.__viserMutable.nodeRefFromName['/kept']?.visible"), "the kept beam is drawn"
    )
    hold(page)
    past, factor = kept.at(float(page.snapshot.display.time[0])), page.session.lab_state.view.exaggeration
    assert middle(page, "/kept") == pytest.approx(beam_points(kept.scenario, past, 3, factor)[0, 1], abs=1e-5)
    page.picture("compare")
    page.press("Forget it")
    wait_until(lambda: page.session.lab_state.kept is None, "it is forgotten")
    assert not page.errors


def test_save_download_and_open(page: LabPage, tmp_path: Path) -> None:
    page.enter(EI, "33")
    wait_until(lambda: stiffness(page) == 33.0, "the change is taken")
    page.open_tab("File")
    page.wait_for_text("changed, not saved")
    for name, said in (("../evil", "cannot be a preset's name"), ("paper", "a preset of flexlab itself")):
        page.write("Name", name)
        page.press("Save as preset")
        page.wait_for_text(said)
    assert list(tmp_path.rglob("*.json")) == []
    page.write("Name", "my-soft")
    page.key("s")
    wait_until(lambda: (tmp_path / "presets" / "my-soft.json").exists(), "it is saved")
    assert load_preset("my-soft").payload.bending_stiffness == 33.0
    wait_until(
        lambda: page.session.lab_state.name == "my-soft" and not page.session.lab_state.changed,
        "changes count from there",
    )
    with page.page.expect_download() as download:
        page.press("Download")
    file = tmp_path / "copy.json"
    download.value.save_as(file)
    assert load_scenario_file(file).payload.bending_stiffness == 33.0
    data = json.loads(file.read_text())
    for value in (77.0, 78.0, 79.0):
        data["payload"]["bending_stiffness"] = value
        file.write_text(json.dumps(data))
        upload(page, file)
        wait_until(lambda value=value: stiffness(page) == value, f"the file runs, with EI = {value:g} in it", 20)
    for name, text, said in (
        ("bad.json", '{"payload": {"bending_stiffness": -1}}', "outside the allowed range"),
        ("junk.json", "not json", "not valid JSON"),
    ):
        (tmp_path / name).write_text(text)
        upload(page, tmp_path / name)
        page.wait_for_text(said)
    assert stiffness(page) == 79.0


def test_keys_control_the_lab_except_in_a_text_field(page: LabPage) -> None:
    page.key("Space")
    wait_until(lambda: not page.snapshot.playing, "space holds")
    held = float(page.snapshot.latest.time[0])
    page.key("ArrowRight")
    wait_until(lambda: float(page.snapshot.latest.time[0]) == pytest.approx(held + 0.001, abs=1e-9), "one step")
    page.key("Space")
    wait_until(lambda: page.snapshot.playing, "space goes on")
    run = page.snapshot.run_number
    page.key("r")
    wait_until(lambda: page.snapshot.run_number == run + 1, "r begins anew")
    page.key("2")
    wait_until(lambda: page.snapshot.name != "paper", "2 loads the second preset")
    page.key("1")
    wait_until(lambda: page.snapshot.name == "paper", "1 loads the first")
    page.key("Shift+?")
    page.wait_for_text("A new run from t = 0, same settings")
    page.picture("keys")
    page.press("Close")
    box = page.box(EI)
    box.fill("1")
    box.press("2")
    wait_until(lambda: stiffness(page) == 12.0, "in a text field keys are text")
    assert page.snapshot.name == "paper"


def test_run_to_a_time_and_step_while_the_button_is_held(page: LabPage) -> None:
    page.open_tab("Events")
    goal = float(page.snapshot.latest.time[0]) + 20
    page.enter("Run to t (s)", f"{goal:.3f}")
    page.press("Run to it")
    wait_until(lambda: float(page.snapshot.latest.time[0]) >= goal - 0.001, "it is there at once", 20)
    assert not page.snapshot.playing
    page.press("Run to it")
    page.wait_for_text("has passed")
    held = float(page.snapshot.latest.time[0])
    step = page.page.get_by_role("button", name="Step", exact=True)
    step.hover()
    page.page.mouse.down()
    wait_until(lambda: float(page.snapshot.latest.time[0]) > held + 0.003, "holding goes on stepping")
    page.page.mouse.up()


@pytest.mark.usefixtures("new_lab")  # In which no lesson was opened.
def test_a_lesson_says_what_is_to_be_done_until_it_is_done(page: LabPage) -> None:
    page.open_tab("Guide")
    page.wait_for_text("Virtual link")
    page.choose("Read", f"Lesson 1: {lessons()[0].title}")
    page.press("Load paper")
    wait_until(lambda: float(page.snapshot.latest.time[0]) > 0.7, "the ringing run goes on", 30)
    page.wait_for_text("Now load the preset smooth-start")
    page.choose("Preset", "smooth-start")
    page.wait_for_text("the jump rang the beam, not the motion")
    page.picture("lesson")
    assert not page.errors


def test_the_ring_of_the_first_lesson_is_large_enough_to_be_seen(page: LabPage) -> None:
    """With the exaggeration of the lesson, its middle moves 60 px or more from side to side."""
    page.choose("Read", "Lesson 1: Why does it ring?")
    page.choose("Speed", "1/64 ×")
    page.page.keyboard.press("r")  # At once, as the lesson says: the menu no longer holds the keyboard.
    wait_until(lambda: page.snapshot.target_speed == 1 / 64 and page.snapshot.latest.time[0] < 0.1, "a new run")
    sides: list[float] = []

    def seen() -> bool:
        if page.snapshot.latest.time[0] > 0.2:  # A busy machine may have drawn too little of it before it faded.
            sides.clear()
            page.page.keyboard.press("r")
        left, middle, right = page.page.evaluate(BEAM, SIDES)
        along = (right[0] - left[0], right[1] - left[1])
        away = (middle[0] - left[0]) * along[1] - (middle[1] - left[1]) * along[0]
        sides.append(away / math.hypot(*along))
        return max(sides) - min(sides) >= 60

    wait_until(seen, "a ring of 60 px")
    assert page.session.lab_state.view.exaggeration == 50.0
