"""The tones of a ring: shifted by one factor, so in their true ratios, and as loud as the modes vibrate."""

import numpy as np
import pytest

from flexlab.lab.mode_computation import peak_deflection
from flexlab.lab.ring_sound import HIGHEST, LOUDEST, LOWEST, Tones, heard_factor, loudness
from flexlab.presets import load_preset
from flexlab.sim.build import build_beam
from flexlab.sim.simulate import simulate


@pytest.mark.parametrize("frequency", [0.02, 1.0, 4.6, 45.5, 150.0, 450.0, 2000.0, 9000.0])
def test_a_first_mode_is_heard_whatever_its_frequency(frequency: float) -> None:
    assert LOWEST <= heard_factor(frequency) * frequency <= HIGHEST


def test_a_stiffer_beam_of_the_same_kind_sounds_higher() -> None:
    assert heard_factor(45.5) == heard_factor(5.0) == heard_factor(140.0) == 16.0


def test_a_ring_in_one_mode_is_one_tone_with_its_true_amplitude() -> None:
    """The beam starts at rest in mode 2, 1 mm where it is widest, besides the slow bending of the paper's path."""
    scenario = load_preset("paper").replace(
        {"payload.damping": {"kind": "modal", "ratio": 1e-6}, "payload.element_count": 8}
    )
    tones = Tones(scenario.payload)
    beam = build_beam(scenario.payload)
    assert np.allclose(np.sort(beam.modes.omega)[: len(tones.omega)], tones.omega)
    shape = beam.modes.V[:, np.argsort(beam.modes.omega)[1]]
    start = shape * 1e-3 / peak_deflection(scenario.payload, shape)
    run = simulate(
        scenario.replace({"initial.beam_coordinates": tuple(map(float, start)), "initial.pose_rate": None}), 0.05, 0.001
    )
    found = tones.amplitudes(run)
    assert found[1] == pytest.approx(1e-3, rel=0.1)
    assert found[1] > 3 * np.delete(found, 1).max()


def test_steady_motion_is_silent_though_the_beam_bends() -> None:
    run = simulate(load_preset("smooth-start"), 1.0, 0.001)
    tones = Tones(run.scenario.payload)
    assert abs(run.midspan_deflection).max() > 1e-4
    assert max(map(loudness, tones.amplitudes(run.slice(800, 1000)))) < 0.03


def test_wider_vibration_is_louder() -> None:
    levels = [loudness(amplitude) for amplitude in (0.0, 1e-7, 1e-5, 1e-4, 1e-3, LOUDEST, 1.0)]
    assert levels == sorted(levels)
    assert levels[:2] == [0.0, 0.0]
    assert levels[-2:] == [1.0, 1.0]
