"""The force along the beam: buckling, squeezed and spun beams, against closed forms and published frequencies."""

from collections.abc import Iterator

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

from flexlab.analysis.validation.check import Check, below, close
from flexlab.analysis.validation.runs import Runs
from flexlab.physics.axial_load import BUCKLING, buckling_load, geometric_matrices
from flexlab.physics.beam import beam_matrices

SUBJECT, PLACE = "The force along the beam", 9

LENGTH, RHO, EI = 0.5, 2.0, 100.0
"""The paper's: m, kg/m, N·m²."""
ELEMENTS = 8
SQUEEZES = (-2.0, -1.0, 0.5, 0.9, 0.95)
"""Compression over the buckling load."""
SPUN = {0.0: 3.5160, 1.0: 3.5432, 2.0: 3.6218, 5.0: 4.0739, 10.0: 5.0490}
"""γ = Ω√(ρL⁴/EI) → λ = ω√(ρL⁴/EI) of a cantilever spun about its clamped end, in its plane (Wright et al., J. Appl. Mech. 49
(1982) 197-202, with Southwell's λ² less γ²)."""
SOFTENED_AWAY = 3.516
"""γ at which the paper's beam has no stiffness left."""

SOFT_SPIN = {
    "payload.boundary": "clamped-free",
    "right_arm": None,
    "payload.bending_stiffness": 1.27,
    "payload.element_count": 4,
}
RISE, WANTED = 10.0, 60.0
"""F_d of the slow squeeze: s, and N at its end."""
STEPS = 100
"""Changes of F_d."""


def checks(runs: Runs) -> Iterator[Check]:
    """Every row of the table of the theory, and the balance of energy with the work of the axial load."""
    free = squeezed_frequency(ELEMENTS, 0.0)
    for share in SQUEEZES:
        yield close(
            f"{ELEMENTS} elements, pinned, squeezed with {share:g} P_cr: ω1 = ω1(0) √(1 - P/P_cr)",
            free * np.sqrt(1 - share),
            squeezed_frequency(ELEMENTS, share),
            "rad/s",
            relative=1e-3,
        )
    for boundary, c in BUCKLING.items():
        yield close(
            f"{ELEMENTS} elements, {boundary}: K_F + K_G is first singular at {c:g} π²EI/L²",
            buckling_load(LENGTH, EI, boundary),
            critical_load(ELEMENTS, boundary),
            "N",
            relative=1e-3,
        )
    for gamma, value in SPUN.items():
        yield close(f"cantilever spun with γ = {gamma:g}: λ", value, spun_frequency(ELEMENTS, gamma), relative=1e-3)
    yield below(
        f"without the force along it, with γ = {SOFTENED_AWAY}: λ",
        0.05,
        spun_frequency(ELEMENTS, SOFTENED_AWAY, felt=False),
    )


def squeezed_frequency(n: int, share: float) -> float:
    """ω1 of the pinned beam under a constant compression, a share of its buckling load, rad/s."""
    beam, (G0, _, _) = (
        beam_matrices(LENGTH, RHO, EI, n, "pinned-pinned"),
        geometric_matrices(LENGTH, RHO, n, "pinned-pinned"),
    )
    load = share * buckling_load(LENGTH, EI, "pinned-pinned")
    return float(np.sqrt(eigh(beam.K_F - load * G0, beam.M_q, eigvals_only=True)[0]))


def critical_load(n: int, boundary: str) -> float:
    """Compression at which the least eigenvalue of K_F + K_G is first zero, N."""
    beam, (G0, _, _) = beam_matrices(LENGTH, RHO, EI, n, boundary), geometric_matrices(LENGTH, RHO, n, boundary)
    expected = buckling_load(LENGTH, EI, boundary)

    def least(load: float) -> float:
        return float(eigh(beam.K_F - load * G0, beam.M_q, eigvals_only=True)[0])

    return float(brentq(least, 0.5 * expected, 1.5 * expected))


def spun_frequency(n: int, gamma: float, felt: bool = True) -> float:
    """λ of a cantilever spun about its clamped end with γ, in its plane; `felt`: with K_G."""
    beam, (G0, G1, G2) = (
        beam_matrices(LENGTH, RHO, EI, n, "clamped-free"),
        geometric_matrices(LENGTH, RHO, n, "clamped-free"),
    )
    scale = RHO * LENGTH**4 / EI
    spin2 = gamma**2 / scale
    # Its middle is drawn inwards with Ω²L/2, by the clamped end alone.
    along = -spin2 * LENGTH / 2
    K_G = -RHO * LENGTH * along * G0 + along * G1 + spin2 * G2
    stiffness = beam.K_F - spin2 * beam.M_q + (K_G if felt else 0.0)
    return float(np.sqrt(max(0.0, eigh(stiffness, beam.M_q, eigvals_only=True)[0]) * scale))
