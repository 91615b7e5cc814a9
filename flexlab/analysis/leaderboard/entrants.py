"""The laws that enter, and with which settings: their declared defaults, and what is named here."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flexlab.control.law import Law, laws
from flexlab.errors import ScenarioError, StudyError
from flexlab.own.files import law_kind
from flexlab.scenario import Scenario
from flexlab.scenario.settings import PERIOD, change_settings, with_period_if_needed

SETTINGS: dict[str, dict[str, Any]] = {
    "composite-kalman": {"controller.kind": "composite", "controller.observer.kind": "kalman"},
    "composite-soft": {
        "controller.kind": "composite",
        "controller.slow.sliding_slope": 30.0,
        "controller.lateral_vibration_gain": 60.0,
    },
}
"""Laws that enter once more, otherwise set: an observer instead of measured rates; a slow part that is slow to soft beams."""

AnyLaw = str | Path | type


@dataclass(frozen=True)
class Entrant:
    """A law, as it enters all cases."""

    name: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    """What makes a scenario have this law, by path."""

    @property
    def kind(self) -> str:
        """Of the law."""
        return self.changes["controller.kind"]

    @property
    def law(self) -> Law:
        """As it is known now."""
        return laws()[self.kind]

    @property
    def settings(self) -> str:
        """What differs from the law's defaults, in words."""
        named = {path.removeprefix("controller."): value for path, value in self.changes.items()}
        words = [f"{path} = {value}" for path, value in named.items() if path not in ("kind", "source")]
        return ", ".join(words)

    def scenario(self, plain: Scenario, law_fields: Mapping[str, Any]) -> tuple[Scenario, str] | None:
        """(scenario with this law, what had to be set for it) of a case; None if it lacks one of the fields.

        Raises `ScenarioError` for one that is not valid.
        """
        changes = with_period_if_needed(plain, self.changes)
        found = change_settings(plain, changes)
        period = found.controller.control_period
        note = "" if period == plain.controller.control_period else f"sampled, {PERIOD} = {period:g} s"
        for name, value in law_fields.items():
            owner = next((path for path in ("controller", "controller.slow") if _has(found, path, name)), None)
            if owner is None:
                return None
            found = found.replace({f"{owner}.{name}": value})
        return found, note


def _has(scenario: Scenario, owner: str, name: str) -> bool:
    try:
        scenario.get(f"{owner}.{name}")
    except ScenarioError:
        return False
    return True


def entrants() -> dict[str, Entrant]:
    """Flexlab's own by name, as menus list them; laws that drive nothing do not enter."""
    found: dict[str, Entrant] = {}
    for kind, law in laws().items():
        if not law.drives or not law.model.__module__.startswith("flexlab.control.laws."):
            continue
        found[kind] = Entrant(kind, law.chosen())
        for name, settings in SETTINGS.items():
            if settings["controller.kind"] == kind:
                found[name] = Entrant(name, settings)
    return found


def chosen_entrants(wanted: Sequence[AnyLaw] | None, more: Sequence[AnyLaw] = ()) -> tuple[Entrant, ...]:
    """Laws by name, file or class; None: flexlab's own. `more` enter besides. Raises `StudyError` or `ScenarioError`."""
    known = entrants()
    if isinstance(wanted, str) or not (wanted is None or isinstance(wanted, Sequence)):
        raise StudyError(f"laws = {wanted!r:.60} is no list: give names or files, as in ['pd', 'my_law.py'].")
    first = list(known.values()) if wanted is None else [_entrant(law, known) for law in wanted]
    return tuple({entrant.name: entrant for entrant in [*first, *(_entrant(law, known) for law in more)]}.values())


def _entrant(wanted: AnyLaw, known: Mapping[str, Entrant]) -> Entrant:
    if isinstance(wanted, str) and wanted in known:
        return known[wanted]
    kind = law_kind(wanted)
    law = laws().get(kind)
    if law is None:
        raise StudyError(f"{kind!r:.60} is no control law: choose from {', '.join(known)}, or give a Python file.")
    return Entrant(kind, law.chosen())
