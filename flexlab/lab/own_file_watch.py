"""Reloads a person's own laws and paths in the running lab when their files are saved."""

import contextlib
import threading
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from flexlab.control.law import laws
from flexlab.errors import FlexlabError
from flexlab.lab.lab_state import LabState
from flexlab.own import hosts
from flexlab.own.files import LAW_FILES, PATH_FILES, OwnFolder, files_in
from flexlab.own.law import PythonLaw
from flexlab.quantities import Part
from flexlab.sim.commands import Play, Reset

LOOK = 0.25
"""Time between two checks, s: an editor that writes a file in several steps is done by then."""

OF_A_LAW = ("kind", "source")
OF_A_PATH = (*OF_A_LAW, "table", "table_of", "transition")
"""Fields that belong to one text, or to the transition to it; a new text has its own."""

Stamp = dict[Path, tuple[int, int, int]]
"""Time of change, inode and size of a file, and of those that its text contains."""


class OwnFileWatch:
    """Watches the files whose laws and paths may run here, and a person's folders for new ones."""

    def __init__(self, lab_state: LabState):
        self._lab_state = lab_state
        self._stop = threading.Event()
        self._folders = [folder.own.resolve() for folder in (LAW_FILES, PATH_FILES)]
        self._known = {file for file in map(Path, set(hosts.allowed().values())) if file.is_file()}
        self._seen: dict[Path, Stamp] = {}
        # Files saved between the start of flexlab and now are taken up too.
        self._taken = {
            file: stamp for file, stamp in self._stamps().items() if file not in self._known or not _is_new(file)
        }
        self._thread = threading.Thread(target=self._follow, name="flexlab-own-files", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop watching; returns when the thread is done."""
        self._stop.set()
        self._thread.join()

    def _stamps(self) -> dict[Path, Stamp]:
        found = self._known.union(*map(files_in, self._folders))
        stamps: dict[Path, Stamp] = {}
        for file in found:
            stamp = _stamp(self._seen.get(file, {file}))
            if stamp != self._seen.get(file):  # It may contain other files now.
                stamp = _stamp({file, *LAW_FILES.parts(file)})
            if file in stamp:
                self._seen[file] = stamps[file] = stamp
        return stamps

    def _follow(self) -> None:
        before: dict[Path, Stamp] = {}
        while not self._stop.wait(LOOK):
            now = self._stamps()
            for file in sorted(now):
                if now[file] == before.get(file) and now[file] != self._taken.get(file):
                    earlier, self._taken[file] = self._taken.get(file, {}), now[file]
                    saved = [one for one in now[file] if one in earlier and now[file][one] != earlier[one]]
                    self._take(file, file if file in saved or not saved else saved[0])
            before = now

    def _take(self, file: Path, saved: Path) -> None:
        """Take up a file, of which itself or another file that it contains was `saved`."""
        folder = PATH_FILES if file.parent == self._folders[1] or PATH_FILES.holds(file) else LAW_FILES
        if folder.holds(file):
            self._reload(file, saved, folder)
        elif folder.has_kernel(file):
            self._lab_state.warn(f"{saved.name} was saved: start flexlab again to use it, as kernels are loaded once.")
        elif not folder.is_part(file):
            try:
                kind = folder.kind_of(file)
                self._lab_state.say(f"{file.name} was saved: {_to_choose(folder.kinds.registry.what, kind)}")
            except FlexlabError as error:
                self._lab_state.warn(f"{file.name} was saved, but cannot be used: {_briefly(error, file)}")
        # This makes the menus update.
        self._lab_state.touched_at = time.monotonic()

    def _reload(self, file: Path, saved: Path, folder: OwnFolder[Any]) -> None:
        """Take up a file's new text, as `saved` was; the run goes on with it if possible."""
        lab_state, kinds = self._lab_state, folder.kinds
        present = lab_state.intended.get(kinds.field)
        try:
            old, new = laws().get(present.kind), folder.add(file)
            source = new.model.model_fields["source"].default
            hosts.stop_loading(str(file), source)
            title, stopped = f"{kinds.registry.what} {new.kind}", lab_state.snapshot.status.failed
            if present.kind != new.kind:
                told = _to_choose(kinds.registry.what, new.kind)
            elif getattr(present, "source", "") == source:
                told = f"the {title} has not changed."
            elif isinstance(new, PythonLaw) and not (
                isinstance(old, PythonLaw) and old.declaration == new.declaration and new.declaration.goes_on
            ):
                changed = {kinds.field: _with_text(new, present, source, OF_A_LAW)}
                lab_state.load(lab_state.intended.replace(changed), lab_state.name)
                told = self._begun(stopped)
            else:
                text = {kinds.field: _with_text(new, present, source, OF_A_PATH)}
                lab_state.change(text if folder is PATH_FILES else {f"{kinds.field}.source": source})
                if stopped:
                    lab_state.submit(Reset())
                told = self._begun(stopped) if stopped else f"the {title} goes on with the new text."
            lab_state.say(f"{saved.name} was saved: {told}")
        except FlexlabError as error:
            goes_on = "the path goes on as it was" if folder is PATH_FILES else "the law goes on as it was"
            told = goes_on if folder.knows(file) else "cannot be used"
            lab_state.warn(f"{saved.name} was saved, but {told}: {_briefly(error, file)}")

    def _begun(self, stopped: bool) -> str:
        """Play the new run if the law or path had `stopped` the last one; returns the words for the notice."""
        if stopped:
            self._lab_state.submit(Play())
        return "the run restarts with it."


def _to_choose(what: str, kind: str) -> str:
    """The words for the notice on a law or path that is not in use."""
    return f"choose the {what} {kind} in the menu to use it."


def _stamp(files: Iterable[Path]) -> Stamp:
    stamp: Stamp = {}
    for file in files:
        with contextlib.suppress(OSError):
            about = file.stat()
            stamp[file] = about.st_mtime_ns, about.st_ino, about.st_size
    return stamp


def _briefly(error: FlexlabError, file: Path) -> str:
    """An error without the folder of its file, which visitors should not see."""
    return str(error).replace(str(file), file.name)


def _with_text(kind: Any, present: Part, source: str, left_out: tuple[str, ...]) -> dict[str, Any]:
    """A part of the scenario with a new text; it keeps those options of the present one that it still has."""
    kept = {
        name: value
        for name, value in present.model_dump().items()
        if name in kind.model.model_fields and name not in left_out
    }
    return {"kind": kind.kind, **kept, "source": source}


def _is_new(file: Path) -> bool:
    """Whether the text of a file differs from the one that may run."""
    try:
        return not hosts.is_allowed(LAW_FILES.text(file))
    except FlexlabError:
        return False
