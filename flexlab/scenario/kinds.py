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


def any_path() -> Any:
    """Any path."""
    models = [path.model for path in paths().values()]
    return Annotated[reduce(or_, models), Field(discriminator="kind")] if len(models) > 1 else models[0]
