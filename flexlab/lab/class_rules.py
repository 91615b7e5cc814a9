"""What a teacher asks of the labs of a class."""

from dataclasses import dataclass

from flexlab.guide import STEPS

LOCKED = "The teacher has locked this lab: nothing can be played or changed until they unlock it."


def step_text(step: int) -> str:
    """A step in words."""
    return f"step {step} of {len(STEPS)} ({STEPS[step - 1]})"


@dataclass(frozen=True)
class ClassRules:
    """What holds in every lab of a class."""

    lesson: str = ""
    """The one lesson that is open, as the guide's menu calls it; empty: each chooses."""
    step: int = len(STEPS)
    """Of that lesson, the last step that is shown, 1 to 3."""
    locked: bool = False
    """Whether nobody but the teacher can play or change anything."""
    hides_names: bool = False
    """Whether the teacher's page shows numbers instead of names."""

    @property
    def pace(self) -> str:
        """Where the class is, as a sentence; empty if each chooses."""
        if not self.lesson:
            return ""
        return f"The class is at {step_text(self.step)} of “{self.lesson}”: open the Guide. The teacher moves on."

    @property
    def sentences(self) -> tuple[str, ...]:
        """What people in a lab are told as long as these rules hold."""
        return tuple(filter(None, (self.pace, LOCKED if self.locked else "")))
