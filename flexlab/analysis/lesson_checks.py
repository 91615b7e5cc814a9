"""The checks of lessons: rules in a lesson's file. The first rule that holds gives the verdict.

    period_bend = largest(quasi_static_deflection, t - period, t)
    if undisturbed < period: Let one period of the path go by.
    done if period_bend > 1e-3: The motion bends the beam by {period_bend:length} ✓
    else: Now set Bending stiffness EI to 10.

A name may also stand for a text in quotes. Braces hold an expression (`lesson_expressions`) and a format: one of Python's, or
`length`, in mm or µm. A line that begins with a space continues the line before. All numbers in a sentence are measured or
computed from this run.
"""

import re
from collections.abc import Sequence
from functools import cache, partial
from typing import NamedTuple

from flexlab.analysis.lesson_expressions import ExpressionError, Value, expression
from flexlab.analysis.lesson_measures import VALUES, Look, length
from flexlab.analysis.metrics import METRICS
from flexlab.errors import FlexlabError
from flexlab.guide import Lesson, told_together
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import Event

_RULE = re.compile(r"(done|else|(?:done )?if (.+?)): (.+)")
_NAME = re.compile(r"([a-z]\w*) = (?:\"(.+)\"|(.+))")
_BRACES = re.compile(r"\{([^{}]+?)(?::(length|g|\.\d[efg]))?\}")


class Verdict(NamedTuple):
    """The result of a check: whether the lesson is done, and a sentence with numbers or the next step."""

    done: bool
    sentence: str


def _sentence(text: str, known: Sequence[str]) -> Value:
    """The text with its braces filled in from a run. Raises `ExpressionError` for braces without an expression."""
    if "{" in _BRACES.sub("", text):
        raise ExpressionError(f"{text[:60]!r} holds no value: write as in {{t:.2f}}, or {{largest(vibration):length}}.")
    values = {found[1]: expression(found[1], known) for found in _BRACES.finditer(text)}

    def shown(run: Look, found: re.Match[str]) -> str:
        value = values[found[1]](run)
        return length(value) if found[2] == "length" else format(value, found[2] or "")

    return lambda run: _BRACES.sub(partial(shown, run), text)


class _Rule(NamedTuple):
    condition: Value | None
    """None: the rule always holds."""
    done: bool
    sentence: Value


NOTHING = expression("0")


class Check:
    """The check of one lesson."""

    def __init__(self, lesson: Lesson):
        """Read the rules. Raises `ExpressionError`, which names all lines that are not rules."""
        self._hint = lesson.hint
        self._named: dict[str, Value] = {}
        self._rules: list[_Rule] = []
        lines = [line for line in re.sub(r"\n +", " ", lesson.check).splitlines() if line.strip()]
        if len(lines) == 1:
            self._rules.append(_Rule(expression(lesson.check, truth=True), True, lambda _: "The check holds ✓"))
            self._rules.append(_Rule(None, False, lambda _: lesson.hint or "Not yet."))
        else:
            mistakes = [mistake for line in lines if (mistake := self._read(line))]
            if not re.match("(done|else) *:", lines[-1] if lines else ""):
                mistakes.append("the last rule must be done: or else: and what to say where no other holds.")
            if mistakes:
                raise ExpressionError(told_together(mistakes))

    def _read(self, line: str) -> str:
        """Read a line with a rule or a name, and return a sentence on its mistake, or "" if there is none."""
        known = list(self._named)
        named, rule = _NAME.fullmatch(line), _RULE.fullmatch(line)
        try:
            if named:
                name, text, given = named.groups()
                # A lesson's name may hide that of a value, but its definition cannot read the value that it hides.
                reads_itself = name in (*VALUES, *METRICS) and re.search(rf"\b{name}\b", text or given)
                if name in known or reads_itself:
                    return f"{line[:60]!r} gives a second meaning to a name: choose another one."
                self._named[name] = NOTHING  # Later lines may use the name even if this line is wrong.
                self._named[name] = _sentence(text, known) if text else expression(given, known)
            elif rule:
                kind, condition, sentence = rule.groups()
                when = expression(condition, known, truth=True) if condition else None
                self._rules.append(_Rule(when, kind.startswith("done"), _sentence(sentence, known)))
            else:
                return f"{line[:60]!r} is not a rule: write name = …, if …: sentence, done if …: sentence, or else: sentence."
        except ExpressionError as error:
            return str(error)
        return ""

    def verdict(self, scenario: Scenario, samples: Samples, events: Sequence[Event] = ()) -> Verdict:
        """The verdict on a run from its newest `SECONDS` s of samples and all its events. Never raises."""
        if len(samples) < 2:
            return Verdict(False, "Press play: there is nothing to measure yet.")
        run = Look(scenario, samples, events, self._named)
        try:
            rule = next(rule for rule in self._rules if rule.condition is None or rule.condition(run))
            return Verdict(rule.done, rule.sentence(run))
        except (ExpressionError, ArithmeticError, IndexError, RecursionError, TypeError, ValueError) as error:
            return Verdict(False, f"The check cannot be worked out in this run ({error}). {self._hint}".strip())
        except FlexlabError as error:  # A measure of the closed loop does not exist for this scenario.
            return Verdict(False, str(error))


@cache
def read_check(lesson: Lesson) -> Check:
    """The check in a lesson's file. Raises `ExpressionError`."""
    return Check(lesson)
