"""The sound of the beam's ring in a real browser, analysed on its way to the sound card."""

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
"""Connects an analyser to everything that goes to the sound card."""
LOUDEST = """([low, high]) => {
  if (!window.heard) return null;
  const levels = new Float32Array(window.heard.frequencyBinCount);
  window.heard.getFloatFrequencyData(levels);
  const width = window.heard.context.sampleRate / window.heard.fftSize;
  let place = Math.round(low / width);
  for (let at = place; at < levels.length && at <= high / width; at++) if (levels[at] > levels[place]) place = at;
  return [place * width, Math.max(levels[place] ?? -200, -200)]; }"""
"""The loudest tone between two frequencies, Hz: its frequency, Hz, and its level, dB."""
LOOKS = """() => new Promise((done) => {
  const plain = document.querySelector;
  let looks = 0;
  document.querySelector = function (selector) { looks += selector === '.fl-tones'; return plain.call(this, selector); };
  setTimeout(() => { delete document.querySelector; done(looks); }, 500); })"""
"""How often the page looks for tones in half a second."""
AUDIBLE = -60.0
"""Level above which a tone counts as heard, dB."""
WHOLE = (0.0, 30e3)
"""The frequencies that a sound card plays, Hz."""


def loudest(page: LabPage, low: float, high: float) -> tuple[float, float]:
    """Frequency, Hz, and level, dB, of the loudest tone between two frequencies; −200 dB before there is any sound."""
    return page.page.evaluate(LOUDEST, [low, high]) or (0.0, -200.0)


def test_the_beams_modes_sound_in_their_true_ratio_until_the_run_pauses(page: LabPage) -> None:
    page.page.evaluate(LISTEN)
    session = page.session
    session.lab_state.change({"payload.damping.coefficient": 0.0, "payload.element_count": 8})
    session.lab_state.submit(SetSpeed(0.25))
    wait_until(lambda: page.snapshot.scenario.payload.damping.coefficient == 0.0, "a beam without damping")
    button = page.page.get_by_role("button", name="Hear it", exact=True)
    assert button.get_attribute("aria-pressed") == "false"
    assert page.page.locator(".fl-tones").count() == 0, "nothing is sent to who does not listen"
    assert loudest(page, *WHOLE)[1] == -200.0
    assert page.page.evaluate(LOOKS) == 0, "nor looked for"
    button.click()
    omega = np.sort(build_beam(page.snapshot.scenario.payload).modes.omega)[:2]
    assert page.page.evaluate(LOOKS) > 0
    first, second = heard_factor(float(omega[0]) / (2 * np.pi)) * omega / (2 * np.pi)
    session.lab_state.submit(Tap(0.12, (0.0, 0.3)))

    def heard(frequency: float) -> bool:
        at, level = loudest(page, 0.75 * frequency, 1.25 * frequency)
        return level > AUDIBLE and abs(at - frequency) < 0.01 * frequency

    wait_until(lambda: heard(first) and heard(second), "two modes are heard, each where it belongs")
    ratio = loudest(page, 0.75 * second, 1.25 * second)[0] / loudest(page, 0.75 * first, 1.25 * first)[0]
    assert abs(ratio / (omega[1] / omega[0]) - 1) < 0.01
    page.page.get_by_role("button", name="Sound: pitch × 16", exact=True).wait_for()
    session.lab_state.submit(Pause())
    wait_until(lambda: loudest(page, *WHOLE)[1] < AUDIBLE - 20, "silence while time stands")
    page.page.get_by_role("button", name="Sound: pitch × 16", exact=True).click()
    page.page.get_by_role("button", name="Hear it", exact=True).wait_for()
    wait_until(lambda: page.page.evaluate("window.heard.context.state") == "suspended", "the sound has faded")
    assert page.page.evaluate(LOOKS) == 0, "nobody listens any more"
    assert not page.errors
