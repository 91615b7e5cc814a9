"""Modes and poles as tables to read."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexlab.analysis.loop_poles import NEUTRAL

if TYPE_CHECKING:
    from flexlab.analysis.modes import Modes

MOST_ROWS = 16
"""Rows of a printed table: what decays faster than the first sixteen poles is seen by nobody."""


class PoleRow(NamedTuple):
    """A real pole, or a conjugate pair."""

    frequency: float
    """|pole|/2π of a pair, Hz; 0 of a real pole."""
    damping_ratio: float
    """-Re/|pole|."""
    rate: float
    """Real part, 1/s: negative decays."""
    origin: str
    """What it is of."""

    @property
    def verdict(self) -> str:
        """One of "grows", "stays" and "decays"."""
        if self.rate > NEUTRAL:
            return "grows"
        return "stays" if self.rate > -NEUTRAL else "decays"


def pole_rows(poles: np.ndarray, origin: Sequence[str], most: int | None = None) -> list[PoleRow]:
    """One row for each pole or pair: those that grow first, fastest first, then by magnitude."""
    rows = []
    for pole, name in zip(poles, origin, strict=True):
        if pole.imag >= 0:
            size = abs(pole)
            frequency = size / (2 * np.pi) if pole.imag > 0 else 0.0
            rows.append(PoleRow(frequency, -pole.real / size if size else 1.0, pole.real, name))
    growing = sorted((row for row in rows if row.verdict == "grows"), key=lambda row: -row.rate)
    return (growing + [row for row in rows if row.verdict != "grows"])[:most]


def sampling_text(control_period: float | None, input_delay: int) -> str:
    """As in "sampled at 1 ms, torques 1 sample late"; "continuous" without a control period."""
    if control_period is None:
        return "continuous"
    text = f"sampled at {1e3 * control_period:g} ms"
    return f"{text}, torques {input_delay} sample{'s' if input_delay > 1 else ''} late" if input_delay else text


def modes_text(modes: "Modes") -> str:
    """Modes and poles as aligned plain text."""
    lines = ["Beam with its grips held", "", *_beam_lines(modes), "", *_pole_lines(modes)]
    if modes.note:
        lines += ["", modes.note]
    return "\n".join(lines)


def _beam_lines(modes: "Modes") -> list[str]:
    rows = [("mode", "f (Hz)", "ζ (%)", "sideways (%)", "turning (%)")]
    for k, frequency in enumerate(modes.frequency[:MOST_ROWS]):
        shares = (modes.lateral_participation[k], modes.angular_participation[k])
        rows.append((f"{k + 1}", f"{frequency:.2f}", f"{100 * modes.damping_ratio[k]:.3g}", *map(_percent, shares)))
    lines = _aligned(rows)
    if len(modes.frequency) > MOST_ROWS:
        lines.append(f"… and {len(modes.frequency) - MOST_ROWS} higher modes")
    return lines


def _pole_lines(modes: "Modes") -> list[str]:
    loop = "sampled" if modes.control_period is not None else "continuous"
    detail = "" if modes.control_period is None else f", {sampling_text(modes.control_period, modes.input_delay)}"
    pose = ", ".join(f"{value:.4g}" for value in modes.pose)
    head = f"Poles of the {loop} loop{detail}, at rest at ({pose}) m, m, rad"
    everything = modes.pole_rows()
    if not everything:
        return [f"{head}: none"]
    rows = [("f (Hz)", "ζ (%)", "rate (1/s)", "", "of")]
    for row in everything[:MOST_ROWS]:
        frequency = f"{row.frequency:.2f}" if row.frequency else "–"
        verdict = row.verdict.upper() if row.verdict == "grows" else row.verdict
        rows.append((frequency, f"{100 * row.damping_ratio:.3g}", f"{row.rate:+.4g}", verdict, row.origin))
    lines = [head, "", *_aligned(rows)]
    if len(everything) > MOST_ROWS:
        lines.append(f"… and {len(everything) - MOST_ROWS} faster ones, none of which grows")
    if modes.unstable:
        lines += ["", f"UNSTABLE: small motions grow at {modes.growth:.3g} 1/s."]
    return lines


def _percent(share: float) -> str:
    return f"{100 * share:.1f}"


def _aligned(rows: list[tuple[str, ...]]) -> list[str]:
    """Columns of equal width, right-aligned but the last two of five when they are words."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    words = [not any(character.isdigit() for row in rows[1:] for character in row[k][:1]) for k in range(len(widths))]
    return [
        "  ".join(
            cell.ljust(width) if word and k > 2 else cell.rjust(width)
            for k, (cell, width, word) in enumerate(zip(row, widths, words, strict=True))
        ).rstrip()
        for row in rows
    ]
