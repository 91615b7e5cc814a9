"""Follows the files of a person's own laws and paths while a lab runs: what is saved acts at once, in the run that is on."""

import logging
import threading
from pathlib import Path

from watchfiles import watch

from flexlab.control import own_law_hosts as hosts
from flexlab.control.law import laws
from flexlab.control.own_files import PATH_FILES, add_own_law_file, add_own_path_file
from flexlab.control.own_law import PythonLaw, same_declaration
from flexlab.errors import FlexlabError
from flexlab.lab.lab_state import LabState

DEBOUNCE, STEP, LOOK = 200, 50, 500
"""ms: an editor writes a file in several goes; how often the system is asked; how often the end of the lab is."""

log = logging.getLogger(__name__)


class OwnFileWatch:
    """Looks at the files whose laws and paths may run here."""

    def __init__(self, lab_state: LabState):
        self._lab_state = lab_state
        self._stop = threading.Event()
        self._files = [file for file in map(Path, set(hosts.allowed().values())) if file.is_file()]
        self._thread = threading.Thread(target=self._follow, name="flexlab-own-files", daemon=True)

    def start(self) -> None:
        """Begin, if there is anything to look at."""
        if self._files:
            self._thread.start()

    def stop(self) -> None:
        """End; returns when the thread is done."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def _follow(self) -> None:
        # Folders, as many editors put a new file in the old one's place.
        folders = {file.parent for file in self._files}
        wanted, begun = {str(file) for file in self._files}, False
        try:
            for changes in watch(
                *folders,
                watch_filter=lambda _, path: path in wanted,
                debounce=DEBOUNCE,
                step=STEP,
                stop_event=self._stop,
                rust_timeout=LOOK,
                recursive=False,
                raise_interrupt=False,
                yield_on_timeout=True,
            ):
                # What was saved before the system began to look, nobody tells.
                paths = {path for _, path in changes} if begun else {file for file in wanted if _is_new(Path(file))}
                begun = True
                for path in sorted(paths):
                    if Path(path).is_file():
                        (self._reload_path if PATH_FILES.holds(path) else self._reload_law)(Path(path))
        except (OSError, RuntimeError):
            log.exception("files of laws and paths are not followed any more")

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


def _is_new(file: Path) -> bool:
    """Whether a file holds another text than the one that may run."""
    try:
        return not hosts.is_allowed(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        return False
