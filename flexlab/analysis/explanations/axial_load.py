"""Where the paper's beam ends: pressed as much as buckles it, or spun as fast as it rings."""

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import register
from flexlab.sim.axial_warning import axial_warning
from flexlab.sim.row_survey import Survey


@register("axial load", "P_cr = c π²EI/L²; K_G = ∫N N'ᵀN' ds", "Axial load beside P_cr", 6)
def axial_load(seen: Evidence) -> str | None:
    """The model of the beam leaves out, or ends with, what the force along it does."""
    samples = seen.samples
    peaks = Survey(load_share=float(samples.axial_load_share.max()), spin_share=float(samples.spin_share.max()))
    return axial_warning(seen.scenario.payload, peaks).text or None
