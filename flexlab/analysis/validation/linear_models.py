"""Linear models, margins and identified beams, each against an independent answer."""

import re
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from flexlab.analysis.identification.beam_parameters import beam_parameters, mesh_note
from flexlab.analysis.identification.estimates import Estimate, RingFit
from flexlab.analysis.identification.remedies import remedies
from flexlab.analysis.identification.ring import fit_ring
from flexlab.analysis.linearize import linearize
from flexlab.analysis.modes import modes
from flexlab.analysis.validation.beam import EI, LENGTH, RHO
from flexlab.analysis.validation.check import (
    CENTER,
    DAMPING,
    UNEQUAL,
    Check,
    Runs,
    above,
    alike,
    below,
    close,
    subject,
    true,
)
from flexlab.analysis.validation.mass_points import MassPoints, slopes
from flexlab.analysis.validation.paper import loop_pole
from flexlab.analysis.validation.sampled_loop import joint_torques
from flexlab.presets import load_preset

ELSEWHERE = [(0.0, 0.75, 0.0), (0.2, 0.9, 0.3)]
"""Poses of a ring."""
HELD = (0.05, 0.8, 0.2)
"""Pose at which PD holds unequal arms."""
SHARE, SQUEEZE = 0.4, 20.0
"""Its share of the left arm, and the force with which it squeezes the payload, N."""
SPRINGS, DAMPERS = np.diag((9e3, 7e3, 5e3)), np.diag((900.0, 800.0, 600.0))
"""K_p and K_d of that law."""
TRIED = 2j * np.pi * np.array([1.0, 20.0, 45.0, 190.0])
"""Points s at which responses are compared, 1/s."""
INPUTS = ("arm_input", "joint_torque", "desired_pose", "desired_pose_rate")
SOUGHT, RATIO = 70.0, 0.02
"""Bending stiffness, N·m², and damping ratio of a beam whose ring is identified."""
NOISE, DRAWS = 0.01, 25
"""Standard deviation of the noise of a ring, over its amplitude, and number of such rings."""
MEMORY, FEWER = 0.8, 8
"""Part of a noise that lasts to the next sample, and number of rings in it, whose fits take longer."""
RISE = 0.5
"""Rate of a frequency that rises during a ring, Hz/s."""
T_95 = 1.966
"""Student's t of a 95 % interval for the 393 degrees of freedom that 400 samples and 7 parameters leave."""


@subject("Linear models, margins and identified beams", 17)
def linear_models(_: Runs) -> Iterator[Check]:
    """Participation of modes, responses, margins, an identified beam and its intervals."""
    yield from _participation()
    yield from _pd()
    yield _alone()
    yield from _ring()
    yield from _intervals()


def _participation() -> Iterator[Check]:
    """A pinned beam's modes move 8/(kπ)² of its mass sideways (odd k) and 24/(kπ)² of its inertia in a turn (even k)."""
    beta = 1e-4
    damped = {"payload.element_count": 8, "payload.damping": {"kind": "stiffness", "coefficient": beta}}
    found, k = modes(load_preset("paper").replace(damped)), np.arange(1, 5)
    omega = np.sqrt(EI / RHO) * (k * np.pi / LENGTH) ** 2
    yield alike("modes: frequencies of a pinned beam: relative error", 5e-3, found.frequency[:4], omega / (2 * np.pi))
    yield alike(
        "modes: C = βK_F damps each by ζ = βω/2: relative error", 5e-3, found.damping_ratio[:4], beta * omega / 2
    )
    shares = np.where(k % 2, 8, 24) / (k * np.pi) ** 2
    told = np.where(k % 2, found.lateral_participation[:4], found.angular_participation[:4])
    yield alike("modes: shares of mass and inertia that move with them: relative error", 1e-3, told, shares)
    rows = np.array(re.findall(r"^ *(\d) +([\d.]+) +([\d.]+) +([\d.]+) +([\d.]+)$", str(found), re.M)[:4], float)
    sideways, turning = np.where(k % 2, 100 * shares, 0.0), np.where(k % 2, 0.0, 100 * shares)
    exact = np.column_stack([k, omega / (2 * np.pi), 50 * beta * omega, sideways, turning])
    yield true("and in the printed table, in Hz and %", np.allclose(rows, exact, rtol=5e-3, atol=0.06))
    pole = found.poles[np.argmin(np.abs(found.poles - 1j * omega[0]))]
    said = re.findall(r"^ *([\d.]+) +([\d.]+) +-([\d.]+) +decays +beam mode 1$", str(found), re.M)
    exact = [abs(pole) / (2 * np.pi), -100 * pole.real / abs(pole), -pole.real]
    yield alike("its poles there: Hz, % and 1/s: relative error", 1e-3, np.array(said, float).ravel(), exact)
    middle = np.abs(MassPoints(load_preset("paper").replace(damped)).shapes(0.0) @ found.shape[:, :4])
    exact = np.where(k % 2, np.sqrt(2 / (RHO * LENGTH)), 0.0)
    statement = "modes: odd shapes, √(2/m) sin, are √(2/m) at mid-span, even ones 0: relative error"
    yield alike(statement, 5e-3, middle, exact)
    size = np.hypot(found.poles.real, found.poles.imag)
    told = np.stack([found.pole_frequency, found.pole_damping_ratio], axis=1)[size > 0]
    exact = np.stack([size / (2 * np.pi), -np.cos(np.angle(found.poles))], axis=1)[size > 0]
    yield alike("poles: |p|/2π and cosine of the angle to the negative axis: relative error", 1e-12, told, exact)


