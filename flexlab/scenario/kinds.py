"""The scenario's fields that are one of several kinds, as their registries know them."""

from functools import reduce
from operator import or_
from typing import Annotated, Any

from pydantic import Field

from flexlab.control.law import laws
from flexlab.control.path import paths


def law_models() -> Any:
    """The union of the models of all control laws that are known now."""
    return reduce(or_, [law.model for law in laws().values()])


def any_law() -> Any:
    """Any control law, told apart by its field `kind`."""
    return Annotated[law_models(), Field(discriminator="kind")]


def path_models() -> Any:
    """The union of the models of all paths that are known now."""
    return reduce(or_, [path.model for path in paths().values()])


def any_path() -> Any:
    """Any path, told apart by its field `kind`."""
    return Annotated[path_models(), Field(discriminator="kind")]
