"""B4: laws that take the beam for softer or stiffer, lighter or heavier than it is."""

from flexlab.analysis.leaderboard.case import Case, Variant
from flexlab.analysis.leaderboard.score import peak_error, rms_error, settled

WRONG = (-0.5, -0.2, 0.2, 0.5)
BELIEVED = {"EI": "controller.model.stiffness_factor", "ρ": "controller.model.linear_density_factor"}

CASE = Case(
    "B4",
    "Wrong EI and ρ",
    "B1 with a controller that believes in an EI or a ρ that is wrong by so much. The beam is the paper's throughout.",
    3.0,
    (rms_error((1.0, 3.0)), settled(), peak_error()),
    variants=tuple(
        Variant(f"{name} {wrong * 100:+.0f} %".replace("-", "−"), {path: 1 + wrong})
        for name, path in BELIEVED.items()
        for wrong in WRONG
    ),
)
