"""Paths by their formulas, rates and limits, with smooth start, input shapers and bending feedforward."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, make_interp_spline

from flexlab.analysis.modes import modes, rings_of
from flexlab.analysis.validation.check import Check, Runs, above, alike, below, close, run_of, subject
from flexlab.analysis.validation.mass_points import MassPoints
from flexlab.control.motion import DesiredMotion, desired_motions, residual
from flexlab.control.path import paths
from flexlab.control.paths.table import spline
from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.target import build_trajectory, change_path
from flexlab.sim.world import World

WINDOW = 1.6
"""Length of each path that is checked, s."""
STEP = 1e-4
"""Step of differences along a path, s."""
CLEAR = 4 * STEP
"""Time before and after jumps of acceleration or jerk in which no differences are taken, s."""
CHANGED_AT = 370
"""Tick at which a path is changed in motion."""
BEGIN = 0.25
"""Time at which some paths begin, s."""
FREQUENCY, RATIO = 9.0, 0.06
"""Frequency, Hz, and ζ of the mode for which shapers are designed."""
VIBRATION = 0.05
"""V of the extra-insensitive shaper."""
RESIDUALS: dict[str, Callable[[float], float]] = {
    "zv": lambda c: c,
    "zvd": lambda c: c * c,
    "ei-shaper": lambda c: (1 + VIBRATION) * c * c - VIBRATION,
}
"""Shaper → residual vibration of an undamped mode, as a function of cos(π/2 · frequency of mode / of shaper)."""
TURNING = [(0.2 + 0.15 * k, 0.02 * (-1) ** k, 0.7 + 0.02 * k, 0.1 - 0.01 * k * k) for k in range(7)]
"""Rows of a table that begins after its t = 0 and moves at both ends."""
OWN: dict[str, dict[str, Any]] = {
    "sine": {"phase": (0.3, 0.0, -1.0), "frequency": (1.0, 0.7, 2.0), "amplitude": (0.1, 0.05, 0.2)},
    "rest-to-rest": {"start": 0.2, "duration": 0.9, "to": (0.1, 0.85, 0.3)},
    "bang-bang": {"start": 0.2, "duration": 0.9, "to": (0.1, 0.85, 0.3)},
    "circle": {"phase": 0.4},
    "figure-eight": {"phase": 0.4, "amplitude": (0.15, 0.1, 0.2)},
    "table": {"start": 0.1, "ends": "free", "rows": TURNING},
}
"""Path → fields that differ from their defaults."""


def _line(share: Callable[[np.ndarray], np.ndarray]) -> Callable[[Any, np.ndarray], np.ndarray]:
    def pose(path: Any, t: np.ndarray) -> np.ndarray:
        first, last = np.array(getattr(path, "from")), np.array(path.to)
        tau = np.clip((t - path.start) / path.duration, 0, 1)
        return first + (last - first) * share(tau)[:, None]

    return pose


def _round(path: Any, t: np.ndarray, radii: np.ndarray, times: np.ndarray, quarter: np.ndarray) -> np.ndarray:
    angle = 2 * np.pi * path.frequency * t + path.phase
    return np.array(path.center) + radii * np.sin(angle[:, None] * times + quarter * np.pi / 2)


POSES: dict[str, Callable[[Any, np.ndarray], np.ndarray]] = {
    "sine": lambda path, t: (
        np.array(path.center) + np.array(path.amplitude) * np.sin(2 * np.pi * np.outer(t, path.frequency) + path.phase)
    ),
    "rest-to-rest": _line(lambda tau: 10 * tau**3 - 15 * tau**4 + 6 * tau**5),
    "bang-bang": _line(lambda tau: np.where(tau < 0.5, 2 * tau**2, 1 - 2 * (1 - tau) ** 2)),
    "circle": lambda path, t: _round(
        path, t, np.array([path.radius, path.radius, 0.0]), np.ones(3), np.array([1.0, 0.0, 0.0])
    ),
    "figure-eight": lambda path, t: _round(path, t, np.array(path.amplitude), np.array([1.0, 2.0, 1.0]), np.zeros(3)),
    "hold": lambda path, t: np.tile(np.array(path.pose), (len(t), 1)),
}
"""Path → x_d at instants (N,), (N, 3)."""


@subject("Paths and input shapers", 7)
def paths_and_shapers(_: Runs) -> Iterator[Check]:
    """Formulas, rates, tables, smooth start, shapers, bending feedforward."""
    times = np.linspace(0.011, WINDOW - 0.01, 211)
    for kind, known in paths().items():
        if known.model.__module__.startswith("flexlab.control.paths."):
            path, motion = motion_of(kind)
            found = poses(motion, times)
            if kind in POSES:
                yield below(
                    f"{kind}: x_d by its formula: largest error, m, rad", 1e-13, found[:, 0] - POSES[kind](path, times)
                )
            yield from _rates(kind, times, kind)
            yield from _outline(kind)
    shaped = {"smooth_start": 0.8, "shaper": "zvd", "shaper_frequency": 9.0}
    yield from _rates("a sine with smooth start and shaper", times, "sine", **shaped)
    yield from _table()
    yield from _smooth_start(times)
    yield from _shapers(times)
    yield from _fed_forward()
    yield from _changed()
    yield from _kept()


def poses(motion: DesiredMotion, times: Any) -> np.ndarray:
    """x_d, ẋ_d, ẍ_d at times (N,), (N, 3, 3); what the path does not fill is NaN."""
    found = np.full((len(times), 3, 3), np.nan)
    desired_motions(motion, np.asarray(times, float), found)
    return found


def motion_of(kind: str, **changes: Any) -> tuple[Any, Any]:
    """A path in the paper's scenario, and the desired motion built from it."""
    scenario = load_preset("paper").replace({"trajectory": {"kind": kind, **OWN.get(kind, {}), **changes}})
    return scenario.trajectory, build_trajectory(scenario)


