"""What laws and paths in Python share: how a text gets a model, a name, and permission to run.

A text is part of the scenario (`controller.source`, `trajectory.source`), so that recordings, presets and replays are
complete. Reading a scenario with a text makes its declaration known; the text runs only if it was allowed in this process.
"""

import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, Field, create_model

from flexlab.control.law import Law
from flexlab.control.path import Path
from flexlab.errors import ScenarioError
from flexlab.files import short_hash
from flexlab.own import hosts
from flexlab.own.declaration import Declared, Setting
from flexlab.own.reading import LONGEST_SOURCE
from flexlab.quantities import Number, OneOrThree, quantity
from flexlab.registry import Registry
from flexlab.text import visible

LONGEST_SHOWN = 60
"""Characters of a name that a sentence repeats."""
OWN_PLACE = 80
"""Rank in menus: after the built-in laws, before "none"."""

K = TypeVar("K", bound=Law | Path)
MODELS_KEPT = 32
"""How many texts keep their models: making one takes longer than making a world, and pydantic may drop a Ctrl-C meanwhile."""

ADDING = threading.RLock()
"""Held while a law or path is added and while a scenario is read, so that neither happens during the other."""


def source_field(source: str, word: str) -> Any:
    """The model's field for the text of a law or a path."""
    return Field(source, max_length=LONGEST_SOURCE, title=f"Text of the {word}")


@dataclass(frozen=True)
class OwnKinds(Generic[K]):
    """The laws, or the paths, in Python text."""

    registry: Registry[Any]
    sort: type[K]
    base: type[BaseModel]
    """Base of their models."""
    field: str
    """The scenario's field: controller or trajectory."""
    word: str
    owner: str
    """Word for what has the fields of `base`, in sentences."""
    setting: str
    """Word for a declared setting, in sentences."""
    read: Callable[[str, str, str], K]
    """Makes a law or path of (text, file, another name or empty). Raises `ScenarioError` with file and line."""

    def add(self, source: str, file: str) -> K:
        """Make a file's law or path known in place of an earlier text, and let it run. Raises `ScenarioError`."""
        own: Any = self.read(source, file, "")
        with ADDING:
            known = self.registry.all().get(own.kind)
            if known is not None and not isinstance(known, self.sort):
                text = f"{file}: a {self.registry.what} of flexlab is called {own.kind} already: give the class another name."
                raise ScenarioError([(f"{self.field}.source", text)])
            # Checked in a person's own file only: earlier recordings with such laws must still open.
            if own.declaration.mistake:
                raise ScenarioError([(f"{self.field}.source", f"{file}, {own.declaration.mistake}.")])
            if hiding := [name for name, _ in own.declaration.settings if field_of(name, self.base) != name]:
                raise self._taken(file, hiding[0])
            hosts.allow(source, file)
            if known is None or default_source(known) != source:
                self.registry.add(own, instead=True)
        return own

    def known(self) -> list[K]:
        """All known laws, or paths, in Python."""
        return [own for own in self.registry.all().values() if isinstance(own, self.sort)]

    def named(self, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """A scenario's plain data with the name under which its text in Python is known; the text is not run."""
        own = data.get(self.field)
        if isinstance(own, self.base):
            known = self.registry.all().get(getattr(own, "kind", ""))
            if known is not None and known.model is type(own):
                return data
            own = own.model_dump()
        if not isinstance(own, Mapping) or not isinstance(own.get("source"), str) or not own["source"]:
            return data
        kind = self._known_kind(own["source"])
        known: Any = self.registry.all().get(kind)
        settings = known.declaration.settings if isinstance(known, self.sort) else ()
        fields = {name: field_of(name, self.base) for name, _ in settings}
        return {**data, self.field: {**{fields.get(name, name): value for name, value in own.items()}, "kind": kind}}

    def restored(self, data: dict[str, Any]) -> Any:
        """The model from the `model_dump` of another process."""
        kind = self._known_kind(data["source"])
        return self.registry[kind].model.model_validate({**data, "kind": kind})

    def _known_kind(self, source: str) -> str:
        """The name under which a text's declaration is known; it is added if need be.

        If another declaration has its name already, a part of the text's digest is added.
        """
        named = hosts.file_of(source)
        own: Any = self.read(source, named or f"the {self.word} of this scenario", "")
        with ADDING:
            for kind in (own.kind, f"{own.kind}-{short_hash(source)[:6]}"):
                known: Any = self.registry.all().get(kind)
                if known is None:
                    self.registry.add(own if kind == own.kind else self.read(source, named or kind, kind))
                    return kind
                if isinstance(known, self.sort) and known.declaration == own.declaration:
                    return kind
        return own.kind

    def _taken(self, file: str, name: str) -> ScenarioError:
        why = "begins with _" if name.startswith("_") else f"is a field of every {self.owner}"
        text = f"{file}: {visible(name, LONGEST_SHOWN)} {why}: give the {self.setting} another name."
        return ScenarioError([(f"{self.field}.source", text)])

    def model(self, declared: Declared, source: str, file: str, kind: str, **fields: Any) -> type[Any]:
        """The model of what a text declares, with `fields` besides its settings. Raises `ScenarioError`."""
        for name, _ in declared.settings:
            if name.startswith("_") or name in self.base.model_fields or name == "kind":
                raise self._taken(file, name)
        own = {
            field_of(name, self.base): (OneOrThree if one.size == 3 else Number, _setting_field(name, one))
            for name, one in declared.settings
        }
        with warnings.catch_warnings():
            # They concern settings called "copy", "model_dump_" and the like, which do no harm.
            for message in (
                "Field name .* shadows an attribute in parent",
                "Field .* conflicts with protected namespace",
            ):
                warnings.filterwarnings("ignore", message)
            return create_model(
                declared.name,
                __base__=self.base,
                __doc__=declared.meaning,
                kind=(Literal[kind], kind),  # type: ignore[valid-type]  # The type is made at run time.
                source=(str, source_field(source, self.word)),
                **fields,
                **own,
            )


def field_of(setting: str, model: type[BaseModel]) -> str:
    """The field of a setting: its name, with an underscore if it would hide an attribute of every such model.

    Files with such names are refused, but recordings may have them: flexlab may have got the attribute later.
    """
    # Names from earlier versions of pydantic, such as "copy", do no harm.
    is_free = hasattr(BaseModel, setting) and not setting.startswith("model_")
    return f"{setting}_" if hasattr(model, setting) and not is_free else setting


def flat_numbers(model: BaseModel, settings: Sequence[tuple[str, Setting]]) -> np.ndarray:
    """The numbers of a model's gains or options, flat, in the order of their declaration."""
    values = [np.broadcast_to(getattr(model, field_of(name, type(model))), one.size) for name, one in settings]
    return np.concatenate([np.zeros(0), *values])


def default_source(own: Law | Path) -> str:
    """The text of a law or a path, as in its file."""
    return own.model.model_fields["source"].default


def _setting_field(name: str, gain: Setting) -> Any:
    """A gain's or option's field; its slider covers the range, or three times the default where that is much less."""
    top = 3 * float(np.max(np.abs(gain.default)))
    slider = gain.slider or (gain.low, min(gain.high, top) if top > gain.low else gain.high)
    title = gain.title or name.replace("_", " ").capitalize()
    return quantity(**vars(gain) | {"title": title, "slider": slider})
