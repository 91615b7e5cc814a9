"""The force along the beam: buckling, squeezed and spun beams, against closed forms and published frequencies."""

from collections.abc import Iterator

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

from flexlab.analysis.validation.check import Check, Runs, above, below, close
from flexlab.analysis.validation.invariants import imbalance
from flexlab.physics.axial_load import BUCKLING, buckling_load, geometric_matrices
from flexlab.physics.beam import beam_matrices
from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate

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

FELT, PLAIN = {"payload.axial_load": "first-order"}, {"payload.axial_load": "none"}
PRESSED = {"controller.wanted_internal_force": 30.0}
SPIN_UP, SPUN_FOR = 3.0, 5.0
"""s of the preset `spin-up` until it spins steadily, and until it spins down."""
RISE, WANTED = 10.0, 60.0
"""F_d of the slow squeeze: s, and N at its end."""
STEPS = 100
"""Changes of F_d."""
MARGIN = 0.03
"""Share of the buckling load below and above it at which a bent beam is held."""
BUCKLED = 0.05
"""m: a tenth of the beam's length; no ring before comes near it."""


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
    yield from _motions(runs)


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


def _motions(runs: Runs) -> Iterator[Check]:
    """Kane's spin-up, the slow squeeze, the paper's run, and the balance of energy."""
    spin = load_preset("spin-up")
    felt, paper = simulate(spin, SPUN_FOR, 0.01), simulate(spin.replace(PLAIN), SPUN_FOR, 0.01)
    lag = np.abs(tip(felt))
    rising, steady = felt.time < SPIN_UP, (felt.time > SPIN_UP + 1) & (felt.time < SPUN_FOR)
    yield above("Kane's spin-up: the free end lags by up to, m", 0.005, lag[rising].max())
    yield below(
        "and returns to the line: while it spins, as a part of that", 0.1, lag[steady].max() / lag[rising].max()
    )
    yield Check("without the force along it, the same spin", "diverges", str(paper.status), paper.status == "diverged")
    yield from _squeezed_slowly()
    plain, with_force = runs.paper, simulate(load_preset("paper").replace(FELT), 2.0)
    peak = float(np.abs(plain.midspan_deflection).max())
    share = abs(float(np.abs(with_force.midspan_deflection).max()) / peak - 1)
    yield below("the paper's run: its peak deflection differs by, as a part", 0.01, share)
    for name in ("etdrk4", "rk4"):
        run = simulate(load_preset("soft-beam").replace({**FELT, **PRESSED, "simulation.integrator": name}), 2.0)
        moved = float(np.abs(np.diff(run.input_work)).sum() + np.ptp(run.dissipated_energy))
        yield below(
            f"{name}, squeezed: energy gained = work put in + work of the axial load - energy damped, as a part",
            1e-6,
            imbalance(run) / moved,
        )


def _squeezed_slowly() -> Iterator[Check]:
    """F_d of the soft beam raised from 0 to 60 N over 10 s, in steps."""
    shares = [k / STEPS for k in range(1, STEPS + 1)]
    steps = [(RISE * x, ChangeScenario({"controller.wanted_internal_force": WANTED * x})) for x in shares]
    start = {"controller.wanted_internal_force": 0.0, "payload.damping.coefficient": 0.005}
    run = simulate(load_preset("squeeze-until-it-buckles").replace(start), RISE, 0.001, steps)
    pressed = WANTED * run.time / RISE
    early, late = (frequency(run, pressed, *span) for span in ((0.0, 12.0), (30.0, 42.0)))
    critical = buckling_load(0.5, 1.27, "pinned-pinned")
    yield close(
        "the soft beam, F_d raised from 0 to 60 N in 10 s: its ring at 30 to 42 N over that at 0 to 12 N",
        np.sqrt((1 - 36 / critical) / (1 - 6 / critical)),
        late / early,
        relative=0.03,
    )
    for share, swings in ((1 - MARGIN, True), (1 + MARGIN, False)):
        force = {"controller.wanted_internal_force": share * critical}
        held = simulate(load_preset("squeeze-until-it-buckles").replace(start | force), 4.0)
        back = bool(held.midspan_deflection.min() < 0)
        words = "swings back through the line" if swings else "bends away for good"
        yield Check(
            f"held with {share:g} P_cr, a bent beam {words}", "yes", "yes" if back == swings else "no", back == swings
        )
    buckles = bool(np.abs(run.midspan_deflection[-1]) > BUCKLED)
    yield Check("at 60 N it has buckled", "yes", "yes" if buckles else "no", buckles)
    said = "it buckles" in run.status.text or "passed" in run.status.text
    yield Check("and the run says so", "yes", "yes" if said else run.status.text, said)


def tip(run: Run) -> np.ndarray:
    """Deflection of the free end, m, (N,)."""
    return run.beam_coordinates[:, -2]


def frequency(run: Run, pressed: np.ndarray, low: float, high: float) -> float:
    """Of the ring while the beam is pressed with low..high N, Hz, from its crossings of the mean."""
    part = (pressed >= low) & (pressed <= high)
    w = run.midspan_deflection[part]
    w = w - w.mean()
    upwards = np.flatnonzero((w[:-1] < 0) & (w[1:] >= 0))
    times = run.time[part][upwards] - w[upwards] * (run.time[1] - run.time[0]) / (w[upwards + 1] - w[upwards])
    return float((len(times) - 1) / (times[-1] - times[0]))