def _rates(words: str, times: np.ndarray, kind: str, **changes: Any) -> Iterator[Check]:
    """ẋ_d and ẍ_d against differences of x_d and ẋ_d, except near jumps."""
    path, motion = motion_of(kind, **changes)
    found = poses(motion, times)
    jumps = np.array([*path.discontinuities, *motion.discontinuities, np.inf])
    clear = np.abs(times[:, None] - jumps).min(axis=1) > CLEAR
    for order, name in ((1, "ẋ_d"), (2, "ẍ_d")):
        before = poses(motion, (times[:, None] + STEP * np.array([-2, -1, 1, 2])).ravel())[:, order - 1]
        a, b, c, d = np.moveaxis(before.reshape(len(times), 4, 3), 1, 0)
        slope = (8 * (c - b) - (d - a)) / (12 * STEP)
        error = np.abs(found[:, order] - slope)[clear].max() / max(float(np.abs(slope[clear]).max()), 1.0)
        yield below(f"{words}: {name} is its rate of change: relative error", 1e-7, error)


def _outline(kind: str) -> Iterator[Check]:
    """The middle, reach and largest acceleration that a path states, against its poses."""
    path, motion = motion_of(kind)
    found = poses(motion, np.linspace(*path.window, 20_001))
    low, high = found[:, 0].min(axis=0), found[:, 0].max(axis=0)
    stated = np.array([path.middle, path.reach])
    statement = f"{kind}: stated middle and reach: largest error, m, rad"
    yield below(statement, 1e-4, stated - [(low + high) / 2, (high - low) / 2])
    peak = np.abs(found[:, 2]).max(axis=0)
    error = np.abs(np.array(path.peak_acceleration) - peak) / max(float(peak.max()), 1.0)
    yield below(f"{kind}: stated largest acceleration: relative error", 1e-4, error)


def _changed() -> Iterator[Check]:
    """A change of the path in motion: the target goes on without a jump and is the new path's after the transition."""
    world = World(load_preset("paper"))
    world.advance(CHANGED_AT)
    now = CHANGED_AT * world.tick_period
    before = poses(world.system.trajectory, [now])
    world.apply(ChangeScenario({"trajectory": {"kind": "circle", "radius": 0.05}}))
    trajectory, new = world.system.trajectory, build_trajectory(world.scenario.anew())
    statement = "a path changed in motion: x_d, ẋ_d and ẍ_d do not jump: relative error"
    yield alike(statement, 1e-12, poses(trajectory, [now]), before)
    begin, duration = world.scenario.trajectory.transition.time, world.scenario.trajectory.transition.duration
    within = begin + duration * np.array([0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0, 1.2])
    left = poses(trajectory, within) - poses(new, within)
    fade = BPoly.from_derivatives([begin, begin + duration], [(before - poses(new, [now]))[0], np.zeros((3, 3))])
    exact = np.stack([fade(within), fade.derivative()(within), fade.derivative(2)(within)], axis=1)
    exact[within >= begin + duration] = 0.0
    statement = "and what is left of the old path fades as a polynomial of degree 5, with its rates: relative error"
    yield alike(statement, 1e-12, left, exact)


