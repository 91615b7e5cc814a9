"""The scenario's files: the preset menu, own presets, download, upload, link."""

import html
import re
import unicodedata
from collections.abc import Callable
from pathlib import Path
from typing import Any

import viser

from flexlab.assets import presets_folder
from flexlab.errors import PresetError
from flexlab.lab.panel.run_comparison import changes_table, told_html
from flexlab.lab.widgets import Menu, Widgets, put
from flexlab.presets import (
    OWN_FOLDER,
    load_preset,
    load_scenario_file,
    preset_names,
    read_scenario,
    save_scenario,
    scenario_text,
)
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import differences, field_title, told, value_text
from flexlab.scenario.path_file import decoded_path
from flexlab.sim.snapshot import Snapshot
from flexlab.text import escaped, visible, with_units

LONGEST_NAME = 40
"""Most characters of a name, as a menu shows them."""
MOST_PRESETS = 60
"""Most files in a person's own folder: a menu can hold them, and no visitor can fill the disk."""
CHANGES_NAMED = 4
"""Most changes named below the menu; the tab File has all."""
LONGEST_WORDS = 1200
"""Most characters of what to watch, as in a scenario."""
LONGEST_FILE_NAME = 60
"""Most characters of a file's name in a sentence."""
DEVICES = re.compile(r"con|prn|aux|nul|(com|lpt)\d")
"""Names that Windows keeps for devices: no file there can have them, whatever its ending."""
TOO_LONG = "This scenario is too long for a link: download it as a file."


