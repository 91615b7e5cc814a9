"""The beam: Euler and Bernoulli's in closed form, the order of its elements, and the force along it."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.linalg import block_diag, eigh

from flexlab.analysis.lesson_measures import upward_frequency
from flexlab.analysis.validation.check import (
    DAMPING,
    Check,
    Runs,
    above,
    alike,
    balanced,
    below,
    close,
    general,
    subject,
    true,
)
from flexlab.analysis.validation.mass_points import MassPoints, coordinates, residual_force
from flexlab.physics.axial_load import BUCKLING, buckling_load, geometric_matrices
from flexlab.physics.beam import beam_matrices, shape_row, undamped_modes
from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario, Pull
from flexlab.sim.geometry import deflection_at
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

LENGTH, RHO, EI = 0.5, 2.0, 100.0
"""The paper's beam: m, kg/m, N·m²."""
CLAMPED = {"clamped-clamped": 4.730040744862704, "clamped-free": 1.875104068711961, "clamped-pinned": 3.926602312047919}
"""Boundary → first root z of its characteristic equation, ω = √(EI/ρ) z²/L²."""


@subject("The beam in closed form", 1)
def closed_form(_: Runs) -> Iterator[Check]:
    """Frequencies, static deflection, and convergence of the finite elements."""
    for k, value in enumerate((280.256, 1239.35, 3115.22, 5679.44)):
        yield close(f"two elements, pinned: frequency {k + 1}", value, _frequencies(2)[k], "rad/s", relative=4e-6)
    for mode in (1, 2, 3):
        exact, found = np.sqrt(EI / RHO) * (mode * np.pi / LENGTH) ** 2, _frequencies(32)[mode - 1]
        yield close(f"32 elements, pinned: ω{mode} = √(EI/ρ) ({mode}π/L)²", exact, found, "rad/s", relative=1e-5)
    for boundary, root in CLAMPED.items():
        exact = np.sqrt(EI / RHO) * root**2 / LENGTH**2
        yield close(f"32 elements, {boundary}: ω1", exact, _frequencies(32, boundary)[0], "rad/s", relative=1e-6)
    beam, middle = beam_matrices(LENGTH, RHO, EI, 2, "pinned-pinned"), shape_row(0.0, LENGTH, 2, "pinned-pinned")
    sag = float(middle @ np.linalg.solve(beam.K_F, middle))
    yield close("a force of 1 N at mid-span bends it by L³/(48 EI)", LENGTH**3 / (48 * EI), sag, "m", relative=1e-12)
    fine = beam_matrices(LENGTH, RHO, EI, 16, "pinned-pinned")
    weight = float(shape_row(0.0, LENGTH, 16, "pinned-pinned") @ np.linalg.solve(fine.K_F, 9.81 * fine.h))
    exact = 5 * RHO * 9.81 * LENGTH**4 / (384 * EI)
    yield close("its own weight bends it by 5 ρ g L⁴/(384 EI)", exact, weight, "m", relative=1e-9)
    exact = EI / RHO * (np.pi / LENGTH) ** 4
    errors = np.array([_frequencies(n)[0] ** 2 - exact for n in (2, 4, 8, 16)])
    slopes = np.log2(errors[:-1] / errors[1:])
    yield close("the error of ω1² falls with the element length to the power", 4.0, slopes.mean(), absolute=0.1)
    statement = "Rayleigh and Ritz: ω1² comes from above (least error, as 1 - error/exact)"
    yield below(statement, 1.0, 1 - errors.min() / exact)


def _frequencies(n: int, boundary: str = "pinned-pinned") -> np.ndarray:
    return undamped_modes(beam_matrices(LENGTH, RHO, EI, n, boundary))[0]


