"""A payload that takes up or loses material: a vessel that is filled, a beam from which something flows, evenly all along it.

Its density is ρ s(t), so that mass, inertia and weight all grow by s(t); bending stiffness EI and damping are the tube's and
stay. Material joins and leaves with the velocity of the place where it does so. It adds the momentum that it has there and no
other force: with A, B, U of the payload at the start

    d/dt(s A v) = F + ṡ A v      and so      s (A v̇ + B v + ∂U/∂p) + K_F q + D q̇ = F,

the equations of a payload with its present mass, whatever ṡ (Meshchersky's without relative velocity). The energy grows by the
work of the motors and by ½ ṡ vᵀA v + ṡ U of the added material. In the state of `physics.plant` π stays the beam's momentum per
unit of s, π = η̇ + h v2 + g ω, and P is the whole momentum, so that

    P = (M̄1 + M̄2 + s (A11 - A12 A21)) ẋ + s A12 π,      Ṗ = … + ṡ (A11 ẋ + A12 η̇),      π̇ = -(Ω²η + Dη̇ + K_G η)/s + …

s goes from 1 to `factor` by 10u³ - 15u⁴ + 6u⁵, u = (t - begin)/duration, which has no jump in its second derivative. If the
mass is constant, `Plant.mass_change` is None, and the loop is compiled without all this.
"""

from typing import NamedTuple

from flexlab.compiled import compiled, inlined

FACTOR, RATE = 0, 1
"""Places of s, 1, and ṡ, 1/s, in `Workspace.mass_factor`."""


class MassChange(NamedTuple):
    """How the payload's mass changes."""

    factor: float
    """Mass afterwards over mass at the start, 1."""
    begin: float
    """Instant at which the change begins, s."""
    duration: float
    """Duration of the change, s."""


@inlined
def mass_states(change):
    """Number of the material's states in y: 1, the energy that it added, J; 0 for a constant mass."""
    return 0 if change is None else 1


@inlined
def mass_factor(change, ws):
    """s, 1, at the instant of the last `find_mass`."""
    if change is None:
        return 1.0
    return ws.mass_factor[FACTOR]


@inlined
def find_mass(change, t, ws):
    """Store s and ṡ at the instant t, s, in ws.mass_factor."""
    if change is None:
        return
    u, more = (t - change.begin) / change.duration, change.factor - 1
    if u <= 0:
        ws.mass_factor[FACTOR], ws.mass_factor[RATE] = 1.0, 0.0
    elif u >= 1:
        ws.mass_factor[FACTOR], ws.mass_factor[RATE] = change.factor, 0.0
    else:
        ws.mass_factor[FACTOR] = 1 + more * (u * u * u * (10 - u * (15 - 6 * u)))
        ws.mass_factor[RATE] = more * (30 * u * u * (1 - u) * (1 - u)) / change.duration


@inlined
def believed_mass(change, part, ws):
    """s, 1, and ṡ/s, 1/s, at the instant of `find_mass`, for a controller that knows the share `part` of the change."""
    if change is None:
        return 1.0, 0.0
    factor = 1 + part * (ws.mass_factor[FACTOR] - 1)
    return factor, part * ws.mass_factor[RATE] / factor


@compiled
def _find_mass_at(change, t, ws):
    find_mass(change, t, ws)


def find_mass_at(plant, t: float, ws) -> float:
    """`find_mass` for Python, needed before kernels without a time argument, as momenta depend on s. Returns s, 1."""
    if plant.mass_change is None:
        return 1.0
    _find_mass_at(plant.mass_change, float(t), ws)
    return float(ws.mass_factor[FACTOR])


def note_lightest(plant, ws) -> float:
    """Set s in ws to its least value in a run, where the beam's modes are fastest, as if it were constant; return it, 1."""
    if plant.mass_change is None:
        return 1.0
    ws.mass_factor[:] = min(1.0, plant.mass_change.factor), 0.0
    return float(ws.mass_factor[FACTOR])


def build_mass_change(change) -> MassChange | None:
    """`Plant.mass_change` of a payload's `mass_change`."""
    return MassChange(change.factor, change.begin, change.duration) if change.active else None
