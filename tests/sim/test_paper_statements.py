"""What the paper says about its simulation (Section IV), one test for each sentence."""

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate

PERIOD = 0.001


@pytest.fixture(scope="module")
def paper() -> Run:
    """A run of six seconds, the last four of which serve for spectra."""
    return simulate(load_preset("paper"), 6.0, PERIOD)


def rows(start: float, stop: float) -> slice:
    return slice(round(start / PERIOD), round(stop / PERIOD))


def spectrum(signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, Hz, and amplitudes of a signal whose length holds whole periods."""
    amplitude = np.abs(np.fft.rfft(signal, axis=0)) * 2 / len(signal)
    return np.fft.rfftfreq(len(signal), PERIOD), amplitude


def test_it_tracks_the_planned_trajectory_quickly(paper: Run):
    """The error falls from over 1.6 cm to under a millimetre (and a tenth of a milliradian) within 1 s, and stays there."""
    early, late = np.abs(paper.tracking_error[rows(0, 0.1)]), np.abs(paper.tracking_error[rows(1, 6)])
    assert early.max() > 0.016
    assert late[:, :2].max() < 1e-3
    assert late[:, 2].max() < 1e-4


def test_the_original_vibration_is_gone_at_half_a_second(paper: Run):
    """The free vibration rings at the first mode and is under one per cent of its peak from 0.5 s on."""
    vibration = np.abs(paper.vibration)
    peak = vibration[rows(0, 0.5)].max()
    assert peak > 1e-3
    assert vibration[rows(0.2, 0.3)].max() > 0.05 * peak
    assert vibration[rows(0.5, 6)].max() < 0.01 * peak
    frequency, amplitude = spectrum(paper.vibration[rows(0.05, 0.45)])
    strongest = frequency[10 + np.argmax(amplitude[10:])]
    assert strongest == pytest.approx(44.4, rel=0.08)


def test_afterwards_the_rigid_motion_drives_the_vibration_at_one_hertz(paper: Run):
    """From 2 s to 6 s, the strongest line of every beam coordinate that bends is 1 Hz, with nothing beyond 10 Hz."""
    frequency, amplitude = spectrum(paper.beam_coordinates[rows(2, 6)][:, [0, 1, 3]])
    assert np.all(frequency[1 + np.argmax(amplitude[1:], axis=0)] == 1.0)
    assert np.all(amplitude[frequency > 10].max(axis=0) < 1e-5 * amplitude.max(axis=0))


def test_the_bending_is_then_quasi_static(paper: Run):
    """q follows K_F⁻¹ times the inertial load: what is left of the vibration is under half a per cent of the deflection.

    The load is that of the desired motion; the rest comes from the difference between the actual and the desired motion.
    """
    left = np.abs(paper.vibration[rows(1, 6)]).max()
    assert left < 5e-3 * np.abs(paper.midspan_deflection[rows(1, 6)]).max()


def test_vibration_states_are_bounded(paper: Run):
    """Theorem 1: after the start-up q and q̇ repeat themselves period by period; nothing builds up."""
    for signal in (paper.beam_coordinates, paper.beam_rates):
        size = np.abs(signal).max(axis=0)
        assert np.all(np.abs(signal[rows(1, 6)]).max(axis=0) < 0.5 * size)
        assert np.all(np.abs(signal[rows(3, 5)] - signal[rows(4, 6)]).max(axis=0) < 1e-5 * size)


def test_the_internal_force_feels_the_vibration_more_than_the_position(paper: Run):
    """The part above 20 Hz is a large share of the internal force and a negligible share of the pose."""
    window = np.hanning(300)[:, None]

    def fast_part(signal: np.ndarray) -> float:
        frequency, amplitude = spectrum((signal[rows(0.03, 0.33)] - signal[rows(0.03, 0.33)].mean(axis=0)) * window)
        return float((amplitude[frequency > 20].max(axis=0) / amplitude.max(axis=0)).max())

    assert fast_part(paper.internal_force[:, 0]) > 0.1
    assert fast_part(paper.internal_force[:, 0]) > 30 * fast_part(paper.pose)


def test_the_internal_force_is_bounded(paper: Run):
    """Section III: all terms of Eq. (26) are bounded, so the internal force is: its start-up peak is never passed."""
    size = np.abs(paper.internal_force).max(axis=(1, 2))
    assert size[rows(1, 6)].max() < 0.2 * size[rows(0, 0.1)].max()
    assert size[rows(5, 6)].max() == pytest.approx(size[rows(4, 5)].max(), rel=1e-3)