ELEMENTS = 8
SQUEEZES = (-2.0, -1.0, 0.5, 0.9, 0.95)
"""Compressions, as shares of the buckling load."""
SPUN = {0.0: 3.5160, 1.0: 3.5432, 2.0: 3.6218, 5.0: 4.0739, 10.0: 5.0490}
"""γ = Ω√(ρL⁴/EI) → λ = ω√(ρL⁴/EI) of a cantilever spun about its clamped end, in its plane (Wright et al., J. Appl. Mech. 49
(1982) 197-202, with Southwell's λ² less γ²)."""
SOFTENED_AWAY = 3.516
"""γ at which a spun beam has no stiffness left in a model without axial load."""
FELT, PLAIN = {"payload.axial_load": "first-order"}, {"payload.axial_load": "none"}
FOLLOWED = 3000.0
"""Fastest mode that N(s) follows, 1/s."""
MANY = 18
"""Number of elements of a mesh whose fastest modes do not feel that force."""
SOFT = 5.0
"""Bending stiffness of a beam whose modes all feel the force along it, N·m²."""
GAUGES = (-0.25 * (1 + 3**-0.5), -0.25 * (1 - 3**-0.5), 0.25 * (1 - 3**-0.5), 0.25 * (1 + 3**-0.5))
"""s/L of the four strain gauges: the Gauss points of the two halves."""
PRESSED = {"controller.wanted_internal_force": 30.0}
SPIN_UP, SPUN_FOR = 3.0, 5.0
"""Times at which the preset `spin-up` begins to spin steadily, and to spin down, s."""
RISE, WANTED, STEPS = 10.0, 60.0, 100
"""Duration of the slow squeeze, s, the F_d that it reaches, N, and the number of its steps."""
MARGIN = 0.03
"""Share of the buckling load by which a bent beam is held below and above it."""
BUCKLED = 0.05
"""Deflection from which a beam has buckled, m: a tenth of its length, far above that of any earlier ring."""


@subject("The force along the beam", 10)
def axial_load(runs: Runs) -> Iterator[Check]:
    """Frequencies under axial load, buckling loads, published frequencies of spun beams, motions, and energy."""
    free = squeezed_frequency(ELEMENTS, 0.0)
    for share in SQUEEZES:
        statement = f"{ELEMENTS} elements, pinned, squeezed with {share:g} P_cr: ω1 = ω1(0) √(1 - P/P_cr)"
        exact, found = free * np.sqrt(1 - share), squeezed_frequency(ELEMENTS, share)
        yield close(statement, exact, found, "rad/s", relative=1e-3)
    for boundary, c in BUCKLING.items():
        statement = f"{ELEMENTS} elements, {boundary}: K_F + K_G is first singular at {c:g} π²EI/L²"
        exact, found = buckling_load(LENGTH, EI, boundary), critical_load(ELEMENTS, boundary)
        yield close(statement, exact, found, "N", relative=1e-3)
    for gamma, value in SPUN.items():
        yield close(f"cantilever spun with γ = {gamma:g}: λ", value, spun_frequency(ELEMENTS, gamma), relative=1e-3)
    softened = spun_frequency(ELEMENTS, SOFTENED_AWAY, felt=False)
    yield below(f"without the force along it, with γ = {SOFTENED_AWAY}: λ", 0.05, softened)
    yield from _general_motion()
    yield from _one_arm()
    yield from _motions(runs)


def _general_motion() -> Iterator[Check]:
    """N(s) and its work on the beam's coordinates, against mass points, in a soft beam, all of whose modes feel it."""
    run = general("the general run of a soft beam", {**FELT, "payload.bending_stiffness": SOFT})
    points, (_, _, rows) = MassPoints(run.scenario), coordinates(run)
    gauges = run.scenario.payload.length * np.array(GAUGES)
    along = [points.axial_force(run, k, run.pose_acceleration[k], gauges) for k in rows]
    yield alike(
        "N(s) is what the left arm and the link's motion make it: relative error", 1e-9, along, run.axial_load[rows]
    )

    statement = "Lagrange's equations hold for x0, y0, θ and, with K_G, for q"
    yield below(f"{statement}: relative residual", 1e-6, _residual_with_axial_load(run, points).max())
    # N(s) follows modes below 3000 1/s alone, and takes the others to move with the link: here in a stiff beam whose ends differ.
    changes = {"payload.boundary": "pinned-clamped", "initial.beam_coordinates": (0.05, 0.006, -0.02)}
    run = general("the general run of a stiff beam", {**FELT, **changes, "payload.damping.coefficient": 0.0})
    points = MassPoints(run.scenario)
    error = _residual_with_axial_load(run, points, 0.0, followed=_slow_directions(points))
    yield below("a stiff beam whose ends differ: the same: relative residual", 1e-6, error.max())
    # The fastest modes of so many elements feel no force along them. Half a sine bends the lowest ones.
    s = np.linspace(0.0, np.pi, MANY + 1)
    bent = np.stack([0.05 * np.sin(s), 0.05 * np.pi / LENGTH * np.cos(s)], axis=1).ravel()
    changes = {"payload.element_count": MANY, "initial.beam_coordinates": tuple(np.delete(bent, [0, -2]))}
    soft = {"payload.bending_stiffness": SOFT, "payload.damping.coefficient": 0.0}
    run = general("the general run of a fine mesh", {**FELT, **soft, **changes})
    points = MassPoints(run.scenario)
    slow = _slow_directions(points)
    error = _residual_with_axial_load(run.take(slice(100, 105)), points, 0.0, slow, slow)
    yield below(f"{MANY} elements: the same for modes below 3000 1/s: relative residual", 1e-6, error.max())


