"""Building blocks of the scenario models: numbers whose title, symbol, unit and range are stated once, as field metadata.

`quantity(...)` declares a field; `describe(model, name)` returns its `Quantity` for labels, sliders and error sentences. `Part`
is the base of every scenario model: frozen, with unknown keys refused and ranges checked.
"""

import math
import numbers
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, reduce
from operator import or_
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationInfo,
    field_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError

from flexlab.text import range_text, with_indices


@dataclass(frozen=True)
class Quantity:
    """Description of one scenario field for the screen and for error sentences.

    `low`, `high`: allowed range of every number in the field, in `unit`. `slider`: the part of that range that a slider
    covers; `logarithmic`: whether the slider has a logarithmic scale. `live`: whether a change acts at once on a
    running lab ("continuous"), reshapes the beam ("projected") or restarts the run ("restart").
    """

    title: str
    unit: str = ""
    symbol: str = ""
    low: float = -math.inf
    high: float = math.inf
    slider: tuple[float, float] | None = None
    logarithmic: bool = False
    live: str = "continuous"

    def description(self) -> str:
        """Title, symbol and range in one line."""
        name = f"{self.title}, {self.symbol}" if self.symbol else self.title
        return f"{name}: {self.range_text()}" if math.isfinite(self.low) and math.isfinite(self.high) else name

    def range_text(self) -> str:
        """The allowed range with its unit, as in "0.001 to 10⁹ N·m²"."""
        return range_text(self.low, self.high) + self.unit_text()

    def unit_text(self) -> str:
        """The unit with a space before it, as it follows a number; empty for pure numbers."""
        return f" {self.unit}" if self.unit not in ("", "1") else ""


def quantity(default: Any = ..., title: str = "", symbol: str = "", unit: str = "", **description: Any) -> Any:
    """A pydantic field that carries a `Quantity`. `default` is `...` for a required field."""
    about = Quantity(title, unit, symbol, **description)
    return Field(default, title=title, json_schema_extra={"quantity": about.__dict__})


@cache
def describe(model: type[BaseModel], name: str) -> Quantity:
    """The `Quantity` of field `name` of `model`; one with only a title if the field was declared without."""
    field = model.model_fields[name]
    extra = field.json_schema_extra
    if isinstance(extra, dict) and "quantity" in extra:
        about: Any = extra["quantity"]
        return Quantity(
            **{name: with_indices(told) if name in ("title", "symbol") else told for name, told in about.items()}
        )
    return Quantity(field.title or name.replace("_", " "))


def _number(value: Any) -> float:
    if type(value) is float and math.isfinite(value):  # The common case; a slider sends many.
        return value
    try:
        number = math.nan if isinstance(value, bool) or not isinstance(value, numbers.Real) else float(value)
    except OverflowError:  # a whole number too large for a float
        number = math.inf
    if not math.isfinite(number):
        raise PydanticCustomError("number", "needs a finite number")
    return number


def _whole_number(value: Any) -> int:
    number = _number(value)
    if number != int(number):
        raise PydanticCustomError("number", "needs a whole number")
    return int(number)


def _numbers(value: Any) -> tuple[float, ...]:
    # NumPy's single numbers have `__array__` and no items.
    listed = isinstance(value, Sequence) or (hasattr(value, "__array__") and getattr(value, "ndim", 1) > 0)
    if isinstance(value, (str, bytes)) or not listed:
        raise PydanticCustomError("numbers", "needs a list of numbers")
    return tuple(_number(item) for item in value)


def _fixed_length(count: int) -> Any:
    def check(value: Any) -> tuple[float, ...]:
        numbers = _numbers(value)
        if len(numbers) != count:
            raise PydanticCustomError("numbers", "needs {count} numbers", {"count": count})
        return numbers

    return check


def _one_or_three(value: Any) -> float | tuple[float, ...]:
    try:
        return _number(value) if isinstance(value, numbers.Real) else _fixed_length(3)(value)
    except PydanticCustomError as error:
        raise PydanticCustomError("numbers", "needs 1 or 3 numbers") if error.type == "numbers" else error from None


