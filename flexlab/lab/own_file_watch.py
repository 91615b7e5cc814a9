"""Follows the files of a person's own laws and paths while a lab runs: what is saved acts at once, in the run that is on."""

import threading
import time
from pathlib import Path

from flexlab.control.law import laws
from flexlab.errors import FlexlabError
from flexlab.lab.lab_state import LabState
from flexlab.own import hosts
from flexlab.own.files import LAW_FILES, PATH_FILES, add_own_law_file, add_own_path_file
from flexlab.own.law import PythonLaw, same_declaration

LOOK = 0.25
"""s between two looks: an editor that writes a file in several goes is done by then."""

Stamp = tuple[int, int, int]
"""What changes when a file is written or replaced: when, which one and how long."""


class OwnFileWatch:
    """Looks at the files whose laws and paths may run here, and for new ones in a person's folders, made later too."""

    def __init__(self, lab_state: LabState):
        self._lab_state = lab_state
        self._stop = threading.Event()
        self._folders = [folder.own.resolve() for folder in (LAW_FILES, PATH_FILES)]
        self._known = {file for file in map(Path, set(hosts.allowed().values())) if file.is_file()}
        # What was saved between the start of flexlab and now is taken up, too.
        self._taken = {
            file: stamp for file, stamp in self._stamps().items() if file not in self._known or not _is_new(file)
        }
        self._thread = threading.Thread(target=self._follow, name="flexlab-own-files", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End; returns when the thread is done."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def _stamps(self) -> dict[Path, Stamp]:
        found = self._known.union(*(folder.glob("*.py") for folder in self._folders))
        return {file: stamp for file in found if (stamp := _stamp(file)) is not None}

    def _follow(self) -> None:
        before: dict[Path, Stamp] = {}
        while not self._stop.wait(LOOK):
            now = self._stamps()
            for file in sorted(now):
                if now[file] == before.get(file) and now[file] != self._taken.get(file):
                    is_first = file not in self._taken and file not in self._known
                    self._taken[file] = now[file]
                    self._take(file, is_first)
            before = now

    def _take(self, file: Path, is_first: bool) -> None:
        folder = PATH_FILES if file.parent == self._folders[1] or PATH_FILES.holds(file) else LAW_FILES
        if folder.holds(file):
            (self._reload_path if folder is PATH_FILES else self._reload_law)(file)
        elif is_first:
            try:
                kind = folder.kind_of(file)
                self._lab_state.say(f"{file.name} was saved: the {folder.kinds.registry.what} {kind} is new.")
            except FlexlabError as error:
                self._lab_state.say(f"{file.name} was saved, but cannot be used: {error}", level="error")
        # So that the menus look at what there is.
        self._lab_state.touched_at = time.monotonic()

    def _reload_law(self, path: Path) -> None:
        present = self._lab_state.intended.controller
        old = laws().get(present.kind)
        try:
            law = add_own_law_file(path)
            source = law.model.model_fields["source"].default
            if present.kind != law.kind or getattr(present, "source", "") == source:
                self._lab_state.say(f"{path.name} was saved: the control law {law.kind} is new.")
            elif isinstance(old, PythonLaw) and same_declaration(old, law) and law.goes_on:
                self._lab_state.change({"controller.source": source})
                self._lab_state.say(f"{path.name} was saved: the control law {law.kind} goes on with the new text.")
            else:
                self._restart(law)
                self._lab_state.say(f"{path.name} was saved: the run starts anew with it.")
        except FlexlabError as error:
            self._lab_state.say(f"{path.name} was saved, but the law goes on as it was: {error}", level="error")

    def _reload_path(self, file: Path) -> None:
        """The target goes on to the new path, with the options that it still has."""
        present = self._lab_state.intended.trajectory
        try:
            path = add_own_path_file(file)
            fields = path.model.model_fields
            source = fields["source"].default
            if present.kind != path.kind or getattr(present, "source", "") == source:
                self._lab_state.say(f"{file.name} was saved: the path {path.kind} is new.")
                return
            kept = {
                name: value
                for name, value in present.model_dump().items()
                if name in fields and name not in ("kind", "source", "table", "table_of", "transition")
            }
            self._lab_state.change({"trajectory": {"kind": path.kind, **kept, "source": source}})
            self._lab_state.say(f"{file.name} was saved: the path {path.kind} goes on with the new text.")
        except FlexlabError as error:
            self._lab_state.say(f"{file.name} was saved, but the path goes on as it was: {error}", level="error")

    def _restart(self, law: PythonLaw) -> None:
        """Begin anew with a law that declares something else, with the gains that it still has."""
        scenario, fields = self._lab_state.intended, law.model.model_fields
        source = fields["source"].default
        kept = {
            name: value
            for name, value in scenario.controller.model_dump().items()
            if name in fields and name not in ("kind", "source")
        }
        changed = scenario.replace({"controller": {**kept, "kind": law.kind, "source": source}})
        self._lab_state.load(changed, self._lab_state.name)


def _stamp(file: Path) -> Stamp | None:
    try:
        found = file.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_ino, found.st_size


def _is_new(file: Path) -> bool:
    """Whether a file holds another text than the one that may run."""
    try:
        return not hosts.is_allowed(LAW_FILES.text(file))
    except FlexlabError:
        return False