def _one_arm() -> Iterator[Check]:
    """N(s) in a beam that one arm swings: what its part beyond s and a hand there need."""
    change = {"factor": 3.0, "begin": 0.0, "duration": 0.2}
    world = World(load_preset("single-arm").replace({**FELT, "gravity": 9.81, "payload.mass_change": change}))
    hand = Pull(0.1, (0.4, 0.9), 50.0)
    world.apply(hand)
    run, half = world.run(100), LENGTH / 2
    x, y, turn = run.pose.T
    c, s, w = (
        np.cos(turn),
        np.sin(turn),
        deflection_at(world.scenario.payload, run.beam_coordinates, np.array([hand.position]))[:, 0],
    )
    at = np.stack([x + hand.position * c - w * s, y + hand.position * s + w * c], axis=1)
    pulled = hand.stiffness * ((hand.target - at) * np.stack([c, s], axis=1)).sum(axis=1)
    along = c * run.pose_acceleration[:, 0] + s * (run.pose_acceleration[:, 1] + 9.81)
    ends = [-half, hand.position, hand.position + 1e-12, half]
    place = np.array([*LENGTH * np.array(GAUGES), *ends])
    density = run.own["payload_mass"][:, None] / LENGTH
    spun = run.pose_rate[:, 2:] ** 2 / 2
    exact = density * (spun * (half**2 - place**2) - along[:, None] * (half - place))
    exact += np.where(place <= hand.position, pulled[:, None], 0.0)
    statement = "one arm swings a beam that is filled and held: N(s) is what moves the part beyond s: relative error"
    yield alike(statement, 1e-9, run.axial_load, exact[:, :4])
    pressed = np.maximum(0.0, -exact.min(axis=1)) / (BUCKLING["clamped-free"] * np.pi**2 * EI / LENGTH**2)
    yield alike(
        "and its largest compression, at an end or at the hand, over P_cr: relative error",
        1e-9,
        run.axial_load_share,
        pressed,
    )
    largest = np.abs(run.moving_force).max()
    yield below(
        "and presses on nothing: its internal force, as a part of what moves the payload",
        1e-12,
        np.abs(run.internal_force).max() / largest,
    )


def _slow_directions(points: MassPoints) -> np.ndarray:
    """x0, y0, θ and the modes that N(s) follows, in columns."""
    n = points.shapes(0.0).size
    square, V = eigh(points.bending, points.payload_inertia(np.zeros(3 + n))[3:, 3:])
    return np.array(block_diag(np.eye(3), V[:, square < FOLLOWED**2]))


def _residual_with_axial_load(
    run: Any,
    points: MassPoints,
    damping: float = DAMPING,
    onto: np.ndarray | None = None,
    followed: np.ndarray | None = None,
) -> np.ndarray:
    """`residual_force` of inputs, damping and the force along the beam; `followed`: as `onto` of `axial_stiffness`."""

    def force(k: int) -> np.ndarray:
        on_beam = damping * run.beam_rates[k] + points.axial_stiffness(run, k, followed) @ run.beam_coordinates[k]
        return np.concatenate([run.arm_input[k].sum(axis=0), -on_beam])

    return residual_force(run, lambda _: (points.inertia, points.potential), force, onto)


def squeezed_frequency(n: int, share: float) -> float:
    """ω1 of the pinned beam under a constant compression, a share of its buckling load, rad/s."""
    pinned = "pinned-pinned"
    beam, (G0, _, _) = beam_matrices(LENGTH, RHO, EI, n, pinned), geometric_matrices(LENGTH, RHO, n, pinned)
    load = share * buckling_load(LENGTH, EI, pinned)
    return float(np.sqrt(eigh(beam.K_F - load * G0, beam.M_q, eigvals_only=True)[0]))


def critical_load(n: int, boundary: str) -> float:
    """The least compression P at which K_F + K_G, here K_F - P G0, is singular, N."""
    beam, (G0, _, _) = beam_matrices(LENGTH, RHO, EI, n, boundary), geometric_matrices(LENGTH, RHO, n, boundary)
    return float(1 / eigh(G0, beam.K_F, eigvals_only=True)[-1])


