"""The beam's ring is heard in a real browser: looked at in what its sound card would get."""

import numpy as np
from lab_page import LabPage, wait_until

from flexlab.lab.ring_sound import heard_factor
from flexlab.sim.build import build_beam
from flexlab.sim.commands import Pause, SetSpeed, Tap

LISTEN = """() => {
  const connect = AudioNode.prototype.connect;
  AudioNode.prototype.connect = function (to, ...rest) {
    if (to instanceof AudioDestinationNode && !window.heard) {
      window.heard = this.context.createAnalyser();
      window.heard.fftSize = 32768;
      connect.call(this, window.heard);
    }
    return connect.call(this, to, ...rest);
  }; }"""
"""Puts an analyser beside the way to the sound card."""
SPECTRUM = """() => {
  if (!window.heard) return null;
  const levels = new Float32Array(window.heard.frequencyBinCount);
  window.heard.getFloatFrequencyData(levels);
  return [window.heard.context.sampleRate / window.heard.fftSize, [...levels].map((level) => Math.max(level, -200))]; }"""
AUDIBLE = -60.0
"""dB."""


def levels(page: LabPage) -> tuple[float, np.ndarray]:
    """Hz from one to the next, and dB."""
    found = page.page.evaluate(SPECTRUM)
    return (1.0, np.full(1, -200.0)) if found is None else (found[0], np.array(found[1]))


def peak_near(page: LabPage, frequency: float) -> tuple[float, float]:
    """Frequency, Hz, and level, dB, of what is loudest within a quarter of a frequency."""
    width, heard = levels(page)
    first, last = round(0.75 * frequency / width), round(1.25 * frequency / width) + 1
    if last >= len(heard):
        return 0.0, -200.0
    loudest = first + int(np.argmax(heard[first:last]))
    return loudest * width, float(heard[loudest])


def test_what_sounds_are_the_beams_modes_in_their_true_ratio_until_the_run_holds(page: LabPage) -> None:
    page.page.evaluate(LISTEN)
    session = page.session
    session.lab_state.change({"payload.damping.coefficient": 0.0, "payload.element_count": 8})
    session.lab_state.submit(SetSpeed(0.25))
    wait_until(lambda: page.snapshot.scenario.payload.damping.coefficient == 0.0, "a beam without damping")
    button = page.page.get_by_role("button", name="Hear it", exact=True)
    assert button.get_attribute("aria-pressed") == "false"
    assert page.page.locator(".fl-tones").count() == 0, "nothing is sent to who does not listen"
    assert levels(page)[1].max() == -200.0
    button.click()
    omega = np.sort(build_beam(page.snapshot.scenario.payload).modes.omega)[:2]
    first, second = heard_factor(float(omega[0]) / (2 * np.pi)) * omega / (2 * np.pi)
    session.lab_state.submit(Tap(0.12, (0.0, 0.3)))

    def heard(frequency: float) -> bool:
        at, level = peak_near(page, frequency)
        return level > AUDIBLE and abs(at - frequency) < 0.01 * frequency

    wait_until(lambda: heard(first) and heard(second), "two modes are heard, each where it belongs")
    ratio = peak_near(page, second)[0] / peak_near(page, first)[0]
    assert abs(ratio / (omega[1] / omega[0]) - 1) < 0.01
    page.page.get_by_role("button", name="Sound: pitch × 16", exact=True).wait_for()
    session.lab_state.submit(Pause())
    wait_until(lambda: levels(page)[1].max() < AUDIBLE - 20, "silence while time stands")
    page.page.get_by_role("button", name="Sound: pitch × 16", exact=True).click()
    page.page.get_by_role("button", name="Hear it", exact=True).wait_for()
    assert page.page.evaluate("window.heard.context.state") == "suspended"
    assert not page.errors