def _kept() -> Iterator[Check]:
    """What a change in motion makes of a path: a periodic one keeps its angle, any other begins now, at the target."""
    now, begin, sine = 0.3702, 0.37, motion_of("sine")[0]
    here, there = POSES["sine"](sine, np.array([now, now + 0.25 / min(sine.frequency)])).tolist()
    points, slower = np.array(motion_of("waypoints")[0].points), (0.8, 0.7, 1.1)
    by_frequency = np.array(sine.phase) + 2 * np.pi * now * np.subtract(sine.frequency, slower)
    moved = points + sine.center - (points.max(axis=0) + points.min(axis=0)) / 2
    for kind, changes, wanted in (
        ("sine", {"frequency": slower}, {"frequency": slower, "phase": by_frequency.tolist()}),
        ("circle", {"frequency": 1.6}, {"frequency": 1.6, "phase": 0.4 - 2 * np.pi * 0.6 * now}),
        ("waypoints", {"velocity_limit": 0.5}, {"velocity_limit": 0.5, "start": begin}),
        ("waypoints", {"smooth_start": 0.3}, {"smooth_start": 0.3}),
        ("table", {"rows": TURNING}, {"rows": TURNING, "start": begin}),
        ("sine", {"kind": "rest-to-rest"}, {"kind": "rest-to-rest", "from": here, "to": there, "start": begin}),
        ("sine", {"kind": "hold"}, {"kind": "hold", "pose": here}),
        ("sine", {"kind": "circle"}, {"kind": "circle", "center": sine.center}),
        ("sine", {"kind": "waypoints"}, {"kind": "waypoints", "points": moved.tolist(), "start": begin}),
        ("sine", {"kind": "table", "rows": TURNING}, {"kind": "table", "rows": TURNING, "start": begin}),
    ):
        old = load_preset("paper").replace({"trajectory": {"kind": kind, **OWN.get(kind, {})}})
        new = change_path(old, {f"trajectory.{name}": value for name, value in changes.items()}, now)
        kept = {} if "kind" in changes else {"kind": kind, **OWN.get(kind, {})}
        exact = build_trajectory(load_preset("paper").replace({"trajectory": {**kept, **wanted}}))
        later = now + np.linspace(0.0, WINDOW, 50)
        words = (
            f"becomes {changes['kind']}"
            if "kind" in changes
            else f"gets another {next(iter(changes)).replace('_', ' ')}"
        )
        statement = f"{kind} that {words} in motion: how x_d goes on: largest error, m, rad"
        yield below(statement, 1e-12, (poses(build_trajectory(new), later) - poses(exact, later))[:, 0])
    turned = {"kind": "sine", "amplitude": (0.1, 0.1, 5.0), "frequency": 1.0, "phase": np.pi / 2 - 2 * np.pi * now}
    new = change_path(load_preset("paper").replace({"trajectory": turned}), {"trajectory.kind": "circle"}, now)
    statement = "a circle in place of a sine that has turned by 5 rad: the angle that it holds, the next whole turn"
    yield close(statement, 2 * np.pi, new.trajectory.center[2], "rad", absolute=1e-12)


def _table() -> Iterator[Check]:
    """Tables with uneven times, against SciPy's quintic splines."""
    t = np.linspace(0, 1.5, 31)
    t[1:-1] += 0.015 * np.sin(7 * np.arange(1, 30))
    given = np.column_stack([t, 0.1 * np.sin(3 * t), 0.75 + 0.05 * np.cos(4 * t), 0.2 * np.sin(2 * t)])
    between = np.linspace(0.0, 1.5, 211)
    at_rest = [[(order, np.zeros(3)) for order in (1, 2)]] * 2
    for ends, condition in (("at rest", at_rest), ("free", "not-a-knot")):
        _, motion = motion_of("table", rows=given.tolist(), ends=ends, start=BEGIN)
        exact = make_interp_spline(t, given[:, 1:], k=5, bc_type=condition)(between)
        yield below(
            f"table, {ends}: x_d is a quintic spline: largest error, m, rad",
            1e-12,
            poses(motion, BEGIN + between)[:, 0] - exact,
        )
        if ends == "at rest":
            still = poses(motion, [BEGIN, BEGIN + 1.5])[:, 1:]
            yield below("table: is at rest at both ends: largest rate and acceleration", 1e-9, still)
    given[-1, 1:] = given[0, 1:]
    exact = make_interp_spline(t, given[:, 1:], k=5, bc_type="periodic")(between)
    yield below(
        "and one that repeats is a periodic spline: largest error, m, rad",
        1e-12,
        spline(given, "round")(between) - exact,
    )