class _Pd:
    """PD, which holds and squeezes the payload in unequal arms under gravity: its rest point and its small motions."""

    def __init__(self) -> None:
        law = {"kind": "pd", "position_gain": tuple(np.diag(SPRINGS)), "velocity_gain": tuple(np.diag(DAMPERS))}
        law |= {"load_share": SHARE, "wanted_internal_force": SQUEEZE}
        self.scenario = load_preset("paper").replace({**UNEQUAL, "gravity": 9.81, "controller": law})
        self._points = points = MassPoints(self.scenario)
        n = 3 + points.shapes(0.0).size
        self.onto = np.eye(n)[:, :3]
        p = np.concatenate([HELD, np.zeros(n - 3)])
        for _ in range(9):  # The bent beam's weight hardly turns the payload.
            pull = self._weight(p)
            p[:3] = HELD + np.linalg.solve(SPRINGS, [0.0, 9.81 * RHO * LENGTH, 0.0] - pull[:3])
            p[3:] -= np.linalg.solve(points.bending, pull[3:])
        self.rest, self.torque = p[:3], self._law(p[:3])
        J = np.hstack([slopes(partial(points.joint_angles, index=arm), self.rest) for arm in range(2)])
        self.by_torque = self.onto @ J
        self._mass, self._damping = points.inertia(p), np.zeros((n, n))
        self._damping[3:, 3:] = DAMPING * np.eye(n - 3)
        self._stiffness = -slopes(self._force, p)
        # The inputs of both arms turn with their torques.
        shares = np.vstack([SHARE * DAMPERS, (1 - SHARE) * DAMPERS])
        turned = [np.linalg.inv(J[:, :3]), np.linalg.inv(J[:, 3:])]
        self._by_rate = -np.vstack([turned[0] @ shares[:3], turned[1] @ shares[3:]])
        self._by_pose = slopes(self._law, self.rest).T

    def _weight(self, p: np.ndarray) -> np.ndarray:
        return slopes(lambda at: np.array(self._points.payload_potential(at)), p)

    def _law(self, x: np.ndarray) -> np.ndarray:
        """Joint torques (6,) at rest at x."""
        common = SPRINGS @ (np.array(HELD) - x) + [0.0, 9.81 * RHO * LENGTH, 0.0]
        along = SQUEEZE * np.array([np.cos(x[2]), np.sin(x[2]), 0.0])
        G = [slopes(lambda at, arm=arm: np.array(self._points.arm_potential(at, arm)), x) for arm in range(2)]
        u = np.array([G[0] + SHARE * common + along, G[1] + (1 - SHARE) * common - along])
        return joint_torques(self._points, x, u).ravel()

    def _force(self, p: np.ndarray) -> np.ndarray:
        """Force on p under the torques that hold the rest point."""
        J = [slopes(partial(self._points.joint_angles, index=arm), p[:3]) for arm in range(2)]
        whole = slopes(lambda at: np.array(self._points.potential(at)), p)
        return self.onto @ np.hstack(J) @ self.torque - whole

    def plant(self, s: complex) -> np.ndarray:
        """M s² + D s + K under held torques."""
        return self._mass * s**2 + self._damping * s + self._stiffness

    def law(self, s: complex) -> np.ndarray:
        """Joint torques that the law asks for, by the pose, (6, 3)."""
        return self._by_pose + s * self._by_rate

    def deviation(self, omega: float) -> np.ndarray:
        """(S - T)/2 at the motors, (6, 6)."""
        H = self.law(1j * omega) @ np.linalg.solve(self.plant(1j * omega), self.by_torque)[:3]
        return np.linalg.solve(np.eye(6) - H, np.eye(6) + H) / 2


