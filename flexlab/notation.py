"""The symbol table: each symbol of the paper has one name in code and one word on the screen.

Physics and control use the code names, configuration and screen the words. Equation numbers are those of Zhang & Li;
symbols without one are this project's own. Shapes: n_q nodal coordinates of the beam, n_m modes of it.
"""

from typing import NamedTuple


class Symbol(NamedTuple):
    """One row of the table."""

    symbol: str
    """As printed, in Unicode."""
    code: str
    """Name in `flexlab.physics`, `flexlab.control` and the table of signals; `NOT_FORMED` if the code needs no such thing."""
    word: str
    """Name in scenarios, samples and on the screen."""
    unit: str
    """SI; three units for (x, y, θ)."""
    shape: str
    """() for a number."""
    equation: str
    """Where the paper introduces it; empty if the paper does not."""


NOT_FORMED = "–"
"""Code name of a symbol that stands only in the paper: the code computes what follows from it directly."""
POSE, RATE, FORCE = "m, m, rad", "m/s, m/s, rad/s", "N, N, N·m"
INERTIA = "kg, kg·m, kg·m²"

MOTION = (
    Symbol("t", "t", "time", "s", "()", ""),
    Symbol("x", "x", "pose", POSE, "(3,)", "(8)"),
    Symbol("ẋ", "v", "pose rate", RATE, "(3,)", "(8)"),
    Symbol("ẍ", "x_ddot", "pose acceleration", "m/s², m/s², rad/s²", "(3,)", "(8)"),
    Symbol("θ", "theta", "angle of the virtual link", "rad", "()", "(1)"),
    Symbol("ω", "w", "turning rate of the virtual link", "rad/s", "()", "(1)"),
    Symbol("x_d", "desired[0]", "desired pose", POSE, "(3,)", "Section IV"),
    Symbol("e", "tracking_error", "tracking error", POSE, "(3,)", "Section III"),
    Symbol("p", NOT_FORMED, "coordinates of pose and beam", "m, rad", "(3 + n_q,)", "(8)"),
)
"""Where the payload is and should be."""

BEAM = (
    Symbol("L", "length", "beam length", "m", "()", "(1)"),
    Symbol("ρ", "rho", "mass per length", "kg/m", "()", "(5)"),
    Symbol("EI", "EI", "bending stiffness", "N·m²", "()", "(6)"),
    Symbol("t_b", "thickness", "beam thickness", "m", "()", ""),
    Symbol("m", "m", "payload mass", "kg", "()", "(9)"),
    Symbol("I", "I", "payload inertia", "kg·m²", "()", "(9)"),
    Symbol("n", "n", "element count", "1", "()", "Section II"),
    Symbol("N", "N", "shape functions", "1, m", "(n_q,)", "(4)"),
    Symbol("w", "w", "deflection", "m", "()", "(3)"),
    Symbol("w_qs", "quasi_static_deflection", "quasi-static deflection", "m", "()", ""),
    Symbol("q", "q", "beam coordinates", "m, rad", "(n_q,)", "(3)"),
    Symbol("q̇", "q_dot", "beam rates", "m/s, rad/s", "(n_q,)", "(8)"),
    Symbol("h", "h", "lateral coupling", "kg, kg·m", "(n_q,)", "(9)"),
    Symbol("g", "g", "turning coupling", "kg·m, kg·m²", "(n_q,)", "(9)"),
    Symbol("w̄", "w_bar", "first moment of the deflection", "kg·m", "()", "(9)"),
    Symbol("M_q", "M_q", "beam mass matrix", INERTIA, "(n_q, n_q)", "(10)"),
    Symbol("K_F", "K_F", "beam stiffness matrix", "N/m, N, N·m", "(n_q, n_q)", "(10)"),
    Symbol("D", "D", "beam damping matrix", "N·s/m, N·s, N·m·s", "(n_q, n_q)", ""),
    Symbol("Ω", "omega", "beam frequencies", "rad/s", "(n_m,)", ""),
    Symbol("V", "V", "mode shapes, mass-normalised", "kg^-½", "(n_q, n_m)", ""),
    Symbol("η", "eta", "modal coordinates", "m·kg^½", "(n_m,)", ""),
    Symbol("π", "pi", "modal momenta", "m·kg^½/s", "(n_m,)", ""),
)
"""The flexible payload."""

SYSTEM = (
    Symbol("A", "A", "payload inertia matrix", INERTIA, "(3 + n_q, 3 + n_q)", "(8)"),
    Symbol("B", "B", "payload velocity matrix", "kg/s, kg·m/s, kg·m²/s", "(3 + n_q, 3 + n_q)", "(8)"),
    Symbol("P", "P", "momentum of the pose", "kg·m/s, kg·m/s, kg·m²/s", "(3,)", ""),
    Symbol("S", "S", "inertia that the pose feels", INERTIA, "(3, 3)", "(19)"),
    Symbol("φ_i", NOT_FORMED, "angle of an arm's last link", "rad", "()", ""),
    Symbol("θ_i", "joint_angles", "joint angles", "rad", "(3,)", "(11)"),
    Symbol("J_i", NOT_FORMED, "pose rate to grip velocity", "1, m", "(3, 3)", "(12)"),
    Symbol("𝒥_i", "J", "pose rate to joint rates", "1/m, 1", "(3, 3)", "(12)"),
    Symbol("M̄_i", "M", "arm inertia seen by the pose", INERTIA, "(3, 3)", "(13)"),
    Symbol("C̄_i", "C", "arm velocity matrix seen by the pose", "kg/s, kg·m/s, kg·m²/s", "(3, 3)", "(13)"),
    Symbol("Ḡ_i", "G", "arm weight seen by the pose", FORCE, "(3,)", "(13)"),
    Symbol("u_i", "u", "arm input", FORCE, "(3,)", "(13)"),
    Symbol("τ_i", "tau", "joint torque", "N·m", "(3,)", "(11)"),
    Symbol("f_i", "grip", "grip force", FORCE, "(3,)", "(11)"),
    Symbol("f", "moving", "moving force on the payload", FORCE, "(3,)", "(7)"),
    Symbol("F_i", "force", "internal force", FORCE, "(3,)", "(15)"),
)
"""Arms and payload together."""

CONTROL = (
    Symbol("Λ", "Lambda", "sliding slope", "1/s", "(3,)", "Section III"),
    Symbol("r", "r", "reference rate", RATE, "(3,)", "Section III"),
    Symbol("s", "s", "sliding variable", RATE, "(3,)", "Section III"),
    Symbol("K", "K", "feedback gain", "N·s/m, N·m·s/rad", "(3,)", "(23)"),
    Symbol("ε", "epsilon", "boundary layer", "m/s", "()", "(23)"),
    Symbol("b̂", "b_hat", "bound estimates", "N, N/m, N·s²/m²", "(3,)", "(23)"),
    Symbol("k_i", "k", "adaptation", "m/N, m³/N, m⁵/(N·s⁴)", "(3,)", "(23)"),
    Symbol("Ψ", NOT_FORMED, "what the beam does to the pose", FORCE, "(3,)", "(22)"),
)
"""The controller of the paper."""

SYMBOLS = MOTION + BEAM + SYSTEM + CONTROL


def lookup(name: str) -> Symbol:
    """The row whose symbol, code name or word is `name` (symbols first). Raises KeyError."""
    found = [row for column in (0, 1, 2) for row in SYMBOLS if row[column] == name]
    if not found:
        raise KeyError(f"{name} is not in the symbol table")
    return found[0]
