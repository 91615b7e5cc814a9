"""The scenario as a whole: its parts, what must fit together, and changes by path."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from pydantic import BaseModel, Field, SerializeAsAny, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from flexlab.control.controller import Controller
from flexlab.control.law import laws, on_new_law
from flexlab.control.laws.adaptive_sliding_mode import AdaptiveSlidingMode
from flexlab.control.path import Trajectory, on_new_path, paths
from flexlab.control.paths.sine import SineTrajectory
from flexlab.errors import ScenarioError
from flexlab.own.kinds import ADDING
from flexlab.own.law import OwnController, with_known_law
from flexlab.own.path import OwnTrajectory, with_known_path
from flexlab.quantities import Number, Numbers, Part, Quantity, Triple, describe, either, quantity
from flexlab.scenario.arms import Arm, Grips, Joints
from flexlab.scenario.earlier_versions import in_present_terms
from flexlab.scenario.payload import Payload
from flexlab.scenario.validation_errors import LONGEST, brief, field_paths, problem, unknown_field, value_paths
from flexlab.text import counted, html_table, visible


def _models(known: Mapping[str, Any]) -> Any:
    """The union of the models of these laws or paths."""
    return either(one.model for one in known.values())


AnyLaw = Any
AnyPath = Any
if not TYPE_CHECKING:
    # Serialised by their own types: a text that was saved again has another model than in scenarios before.
    AnyLaw, AnyPath = (
        Annotated[_models(known), Field(discriminator="kind"), SerializeAsAny()] for known in (laws(), paths())
    )

SMALLEST_STEP = 1e-7
"""Shortest integration step, s: below it rounding outweighs truncation for every integrator here."""
SCHEMA_FIELD, FORMAT_FIELD, MENU_FIELD = "$schema", "format", "menu_order"
FILE_FIELDS: dict[str, type] = {SCHEMA_FIELD: str, FORMAT_FIELD: int, MENU_FIELD: int}
"""Metadata of a file, not fields of the scenario: its schema for editors, its format, its place in menus."""
FORMAT = 1
"""Newest format of scenario files. Older ones can always be read; a file without the number has format 1."""
SAID = ("title", "watch")
"""Fields with words about the scenario."""
COMMON_FIELDS = {
    "controller.kind": frozenset(Controller.model_fields),
    "trajectory.kind": frozenset(Trajectory.model_fields),
}
"""Fields that all laws, or all paths, have."""
MOST_PROBLEMS = 20
"""The most problems of a scenario that are reported at once."""
MOST_FIELDS = 1000
"""The most fields of a scenario's plain data that are checked, several times those of any scenario: each takes time."""


class Initial(Part):
    """Where a run starts. null: on the trajectory (pose, pose rate) or undeformed (beam)."""

    pose: Triple | None = quantity(None, "Start pose", "x(0)", "m, m, rad", low=-100, high=100, live="restart")
    pose_rate: Triple | None = quantity(
        (0.0, 0.0, 0.0), "Start pose rate", "ẋ(0)", "m/s, m/s, rad/s", low=-100, high=100, live="restart"
    )
    beam_coordinates: Numbers | None = quantity(
        None, "Start beam coordinates", "q(0)", "m, rad", low=-10, high=10, live="restart"
    )


class Simulation(Part):
    """How the equations are integrated."""

    step: Number | None = quantity(None, "Longest step (null: chosen)", "Δt", "s", low=SMALLEST_STEP, high=0.1)
    integrator: Literal["auto", "rk4", "etdrk4", "generalized-alpha"] = quantity("auto", "Integrator")
    accuracy: Number = quantity(
        1e-10, "Pose accuracy that an automatic step aims at", unit="m", low=1e-14, high=1e-4, logarithmic=True
    )