def _pd() -> Iterator[Check]:
    """PD at a tilted pose of unequal arms: M p̈ + (D + K_d) ṗ + (K + K_p) p = f, of mass points in nodal coordinates."""
    pd = _Pd()
    model = linearize(pd.scenario, HELD, INPUTS, ("pose", "midspan_deflection"), closed=True)
    yield below(
        "linearize: PD rests where weight and springs balance: difference, m or rad", 1e-9, model.about.pose - pd.rest
    )
    statement = "and by torques that carry the weight and squeeze the payload: relative error"
    yield alike(statement, 1e-8, model.about.torque.ravel(), pd.torque)
    shown = np.vstack([pd.onto.T, np.concatenate([np.zeros(3), MassPoints(pd.scenario).shapes(0.0)])])
    told, exact = model.response(TRIED), []
    for s in TRIED:
        answer = np.linalg.inv(pd.plant(s) - pd.by_torque @ pd.law(s) @ pd.onto.T)
        by = np.hstack([pd.onto, pd.onto, pd.by_torque, pd.onto @ SPRINGS, pd.onto @ DAMPERS])
        exact.append(shown @ answer @ by)
    scale = np.abs(exact).max(axis=(0, 2), keepdims=True)
    statement = (
        "linearize: pose and mid-span of PD by inputs, torques and targets are those of mass points: relative error"
    )
    yield below(statement, 1e-5, np.abs((told - exact) / scale))
    told = [np.linalg.inv(model.mass * s**2 + model.damping * s + model.stiffness)[:3, :3] for s in TRIED]
    exact_plant = [np.linalg.inv(pd.plant(s))[:3, :3] for s in TRIED]
    yield alike("and pose by forces, (M s² + C s + K)⁻¹, under held torques: relative error", 1e-4, told, exact_plant)
    factors = linearize(pd.scenario, HELD, "desired_pose_y", "pose_y").to_zpk()
    of_y = [factors.gain * np.prod(s - factors.zeros) / np.prod(s - factors.poles) for s in TRIED]
    yield alike(
        "zeros, poles and gain give the same: relative error", 1e-4, np.abs(of_y), np.abs(np.array(exact)[:, 1, 13])
    )
    # Factors (1 + δ/2)/(1 - δ/2) of the torques make the loop swing with ω if 1 - δ (S - T)/2 is singular.
    margin = model.disk_margin
    assert margin is not None
    least = 1 / max(np.abs(np.linalg.eigvals(pd.deviation(omega))).max() for omega in np.geomspace(1.0, 1e4, 2000))
    yield close("disk margin of all motors together: α", least, margin.alike.alpha, relative=1e-3)
    factor = (1 + np.array([-1, 1, 1j]) * margin.alike.alpha / 2) / (1 - np.array([-1, 1, 1j]) * margin.alike.alpha / 2)
    told = [*margin.alike.gain, margin.alike.phase]
    wanted = [*factor[:2].real, np.angle(factor[2], deg=True)]
    yield alike("the gains and the phase, °, that it tells of are those of real and imaginary δ", 1e-12, told, wanted)
    reached = margin.each.alpha * _unlike(pd.deviation(2 * np.pi * margin.each.frequency))
    yield close(
        "each motor with its own factor: least |δ| that is found to destabilise, over α", 1.0, 1 / reached, "", 0.1
    )


def _alone() -> Check:
    """One arm under PD, level, so that the beam's bend gives its weight no further arm."""
    law = {"controller.kind": "pd", "gravity": 9.81, "trajectory": {"kind": "hold", "pose": CENTER}}
    found = modes(load_preset("single-arm").replace(law)).pose
    return below("PD of one arm carries the whole weight: rest point less target, m or rad", 1e-9, found - CENTER)