def spun_frequency(n: int, gamma: float, felt: bool = True) -> float:
    """λ of a cantilever spun about its clamped end with γ, in its plane; `felt`: with K_G."""
    beam = beam_matrices(LENGTH, RHO, EI, n, "clamped-free")
    G0, G1, G2 = geometric_matrices(LENGTH, RHO, n, "clamped-free")
    scale = RHO * LENGTH**4 / EI
    spin2 = gamma**2 / scale
    # The clamped end alone accelerates the beam's middle inwards, with Ω²L/2.
    along = -spin2 * LENGTH / 2
    K_G = -RHO * LENGTH * along * G0 + along * G1 + spin2 * G2
    stiffness = beam.K_F - spin2 * beam.M_q + (K_G if felt else 0.0)
    return float(np.sqrt(max(0.0, eigh(stiffness, beam.M_q, eigvals_only=True)[0]) * scale))


def _motions(runs: Runs) -> Iterator[Check]:
    """Kane's spin-up, the slow squeeze, the paper's run, and the balance of energy."""
    spin = load_preset("spin-up").replace({"simulation.accuracy": 1e-6})
    felt, paper = simulate(spin, SPUN_FOR, 0.01), simulate(spin.replace(PLAIN), SPUN_FOR, 0.01)
    lag = np.abs(felt.beam_coordinates[:, -2])  # The deflection of the free end.
    rising, steady = felt.time < SPIN_UP, (felt.time > SPIN_UP + 1) & (felt.time < SPUN_FOR)
    yield above("Kane's spin-up: the free end lags by up to, m", 0.005, lag[rising].max())
    back = lag[steady].max() / lag[rising].max()
    yield below("and returns to the line: while it spins, as a part of that", 0.1, back)
    yield Check("without the force along it, the same spin", "diverges", str(paper.status), paper.status == "diverged")
    yield from _squeezed_slowly()
    plain, with_force = runs.paper, simulate(load_preset("paper").replace(FELT), 2.0)
    peak = float(np.abs(plain.midspan_deflection).max())
    share = abs(float(np.abs(with_force.midspan_deflection).max()) / peak - 1)
    yield below("the paper's run: its peak deflection differs by, as a part", 0.01, share)
    for name in ("etdrk4", "rk4"):
        run = simulate(load_preset("soft-beam").replace({**FELT, **PRESSED, "simulation.integrator": name}), 2.0)
        statement = "energy gained = work put in + work of the axial load - energy damped, as a part"
        yield balanced(f"{name}, squeezed: {statement}", run)


def _squeezed_slowly() -> Iterator[Check]:
    """F_d of the soft beam raised from 0 to 60 N over 10 s, in steps."""
    shares = [k / STEPS for k in range(1, STEPS + 1)]
    steps = [(RISE * x, ChangeScenario({"controller.wanted_internal_force": WANTED * x})) for x in shares]
    start = {"controller.wanted_internal_force": 0.0, "payload.damping.coefficient": 0.005}
    run = simulate(load_preset("squeeze-until-it-buckles").replace(start), RISE, 0.001, steps)
    pressed = WANTED * run.time / RISE
    early, late = (
        upward_frequency(run.take((pressed >= low) & (pressed <= high))) for low, high in ((0.0, 12.0), (30.0, 42.0))
    )
    critical = buckling_load(0.5, 1.27, "pinned-pinned")
    statement = "the soft beam, F_d raised from 0 to 60 N in 10 s: its ring at 30 to 42 N over that at 0 to 12 N"
    yield close(statement, np.sqrt((1 - 36 / critical) / (1 - 6 / critical)), late / early, relative=0.03)
    for share, swings in ((1 - MARGIN, True), (1 + MARGIN, False)):
        force = {"controller.wanted_internal_force": share * critical, "payload.mode_count": 1}
        held = simulate(load_preset("squeeze-until-it-buckles").replace(start | force), 4.0)
        back = bool(held.midspan_deflection.min() < 0)
        words = "swings back through the line" if swings else "bends away for good"
        yield true(f"held with {share:g} P_cr, a bent beam {words}", back == swings)
    yield true("at 60 N it has buckled", bool(np.abs(run.midspan_deflection[-1]) > BUCKLED))
    said = "it buckles" in run.status.text or "passed" in run.status.text
    yield true("and the run says so", said, run.status.text)