class Scenario(Part):
    """A complete experiment. With `right_arm` null and the boundary clamped-free, one arm holds one end of the beam."""

    title: str = Field(default="", max_length=120)
    watch: str = Field(default="", max_length=1200)
    payload: Payload = Payload()
    left_arm: Arm = Arm(base=(-0.5, 0.0), elbow=-1)
    right_arm: Arm | None = Arm(base=(0.5, 0.0), elbow=1)
    joints: Joints = Joints()
    grips: Grips = Grips()
    trajectory: AnyPath = SineTrajectory()  # pyright: ignore[reportCallIssue]
    controller: AnyLaw = AdaptiveSlidingMode()
    initial: Initial = Initial()
    gravity: Number = quantity(0.0, "Gravity along −y", "g", "m/s²", low=-50, high=50, slider=(0, 20))
    simulation: Simulation = Simulation()

    @property
    def arms(self) -> tuple[Arm, ...]:
        """The arms: left, and right if there is one."""
        return (self.left_arm,) if self.right_arm is None else (self.left_arm, self.right_arm)

    def __repr__(self) -> str:
        beam, arms = self.payload, len(self.arms)
        return (
            f"<Scenario {self.title!r}: {self.controller.kind}, {self.trajectory.kind}, {beam.boundary} beam of "
            f"{counted(beam.element_count, 'element')} with EI = {beam.bending_stiffness:g} N·m², {counted(arms, 'arm')}>"
        )

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Every field by path, with its unit, for notebooks."""
        rows = ((path, self.get(path), self.about(path).unit) for path in value_paths(self) if path not in SAID)
        leaves = ((path, value, unit) for path, value, unit in rows if not isinstance(value, BaseModel))
        return html_table(leaves, ("field", "value", "unit"), caption=self.title)

    @model_validator(mode="after")
    def _fits_together(self) -> "Scenario":
        if (self.payload.boundary == "clamped-free") != (self.right_arm is None):
            raise PydanticCustomError(
                "arms",
                "a clamped-free beam is held by one arm and every other boundary by two: "
                "load the preset single-arm for one arm or paper for two; "
                "in a file, set right_arm to null for clamped-free",
            )
        given, needed = self.initial.beam_coordinates, self.payload.coordinate_count
        if given is not None and len(given) != needed:
            raise PydanticCustomError(
                "mesh",
                "initial.beam_coordinates has {given} values, but {n} {boundary} elements have {needed} coordinates: "
                "give {needed} values, or null for an undeformed beam",
                {
                    "given": len(given),
                    "needed": needed,
                    "n": self.payload.element_count,
                    "boundary": self.payload.boundary,
                },
            )
        if self.joints.encoders.active and self.controller.control_period is None:
            raise PydanticCustomError(
                "sampling",
                "encoders (joints.encoders) belong to sampled control: give the control period (controller.control_period) "
                "a value in s, or set the encoders' counts (joints.encoders.counts) to 0",
            )
        change, integrator = self.payload.mass_change, self.simulation.integrator
        if change.active and integrator in ("etdrk4", "generalized-alpha"):
            raise PydanticCustomError(
                "integrator",
                "the integrator {integrator} (simulation.integrator) needs a mass that stays, and the mass changes by a "
                "factor of {factor} (payload.mass_change.factor): choose the integrator auto or rk4, or the factor 1",
                {"integrator": integrator, "factor": f"{change.factor:g}"},
            )
        if self.grips.active and integrator in ("etdrk4", "generalized-alpha"):
            raise PydanticCustomError(
                "integrator",
                "the integrator {integrator} (simulation.integrator) needs rigid grips, and the grips are compliant "
                "(grips.model): choose the integrator auto or rk4, or rigid grips",
                {"integrator": integrator},
            )
        return self

    def replace(self, changes: Mapping[str, Any]) -> "Scenario":
        """A copy with fields changed by dotted path, in order; raises `ScenarioError` and changes nothing if it is not valid.

        A changed `kind` (damping, controller, trajectory) begins with defaults, except for the fields that all laws or all paths
        have: name it before its own fields.
        """
        if not _by_name(changes):
            example = 'as in {"payload.bending_stiffness": 50.0}'
            sentence = (
                f"changes = {visible(repr(changes), LONGEST)} is not usable: give values by dotted path, {example}."
            )
            raise ScenarioError([("", sentence)])
        # Untouched parts stay as they are: they have been validated.
        data = dict(vars(self))
        for path, value in changes.items():
            if not _set(data, path, value):
                raise self._unknown(path)
        changed = self._with_parts(data) if all("." in path for path in changes) else None
        return changed or parse_scenario(data)

    def _with_parts(self, data: Mapping[str, Any]) -> "Scenario | None":
        """As `parse_scenario`, but validate only the parts that have changed, as a slider sends many changes.

        None if one of them is not valid, has another kind or holds a person's own code: the whole then has to be parsed.
        """
        parts: dict[str, Part] = {}
        try:
            for name, old in vars(self).items():
                if data[name] is old:
                    continue
                if not isinstance(old, Part) or isinstance(old, (OwnController, OwnTrajectory)):
                    return None
                parts[name] = type(old).model_validate(data[name])
            with ADDING:
                return Scenario.model_validate(self.model_copy(update=parts))
        except (ValidationError, PydanticCustomError):
            return None

    def __reduce__(self) -> tuple[Any, ...]:
        # As plain data: models made for a law's parts have no name by which another process would find them.
        return parse_scenario, (self.model_dump(),)

    def anew(self) -> "Scenario":
        """The scenario for a new run: without the transition that a change in motion left in the path."""
        if self.trajectory.transition is None:
            return self
        return self.model_copy(update={"trajectory": self.trajectory.model_copy(update={"transition": None})})

    def get(self, path: str) -> Any:
        """The value at a dotted path; raises `ScenarioError` for an unknown one."""
        found, value = self._look_up(path)
        if not found:
            raise self._unknown(path)
        return value

    def has(self, path: str) -> bool:
        """Whether there is a field at a dotted path; it may depend on the kind of a part."""
        return self._look_up(path)[0]

    def _look_up(self, path: str) -> tuple[bool, Any]:
        """Whether there is a field at a dotted path, and its value."""
        value: Any = self
        for name in str(path).split("."):
            if not isinstance(value, BaseModel) or name not in type(value).model_fields:
                return False, None
            value = getattr(value, name)
        return True, value

    def about(self, path: str) -> Quantity:
        """Title, symbol, unit and range of the field at a dotted path."""
        *parents, name = str(path).split(".")
        owner = self.get(".".join(parents)) if parents else self
        if not isinstance(owner, BaseModel) or name not in type(owner).model_fields:
            raise self._unknown(path)
        return describe(type(owner), name)

    def _unknown(self, path: str) -> ScenarioError:
        """The error for a path that is not a field of this scenario."""
        shown = visible(path, LONGEST)
        return ScenarioError([(str(path), unknown_field(shown, value_paths(self), field_paths(type(self))))])


def _by_name(data: Any) -> bool:
    """Whether data are a mapping with names as keys."""
    return isinstance(data, Mapping) and all(isinstance(name, str) for name in cast("Mapping[object, Any]", data))


def _know_new_kinds() -> None:
    """Let scenarios have the laws and paths that were added after this module was imported."""
    Scenario.model_fields["controller"].annotation = _models(laws())
    Scenario.model_fields["trajectory"].annotation = _models(paths())
    Scenario.model_rebuild(force=True)


on_new_law(_know_new_kinds)
on_new_path(_know_new_kinds)


def parse_scenario(data: Any) -> Scenario:
    """A `Scenario` from plain data (a dict as read from JSON); raises `ScenarioError`, one sentence per problem."""
    if not isinstance(data, Mapping):
        raise ScenarioError([("", f"A scenario is a JSON object with named fields, not {type(data).__name__}.")])
    data = _without_file_fields(cast("Mapping[str, Any]", data))
    if _field_count(data) > MOST_FIELDS:
        raise ScenarioError(
            [("", f"This has more than {MOST_FIELDS} fields, so it is not a scenario: check what it is.")]
        )
    try:
        with ADDING:
            return Scenario.model_validate(with_known_path(with_known_law(in_present_terms(data))))
    except ValidationError as error:
        found = error.errors(include_url=False)
        problems = [problem(Scenario, item) for item in found[:MOST_PROBLEMS]]
        if len(found) > MOST_PROBLEMS:
            more = len(found) - MOST_PROBLEMS
            are = "One more field is wrong" if more == 1 else f"{more} more fields are wrong"
            problems.append(("", f"{are}: mend these first."))
        raise ScenarioError(problems) from None


def _field_count(data: Mapping[str, Any]) -> int:
    """The number of fields in plain data and its parts, counted until there are more than `MOST_FIELDS`."""
    count, parts = 0, [data]
    while parts and count <= MOST_FIELDS:
        part = parts.pop()
        count += len(part)
        parts += [value for value in part.values() if isinstance(value, Mapping)]
    return count


def _without_file_fields(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """A scenario's plain data without `FILE_FIELDS`. Raises `ScenarioError` for wrong ones, such as a later format."""
    for name, kind in FILE_FIELDS.items():
        value = data.get(name, kind())
        if type(value) is not kind and not (kind is int and type(value) is float and value.is_integer()):
            text = f"{name} = {brief(value)} is not usable: give a text, or leave it out."
            number = f"{name} = {brief(value)} is not usable: give a whole number, or leave it out."
            raise ScenarioError([(name, text if kind is str else number)])
    written = data.get(FORMAT_FIELD, FORMAT)
    if not 1 <= written <= FORMAT:
        sentence = (
            f"{FORMAT_FIELD} = {brief(written)} is not known here: flexlab reads 1 to {FORMAT}; "
            "a later version may read it."
        )
        raise ScenarioError([(FORMAT_FIELD, sentence)])
    return {name: value for name, value in data.items() if name not in FILE_FIELDS}


def _set(data: dict[str, Any], path: str, value: Any) -> bool:
    """Set the value at a path; False if its parent does not exist."""
    *parents, name = path.split(".")
    for parent in parents:
        # A part of a new kind does not exist yet.
        inner = data.get(parent, {} if "kind" in data else None)
        if not isinstance(inner, (Part, dict)):
            return False
        # A shallow copy, so that the caller's data and the old scenario stay as they are.
        inner = data[parent] = dict(vars(inner) if isinstance(inner, Part) else cast("dict[str, Any]", inner))
        data = inner
    if name == "kind" and not (isinstance(value, str) and data.get("kind") == value):
        common = COMMON_FIELDS.get(path, frozenset())
        for field in [key for key in data if key not in common]:
            del data[field]
    data[name] = value
    return True