def _unlike(deviation: np.ndarray) -> float:
    """Largest |λ| of `deviation` with motors that differ in phase, found one phase after another."""
    turns = np.exp(2j * np.pi * np.arange(24) / 24)
    phases = np.ones(len(deviation), complex)
    for _ in range(6):
        for motor in range(len(phases)):
            tried = np.tile(phases, (len(turns), 1))
            tried[:, motor] = turns
            sizes = np.abs(np.linalg.eigvals(tried[:, :, None] * deviation)).max(axis=1)
            phases = tried[int(np.argmax(sizes))]
    return float(np.abs(np.linalg.eigvals(phases[:, None] * deviation)).max())


def _ring() -> Iterator[Check]:
    """A ring of known frequency and damping on a slow background, and the beam that rings so."""
    scenario = load_preset("paper").replace({"payload.damping": {"kind": "modal", "ratio": 0.1}})
    t, omega = np.arange(2000) * 5e-4, np.sqrt(MassPoints(scenario).softest() * SOUGHT / EI)
    ring = np.exp(-RATIO * omega * t) * np.cos(omega * np.sqrt(1 - RATIO**2) * t + 0.4)
    found = fit_ring(t, 1e-3 * (ring + 0.2 + 0.1 * t))
    parameters = beam_parameters(found, scenario, in_loop=False)
    yield close("identified: frequency of a ring", omega / (2 * np.pi), found.first.frequency.value, "Hz", 1e-6)
    yield close("identified: amplitude", 1e-3, found.first.amplitude, "m", 1e-6)
    yield close("identified: bending stiffness", SOUGHT, parameters.bending_stiffness.value, "N·m²", 1e-5)
    yield close("identified: damping ratio", RATIO, parameters.damping.value, "", 1e-5)
    told, exact = re.findall(r"has ([\d.]+) N·m²", mesh_note(parameters)), RHO * (omega * LENGTH**2 / np.pi**2) ** 2
    statement = "and stiffness of a real beam that rings so, ρ(ωL²/π²)²"
    yield close(statement, exact, float(told[0]) if told else np.nan, "N·m²", 1e-4)
    cure = remedies(found, scenario)
    assert cure is not None
    # An error d of the frequency leaves sin(πd/2), its square, and |0.475 - 0.525 cos πd| of the vibration: here 5 %.
    late = np.array([1, 2, 2]) * np.pi / (omega * np.sqrt(1 - RATIO**2))
    band = np.array([np.arcsin(0.05), np.arcsin(0.05**0.5), np.arccos(0.85 / 1.05) / 2]) * 2 / np.pi
    told = np.array([(each.delay, each.band) for each in cure.shapers]).T
    yield alike("zv, zvd and ei-shaper for the ring: their delays: relative error", 1e-5, told[0], late)
    yield below("and bands, within which they leave 5 %: error", 1e-3, told[1] - band)
    gain = 2 * (0.1 - RATIO) * omega / (8 / np.pi**2 * RHO * LENGTH)
    yield close("lateral gain that damps it with ζ = 0.1, 2 (0.1 - ζ)ω/(8m/π²)", gain, cure.gain, "1/(kg·s)", 5e-3)
    yield from _in_loop()


def _in_loop() -> Iterator[Check]:
    """The ring of a beam in arms that give way under the paper's law, by a pole of mass points."""
    paper, t = load_preset("paper"), np.arange(2000) * 5e-4
    pole = loop_pole(MassPoints(paper))
    found = fit_ring(t, np.exp(pole.real * t) * np.cos(pole.imag * t + 0.4))
    guess = paper.replace({"payload.bending_stiffness": 80.0, "payload.damping.coefficient": 0.2})
    told = beam_parameters(found, guess, in_loop=True, poses=ELSEWHERE)
    both = told.bending_stiffness
    yield close("identified in the loop: bending stiffness", EI, both.value, "N·m²", 1e-5)
    yield close("identified in the loop: damping", DAMPING, told.damping.value, "N·s/m", 1e-4)
    alone = beam_parameters(found, guess, in_loop=True, poses=ELSEWHERE[1:]).bending_stiffness.value
    statement = "and the interval of a ring at two poses reaches up to what the other one gives: by"
    yield close(statement, alone - both.value, both.high - both.value, "N·m²", 0.05)


