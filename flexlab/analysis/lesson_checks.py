"""The self-checks of lessons: rules that stand in a lesson's file, tried one after another; the first that holds is the verdict.

    period_bend = largest(quasi_static_deflection, t - period, t)
    if undisturbed < period: Let one period of the path go by.
    done if period_bend > 1e-3: The motion bends the beam by {period_bend:length} ✓
    else: Now set Bending stiffness EI to 10.

A name may also stand for a text in quotes. What braces hold is worked out (`lesson_expressions`) and written as its format
says: as Python does, or `length`, as a length reads best. A line that begins with a space goes on with the one before.
A sentence never gives a number that was not measured or computed from this run.
"""

import re
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

from flexlab.analysis.lesson_expressions import Comparison, Expression, ExpressionError, LookedAt
from flexlab.analysis.lesson_measures import Look, length
from flexlab.errors import FlexlabError
from flexlab.guide import Lesson, lessons, told_together
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import Event

_RULE = re.compile(r"(done|else|(?:done )?if (.+?)): (.+)")
_NAME = re.compile(r"([a-z]\w*) = (?:\"(.+)\"|(.+))")
_BRACES = re.compile(r"\{([^{}]+?)(?::(length|g|\.\d[efg]))?\}")


class Verdict(NamedTuple):
    """What a check found: whether the lesson is done, and a sentence with the numbers or the next step."""

    done: bool
    sentence: str


class _Sentence:
    """A text with values in braces. Raises `ExpressionError` for braces that hold no expression."""

    def __init__(self, text: str, known: Sequence[str]):
        if "{" in _BRACES.sub("", text):
            raise ExpressionError(
                f"{text[:60]!r} holds no value: write as in {{t:.2f}}, or {{largest(vibration):length}}."
            )
        self._text, self._values = text, {found[1]: Expression(found[1], known) for found in _BRACES.finditer(text)}

    def value(self, run: LookedAt) -> str:
        """The text for a run as it is now."""

        def shown(found: re.Match[str]) -> str:
            value = self._values[found[1]].value(run)
            return length(value) if found[2] == "length" else format(value, found[2] or "")

        return _BRACES.sub(shown, self._text)


class _Rule(NamedTuple):
    condition: Comparison | None
    """None: it always holds."""
    done: bool
    sentence: Callable[[LookedAt], str]


NOTHING = Expression("0")


class Check:
    """The check of one lesson."""

    def __init__(self, lesson: Lesson):
        """Raises `ExpressionError` for lines that are no rules; its text says which, of all of them."""
        self._hint = lesson.hint
        self._named: dict[str, Expression | _Sentence] = {}
        self._rules: list[_Rule] = []
        lines = [line for line in re.sub(r"\n +", " ", lesson.check).splitlines() if line.strip()]
        if len(lines) == 1:
            self._rules.append(_Rule(Comparison(lesson.check), True, lambda _: "The check holds ✓"))
            self._rules.append(_Rule(None, False, lambda _: lesson.hint or "Not yet."))
        else:
            mistakes = [mistake for line in lines if (mistake := self._read(line))]
            if not re.match("(done|else) *:", lines[-1] if lines else ""):
                mistakes.append("the last rule must be done: or else: and what to say where no other holds.")
            if mistakes:
                raise ExpressionError(told_together(mistakes))

    def _read(self, line: str) -> str:
        """Take a rule or a name in; what is wrong with the line, empty if nothing is."""
        known = list(self._named)
        named, rule = _NAME.fullmatch(line), _RULE.fullmatch(line)
        try:
            if named:
                name, text, expression = named.groups()
                self._named[name] = NOTHING  # Lines below may use it, even if this one is wrong.
                self._named[name] = _Sentence(text, known) if text else Expression(expression, known)
            elif rule:
                kind, condition, sentence = rule.groups()
                when = Comparison(condition, known) if condition else None
                self._rules.append(_Rule(when, kind.startswith("done"), _Sentence(sentence, known).value))
            else:
                return (
                    f"{line[:60]!r} is no rule: write name = …, if …: sentence, done if …: sentence, or else: sentence."
                )
        except ExpressionError as error:
            return str(error)
        return ""

    def verdict(self, scenario: Scenario, samples: Samples, events: Sequence[Event] = ()) -> Verdict:
        """Of a run by its newest samples (`SECONDS` of them if there are as many) and all its events. Never fails."""
        if len(samples) < 2:
            return Verdict(False, "Press play: there is nothing to measure yet.")
        run = LookedAt(Look(scenario, samples, events), {name: each.value for name, each in self._named.items()})
        try:
            rule = next(rule for rule in self._rules if rule.condition is None or rule.condition.holds(run))
            return Verdict(rule.done, rule.sentence(run))
        except (ExpressionError, ArithmeticError, IndexError, TypeError, ValueError) as error:
            return Verdict(False, f"The check cannot be worked out in this run ({error}). {self._hint}".strip())
        except FlexlabError as error:  # What the closed loop does cannot be said of this scenario.
            return Verdict(False, str(error))


@cache
def read_check(lesson: Lesson) -> Check:
    """The check that a lesson's file gives. Raises `ExpressionError`."""
    return Check(lesson)


def check_lesson(lesson: str, scenario: Scenario, samples: Samples, events: Sequence[Event] = ()) -> Verdict:
    """The verdict of one of flexlab's own lessons, by its id. Raises KeyError for an unknown one."""
    return read_check({each.id: each for each in lessons()}[lesson]).verdict(scenario, samples, events)