Number = Annotated[float, BeforeValidator(_number)]
Count = Annotated[int, BeforeValidator(_whole_number)]
Numbers = Annotated[tuple[float, ...], BeforeValidator(_numbers)]
CountPair = Annotated[tuple[Count, Count], BeforeValidator(_fixed_length(2))]
Pair = Annotated[tuple[float, float], BeforeValidator(_fixed_length(2))]
Quartet = Annotated[tuple[float, float, float, float], BeforeValidator(_fixed_length(4))]
Triple = Annotated[tuple[float, float, float], BeforeValidator(_fixed_length(3))]
OneOrThree = Annotated[float | tuple[float, float, float], BeforeValidator(_one_or_three)]


def _flatten(value: Any) -> Iterator[float]:
    if isinstance(value, tuple):
        for item in value:
            yield from _flatten(item)
    elif isinstance(value, (int, float)):
        yield value


def _bound(schema: dict[str, Any], about: Quantity) -> None:
    """Give every number in a field's JSON schema the field's range."""
    if schema.get("type") in ("number", "integer") and "enum" not in schema:
        if math.isfinite(about.low):
            schema["minimum"] = about.low
        if math.isfinite(about.high):
            schema["maximum"] = about.high
    items = [schema["items"]] if isinstance(schema.get("items"), dict) else []
    for inner in (*schema.get("anyOf", ()), *schema.get("prefixItems", ()), *items):
        _bound(inner, about)


class Part(BaseModel):
    """Base of the scenario models: immutable, strict about names and about ranges."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """JSON schema with each field's range, symbol and unit where editors look for them."""
        schema = handler.resolve_ref_schema(handler(core_schema))
        for name, field in schema.get("properties", {}).items():
            if field.pop("quantity", None) is not None:
                about = describe(cls, name)
                field["description"] = about.description()
                _bound(field, about)
        return schema

    @field_validator("*", mode="after")
    @classmethod
    def _in_range(cls, value: Any, info: ValidationInfo) -> Any:
        # A slider sends many changes: values without numbers need no check.
        if value is None or (type(value) is not float and isinstance(value, (str, Part))):
            return value
        about = describe(cls, info.field_name or "")
        if about.low == -math.inf and about.high == math.inf:  # Whatever is in the field, no range refuses it.
            return value
        for number in _flatten(value):
            if not about.low <= number <= about.high:
                allowed = {"range": about.range_text()}
                raise PydanticCustomError("range", "is outside the allowed range {range}", allowed)
        return value


def either(models: Iterable[type[BaseModel]]) -> Any:
    """The type of a field that holds one of these models."""
    return reduce(or_, models)


def parts_of(annotation: Any) -> list[type[Part]]:
    """The scenario parts that a field's type names, through unions and annotations."""
    if isinstance(annotation, type) and issubclass(annotation, Part):
        return [annotation]
    return [part for inner in get_args(annotation) for part in parts_of(inner)]


@cache
def own_numbers(model: type[BaseModel], base: type[BaseModel]) -> dict[str, int]:
    """Fields that `model` adds to `base` and that hold numbers, and how many numbers a kernel gets for each.

    A field that may be one number or three counts as three.
    """
    sizes = {}
    for name, about in model.model_fields.items():
        size = _size(about.annotation)
        if name not in base.model_fields and size:
            sizes[name] = size
    return sizes


def _size(annotation: Any) -> int:
    """Most numbers that a field's type holds; 0 if it holds none or any number of them."""
    if annotation in (float, int):
        return 1
    forms, origin = get_args(annotation), get_origin(annotation)
    if origin is tuple:
        return len(forms) if all(form in (float, int) for form in forms) else 0
    return max(map(_size, forms), default=0) if origin in (Union, UnionType, Annotated) else 0


BASE_UNITS: dict[str, dict[str, int]] = {
    "1": {},
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
}
"""Exponents of the SI base units, and of rad, in each unit."""


def base_exponents(unit: str) -> dict[str, int] | None:
    """Exponents of a unit's base units, for example of "N·s²/m²"; None if it has units not in `BASE_UNITS`."""
    if not all(name.rstrip("²³") in BASE_UNITS for name in re.split("[·/]", unit)):
        return None
    total: dict[str, int] = {}
    for sign, factor in re.findall(r"([·/]?)([^·/]+)", unit):
        name, power = factor.rstrip("²³"), {"²": 2, "³": 3}.get(factor[-1], 1)
        for base, exponent in BASE_UNITS[name].items():
            total[base] = total.get(base, 0) + (-power if sign == "/" else power) * exponent
    return {base: exponent for base, exponent in total.items() if exponent}