def _intervals() -> Iterator[Check]:
    """95 % intervals of noisy rings: Student's t times the bound of Cramér and Rao, and as wide as the estimates scatter.

    Noise with a memory or a frequency that changes widens them.
    """
    scenario = load_preset("paper").replace({"payload.damping": {"kind": "stiffness", "coefficient": 1e-4}})
    t, omega = np.arange(400) * 2e-3, np.sqrt(MassPoints(scenario).softest() * SOUGHT / EI)

    def signal(p: np.ndarray) -> np.ndarray:
        w, ratio, size, phase = 2 * np.pi * p[0], *p[1:4]
        ring = size * np.exp(-ratio * w * t) * np.cos(w * np.sqrt(1 - ratio**2) * t + phase)
        return ring + p[4] + p[5] * t + p[6] * t**2

    exact = np.array([omega / (2 * np.pi), RATIO, 1.0, 0.4, 0.2, 0.1, 0.0])
    white = _Noisy(t, signal, exact, 0.0, DRAWS)
    statement = "intervals of frequency and damping ratio: half their width by t times Cramér and Rao's bound"
    yield below(f"{statement}: error", 0.03, white.width - 1)
    yield close("their estimates scatter by that bound, as a part", 1.0, white.scatter, absolute=0.3)
    # EI grows as f², and β of C = βK_F is 2ζ/ω.
    (f, wide), (_, high) = white.told[0]
    beam = beam_parameters(white.fits[0], scenario, in_loop=False)
    for name, found, expected in (
        ("EI", beam.bending_stiffness, 2 * wide / f * beam.bending_stiffness.value),
        ("β", beam.damping, high / (np.pi * f)),
    ):
        yield close(f"width of the interval of {name}, in SI units", expected, found.high - found.low, relative=1e-3)
    coloured = _Noisy(t, signal, exact, MEMORY, FEWER)
    yield close("in noise with a memory estimates scatter by its bound, as a part", 1.0, coloured.scatter, absolute=0.3)
    yield above(
        "half the width of their intervals by t times it, as the ring's halves differ", 1.2, coloured.width.min()
    )
    yield below("and at most", 5.0, coloured.width.max())
    yield from _changing(t, omega / (2 * np.pi))


class _Noisy:
    """Fits of a ring `signal(exact)` at `t`, s, in noise of which each value keeps the part `memory` of the one before."""

    def __init__(
        self, t: np.ndarray, signal: Callable[[np.ndarray], np.ndarray], exact: np.ndarray, memory: float, draws: int
    ):
        covariance = NOISE**2 * memory ** np.abs(np.subtract.outer(np.arange(len(t)), np.arange(len(t))))
        J, root, noise = slopes(signal, exact), np.linalg.cholesky(covariance), np.random.default_rng(5)
        bound = np.sqrt(np.diag(np.linalg.inv(J @ np.linalg.solve(covariance, J.T))))[:2]
        self.fits = [fit_ring(t, signal(exact) + root @ noise.standard_normal(len(t))) for _ in range(draws)]
        self.told = np.array([[(each.value, each.high - each.low) for each in _of_first(fit)] for fit in self.fits])
        """Value and width of frequency, Hz, and damping ratio, (draws, 2, 2)."""
        self.width = self.told[:, :, 1].mean(axis=0) / (2 * T_95 * bound)
        self.scatter = float(np.sqrt(np.mean(((self.told[:, :, 0] - exact[:2]) / bound) ** 2)))


def _changing(t: np.ndarray, f: float) -> Iterator[Check]:
    """The ring of a frequency that rises evenly: its phase in either half of its energy gives that half's frequency."""
    phase = 2 * np.pi * (f * t + RISE / 2 * t**2)
    size = np.exp(-RATIO * 2 * np.pi * f * t)
    middle = int(np.searchsorted(np.cumsum(size**2), np.sum(size**2) / 2))
    first, second = (
        np.polyfit(t[part], phase[part], 1, w=size[part])[0] / (2 * np.pi)
        for part in (slice(middle), slice(middle, None))
    )
    found = fit_ring(t, size * np.cos(phase + 0.4))
    told, (low, high) = found.first.frequency, found.halves or (np.nan, np.nan)
    yield close(
        "a frequency that rises is told: difference of the ring's halves",
        second - first,
        high - low,
        "Hz",
        relative=0.1,
    )
    yield true(
        "one mode rings, and its interval holds both halves",
        told.low < first < second < told.high and len(found.modes) == 1,
    )


def _of_first(fit: RingFit) -> tuple[Estimate, Estimate]:
    return fit.first.frequency, fit.first.damping_ratio