def save_preset(scenario: Scenario, name: str, folder: Path = OWN_FOLDER, baseline: Scenario | None = None) -> Path:
    """Write a scenario as a person's own preset; raises `PresetError` for an unusable name, or one that others use.

    The file gets the name in small letters, digits and hyphens. `baseline`: the preset that may be replaced.
    """
    name = usable_stem(name)
    if (presets_folder() / f"{name}.json").exists():
        raise PresetError(f"{name} is a preset of flexlab itself and stays as it is: choose another name.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PresetError(f"The folder {folder} cannot be made ({error.strerror}): start flexlab elsewhere.") from None
    path = folder / f"{name}.json"
    if not path.exists() and sum(1 for _ in folder.glob("*.json")) >= MOST_PRESETS:
        raise PresetError(
            f"There are {MOST_PRESETS} presets in {folder} already: delete some, or save under one's name."
        )
    if path.exists() and load_scenario_file(path) not in (scenario, baseline):
        raise PresetError(
            f"There is another preset {name} already: choose another name, or open that one before you change it."
        )
    save_scenario(scenario, path)
    return path


def usable_stem(name: str) -> str:
    """The file name, without ending, for a preset's name; raises `PresetError` for an unusable name."""
    stem = file_stem(name)
    if not stem or len(name) > LONGEST_NAME or not name.isprintable() or re.search(r"[/\\]", name):
        raise PresetError(
            f"{name[:60]!r} cannot be a preset's name: use 1 to {LONGEST_NAME} characters, a letter or a digit among them "
            "and no slash, as in My soft beam."
        )
    if DEVICES.fullmatch(stem):
        raise PresetError(f"{name!r} cannot be a preset's name: Windows keeps it for a device. Choose another name.")
    return stem


def file_stem(name: str) -> str:
    """A name that every file system, link and command line accepts: small letters, digits and hyphens; may be empty."""
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    return re.sub(r"[^a-z0-9]+", "-", plain.lower())[:LONGEST_NAME].strip("-")


def read_upload(file_name: str, content: bytes) -> tuple[str, Scenario]:
    """(short name, scenario) of an uploaded file; raises `PresetError` or `ScenarioError` with the file's own name."""
    stem = file_stem(Path(file_name).stem) or "uploaded"
    return stem, read_scenario(content, visible(Path(file_name).name, LONGEST_FILE_NAME))


class Presets:
    """A menu of presets, made in the open GUI container."""

    def __init__(self, widgets: Widgets):
        self._lab_state = lab_state = widgets.lab_state
        # The page's script finds the menu by this mark: choosing the shown preset again restarts it.
        widgets.gui.add_html('<i hidden class="fl-preset"></i>')
        self.menu = Menu(
            widgets,
            "Preset",
            self._offered,
            lambda: lab_state.name,
            lambda name: lab_state.load(load_preset(name), name),
            hint="Starts a new run",
        )
        self._text = widgets.gui.add_html("")

    def update(self, _: Snapshot) -> None:
        """Show the preset that the scenario came from, its text, and the changes since."""
        self.menu.settle()
        baseline, now = self._lab_state.baseline, self._lab_state.intended
        head = f'<h2 class="fl-title">{escaped(baseline.title or self._lab_state.name)}</h2>'
        text = f"{head}{escaped(with_units(baseline.watch))}"
        if not self._lab_state.changed:
            put(self._text, content=f'<div class="fl">{text}</div>')
            return
        # The preset's text no longer describes the run; its height stays, so that no slider moves under the pointer.
        words = [f"{title}: {old} → {new}" for title, old, new in told_html(baseline, now)]
        more = f"<br>… and {len(words) - CHANGES_NAMED} more" if len(words) > CHANGES_NAMED else ""
        head = f'<h2 class="fl-title">{escaped(self._lab_state.name)}, changed <span class="fl-badge">not saved</span></h2>'
        shown = f"{head}{'<br>'.join(words[:CHANGES_NAMED])}{more}"
        put(
            self._text, content=f'<div class="fl fl-stack"><div aria-hidden="true">{text}</div><div>{shown}</div></div>'
        )

    def _offered(self) -> list[str]:
        """The present presets, and the file that the scenario came from."""
        names, present = preset_names(), self._lab_state.name
        return names if present in names else [present, *names]


class ScenarioFiles:
    """Buttons for scenarios, made in the open GUI container. `on_saved` is called when a preset has been saved."""

    def __init__(self, widgets: Widgets, on_saved: Callable[[], None]):
        lab_state = widgets.lab_state
        self._lab_state, self._on_saved = lab_state, on_saved
        self._shown_for: tuple[Scenario, Scenario] | None = None
        self._changes = widgets.gui.add_html("")
        for label, icon, hint, action in (
            ("Undo", viser.Icon.ARROW_BACK_UP, "Undo the last change (Ctrl+Z)", lab_state.undo),
            ("Redo", viser.Icon.ARROW_FORWARD_UP, "Redo the last undone change (Ctrl+Shift+Z)", lab_state.redo),
            ("Back to preset", None, "A new run without your changes", lab_state.back_to_baseline),
        ):
            widgets.button(label, lambda _, action=action: action(), icon=icon, hint=hint)
        self._suggested = self._suggestion()
        self.name = widgets.gui.add_text(
            "Name", self._suggested, hint="Name of the preset; its file has it in small letters"
        )
        self.words = widgets.gui.add_text(
            "What to watch", "", multiline=True, hint="Your own words; if empty, the list of changes"
        )
        save, file, hint = viser.Icon.DEVICE_FLOPPY, viser.Icon.DOWNLOAD, "Into the folder presets"
        widgets.button("Save as preset", lambda _: self.save(), icon=save, color=None, hint=hint)
        widgets.button("Download", self._download, icon=file, hint="The scenario as a file")
        opener = widgets.gui.add_upload_button(
            "Open a file",
            icon=viser.Icon.UPLOAD,
            color="gray",
            mime_type="application/json,text/csv",
            hint="A scenario file, or a path as CSV with the columns t, x, y, theta",
        )
        opener.on_upload(widgets.handler(self._upload))
        self._address = widgets.gui.add_html("")

    def update(self, _: Snapshot) -> None:
        """Show the changes from the preset, and the address of the scenario."""
        lab_state = self._lab_state
        key = (lab_state.baseline, lab_state.intended)
        if self._shown_for is not None and self._shown_for[0] is key[0] and self._shown_for[1] is key[1]:
            return
        self._shown_for = key
        before, self._suggested = self._suggested, self._suggestion()
        if self.name.value == before != self._suggested:  # Nobody has typed a name.
            self.name.value = self._suggested
        name = escaped(lab_state.name)
        table = changes_table(*key, "changed, not saved", name, "now")
        self._changes.content = f'<div class="fl">{table or f"As in {name}: nothing is changed."}</div>'
        if (link := lab_state.outside.link) is not None:
            address = html.escape(link(lab_state.to_keep))  # Whole, however long.
            shown = (
                f'This scenario in another browser (click, then copy):<div class="fl-code" tabindex="0">{address}</div>'
            )
            self._address.content = f'<div class="fl">{shown if address else TOO_LONG}</div>'

    def save(self) -> None:
        """Save under the name in the box."""
        name, words, scenario = self.name.value, self.words.value.strip(), self._lab_state.to_keep
        if len(words) > LONGEST_WORDS:
            raise PresetError(f"What to watch has {len(words)} characters: at most {LONGEST_WORDS} fit.")
        if usable_stem(name) != self._lab_state.name:
            scenario = scenario.replace({"title": name})
            changed = told(differences(self._lab_state.baseline, self._lab_state.intended))
            changes = ", ".join(f"{field_title(path, scenario)} {value_text(new)}" for path, _, new in changed)
            if changes:
                scenario = scenario.replace({"watch": f"From {self._lab_state.name}: {changes}."[:LONGEST_WORDS]})
        if words:
            scenario = scenario.replace({"watch": words})
        path = save_preset(scenario, name, baseline=self._lab_state.baseline)
        self._lab_state.saved(scenario, path.stem)
        self._on_saved()
        self._lab_state.say(f"Saved as {path}.")

    def _suggestion(self) -> str:
        name = self._lab_state.name
        return (name if name.startswith("my-") else f"my-{name}")[:LONGEST_NAME]

    def _download(self, event: Any) -> None:
        content = scenario_text(self._lab_state.to_keep).encode()
        event.client.send_file_download(f"{self._lab_state.name}.json", content, save_immediately=True)

    def _upload(self, event: Any) -> None:
        file = event.target.value
        if file.name.lower().endswith(".csv"):
            rows = decoded_path(file.content, visible(Path(file.name).name, LONGEST_FILE_NAME))
            self._lab_state.change({"trajectory.kind": "table", "trajectory.rows": rows})
            self._lab_state.say(f"Follows {len(rows)} rows from now on.")
            return
        name, scenario = read_upload(file.name, file.content)
        self._lab_state.load(scenario, name)
        self._lab_state.say(f"Opened {name}.")
