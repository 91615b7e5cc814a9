"""Euler and Bernoulli's beam in closed form, and the order with which the finite elements come to it."""

from collections.abc import Iterator

import numpy as np

from flexlab.analysis.validation.check import Check, Runs, below, close
from flexlab.physics.beam import beam_matrices, shape_row, undamped_modes

SUBJECT, PLACE = "The beam in closed form", 1

LENGTH, RHO, EI = 0.5, 2.0, 100.0
"""The paper's: m, kg/m, N·m²."""
CLAMPED = {"clamped-clamped": 4.730040744862704, "clamped-free": 1.875104068711961, "clamped-pinned": 3.926602312047919}
"""Boundary → first root z of its characteristic equation, ω = √(EI/ρ) z²/L²."""


def checks(_: Runs) -> Iterator[Check]:
    """Frequencies, static deflection, convergence."""
    for k, value in enumerate((280.256, 1239.35, 3115.22, 5679.44)):
        found = _frequencies(2, "pinned-pinned")[k]
        yield close(f"two elements, pinned: frequency {k + 1}", value, found, "rad/s", relative=4e-6)
    for mode in (1, 2, 3):
        exact = np.sqrt(EI / RHO) * (mode * np.pi / LENGTH) ** 2
        yield close(
            f"32 elements, pinned: ω{mode} = √(EI/ρ) ({mode}π/L)²",
            exact,
            _frequencies(32)[mode - 1],
            "rad/s",
            relative=1e-5,
        )
    for boundary, root in CLAMPED.items():
        exact = np.sqrt(EI / RHO) * root**2 / LENGTH**2
        yield close(f"32 elements, {boundary}: ω1", exact, _frequencies(32, boundary)[0], "rad/s", relative=1e-6)
    beam, middle = beam_matrices(LENGTH, RHO, EI, 2, "pinned-pinned"), shape_row(0.0, LENGTH, 2, "pinned-pinned")
    sag = float(middle @ np.linalg.solve(beam.K_F, middle))
    yield close("a force of 1 N at mid-span bends it by L³/(48 EI)", LENGTH**3 / (48 * EI), sag, "m", relative=1e-12)
    fine = beam_matrices(LENGTH, RHO, EI, 16, "pinned-pinned")
    weight = float(shape_row(0.0, LENGTH, 16, "pinned-pinned") @ np.linalg.solve(fine.K_F, 9.81 * fine.h))
    yield close(
        "its own weight bends it by 5 ρ g L⁴/(384 EI)",
        5 * RHO * 9.81 * LENGTH**4 / (384 * EI),
        weight,
        "m",
        relative=1e-9,
    )
    exact = EI / RHO * (np.pi / LENGTH) ** 4
    errors = np.array([_frequencies(n)[0] ** 2 - exact for n in (2, 4, 8, 16)])
    slopes = np.log2(errors[:-1] / errors[1:])
    yield close("the error of ω1² falls with the element length to the power", 4.0, slopes.mean(), absolute=0.1)
    yield below(
        "Rayleigh and Ritz: ω1² comes from above (least error, as 1 - error/exact)", 1.0, 1 - errors.min() / exact
    )


def _frequencies(n: int, boundary: str = "pinned-pinned") -> np.ndarray:
    return undamped_modes(beam_matrices(LENGTH, RHO, EI, n, boundary))[0]