def _smooth_start(times: np.ndarray) -> Iterator[Check]:
    ramp = 0.8
    path, motion = motion_of("sine", smooth_start=ramp)
    x, weight = np.polynomial.legendre.leggauss(8)
    reached = np.minimum(times, ramp)
    tau = reached[:, None] * (1 + x) / 2 / ramp
    along = (10 * tau**3 - 15 * tau**4 + 6 * tau**5) @ weight * reached / 2 + np.maximum(times - ramp, 0)
    error = poses(motion, times)[:, 0] - POSES["sine"](path, along)
    statement = "a smooth start goes along the path at a speed that grows as 10τ³ - 15τ⁴ + 6τ⁵: error, m, rad"
    yield below(statement, 1e-13, error)
    motion = motion_of("bang-bang", smooth_start=ramp, start=0.1, duration=0.5)[1]
    jumps = np.subtract(*(poses(motion, motion.discontinuities + side) for side in (1e-9, -1e-9)))
    yield above("and steps end where its acceleration jumps: least jump, m/s²", 1.0, np.abs(jumps[:, 2, 1]).min())


def _shapers(times: np.ndarray) -> Iterator[Check]:
    root = np.sqrt(1 - RATIO**2)
    k, half = np.exp(-RATIO * np.pi / root), 1 / (2 * FREQUENCY * root)
    sizes = {
        "zv": np.array([1, k]) / (1 + k),
        "zvd": np.array([1, 2 * k, k * k]) / (1 + k) ** 2,
        "ei-shaper": np.array([(1 + VIBRATION) / 4, (1 - VIBRATION) * k / 2, (1 + VIBRATION) * k * k / 4]),
    }
    for shaper, size in sizes.items():
        path, motion = motion_of("circle", shaper=shaper, shaper_frequency=FREQUENCY, shaper_damping=RATIO)
        later = [POSES["circle"](path, np.maximum(times - j * half, 0)) for j in range(len(size))]
        wanted = np.tensordot(size / size.sum(), later, 1)
        error = poses(motion, times)[:, 0] - wanted
        yield below(f"{shaper}: x_d is Σ A_j x(t - t_j): largest error, m, rad", 1e-13, error)
        begun = np.resize(motion.discontinuities, len(size) - 1) - half * np.arange(1, len(size))
        yield below("and steps end where a copy begins: largest error, s", 1e-15, begun)
        for words, ratio in (("lower", np.sqrt(0.8)), ("higher", np.sqrt(1.2))):
            statement = f"{shaper}: leaves of an undamped mode whose stiffness is 20 % {words}, as a part"
            exact = abs(RESIDUALS[shaper](np.cos(np.pi * ratio / 2)))
            yield close(statement, exact, _left(shaper, ratio), absolute=1e-9)
    scenario = load_preset("paper").replace({"trajectory.shaper": "zv"})
    (first, _), (second, late) = build_trajectory(scenario).impulses
    yield close("a shaper is made for the closed loop's first mode, 45.5 Hz", 45.5, 0.5 / late, "Hz", relative=2e-3)
    decay = np.exp(rings_of(modes(scenario))[1].rate * late)
    yield close("and for its decay in the loop: second impulse over the first", decay, second / first, relative=1e-6)


def _left(shaper: str, ratio: float) -> float:
    """The residual vibration of an undamped mode with `ratio` times the shaper's frequency, as a share of the unshaped."""
    _, motion = motion_of("circle", shaper=shaper, shaper_frequency=FREQUENCY, shaper_damping=0.0)
    return residual(motion.impulses, 2 * np.pi * FREQUENCY * ratio)


def _fed_forward() -> Iterator[Check]:
    share, x, left = 0.7, (0.0, 0.75, 0.3), 0.3
    # Another phase, as the paper's sine has no acceleration at t = 0; and a beam without symmetry.
    later = {"trajectory.phase": (0.9, 0.5, 1.2), "initial.pose": x, "controller.load_share": left}
    later |= {"payload.boundary": "pinned-clamped", "initial.beam_coordinates": None}
    runs = [
        [
            run_of("bending fed forward", {**later, "trajectory.bending_feedforward": part, **clock}, 2e-3, 1e-3)
            for part in (0.0, share)
        ]
        for clock in ({}, {"controller.control_period": 1e-3})
    ]
    fed = runs[0][1]
    points = MassPoints(fed.scenario)
    A = points.payload_inertia(np.array([*x, *np.zeros(fed.beam_coordinates.shape[1])]))[:3, :3]
    acceleration = -0.2 * (2 * np.pi) ** 2 * np.sin(later["trajectory.phase"])
    force = share * (A - points.rigid_inertia(np.array(x))) @ acceleration
    found = [more.arm_input[0] - plain.arm_input[0] for plain, more in runs]
    statement = (
        "the bending's force fed forward is A12 A22⁻¹A21 ẍ_d, shared by the arms, also under a clock: relative error"
    )
    yield alike(statement, 1e-9, found, [np.outer([left, 1 - left], force)] * 2)
