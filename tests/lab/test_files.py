"""Scenarios as a person's own files: names are checked, flexlab's presets kept, bad uploads answered in sentences."""

from pathlib import Path

import pytest
from lab_page import wait_until
from raw_browser import RawBrowser, html_texts, widget

from flexlab.errors import PresetError, ScenarioError
from flexlab.lab.lab_state import Outside
from flexlab.lab.panel.scenario_files import TOO_LONG, read_upload, save_preset
from flexlab.lab.session import Session
from flexlab.presets import load_preset, scenario_text
from flexlab.scenario import Scenario
from flexlab.scenario.path_file import decoded_path


def test_a_saved_preset_is_found_again(tmp_path: Path) -> None:
    scenario = Scenario().replace({"payload.bending_stiffness": 33.0, "title": "Mine"})
    path = save_preset(scenario, "my-beam", tmp_path / "presets")
    assert path == tmp_path / "presets" / "my-beam.json"
    assert load_preset("my-beam", tmp_path / "presets") == scenario


@pytest.mark.parametrize(
    ("name", "file"),
    [("My soft Beam", "my-soft-beam"), ("Träger 2", "trager-2"), (" EI = 1.27 ", "ei-1-27"), ("A", "a")],
)
def test_a_preset_name_written_as_people_write_becomes_a_file_name(name: str, file: str, tmp_path: Path) -> None:
    path = save_preset(Scenario(), name, tmp_path)
    assert path.name == f"{file}.json"
    assert load_preset(file, tmp_path) == Scenario()


@pytest.mark.parametrize(
    "name",
    [
        "",
        "../evil",
        "a/b",
        "x" * 41,
        "a\\b",
        "–",
        "日本",
        "a\n",
        "\x00",
        "..",
        "a" * 10**6,
        "con",
        "NUL",
        "Com1",
    ],
)
def test_a_name_that_cannot_be_used_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(PresetError, match="cannot be a preset's name") as caught:
        save_preset(Scenario(), name, tmp_path)
    assert len(str(caught.value)) < 250
    assert list(tmp_path.iterdir()) == []


def test_flexlabs_own_presets_cannot_be_overwritten(tmp_path: Path) -> None:
    with pytest.raises(PresetError, match="stays as it is"):
        save_preset(Scenario(), "paper", tmp_path)


def test_a_preset_that_somebody_else_saved_is_not_overwritten(tmp_path: Path) -> None:
    """A class shares the folder, and every lab suggests the same name: only the last student's preset was left."""
    first, second, third = (Scenario().replace({"gravity": gravity}) for gravity in (1.0, 2.0, 3.0))
    save_preset(first, "My beam", tmp_path, baseline=Scenario())
    with pytest.raises(PresetError, match="There is another preset my-beam already: choose another name"):
        save_preset(second, "my-beam", tmp_path, baseline=Scenario())
    save_preset(second, "my-beam", tmp_path, baseline=first)
    with pytest.raises(PresetError, match="another preset"):
        save_preset(third, "my-beam", tmp_path, baseline=first)
    assert load_preset("my-beam", tmp_path) == second


def test_a_folder_that_cannot_be_made_is_an_error_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "presets").write_text("a file")
    with pytest.raises(PresetError, match="cannot be"):
        save_preset(Scenario(), "mine", tmp_path / "presets")


def test_an_upload_gives_its_scenario_and_a_safe_name() -> None:
    scenario = Scenario().replace({"gravity": 9.81})
    assert read_upload("My Run (3).JSON", scenario_text(scenario).encode()) == ("my-run-3", scenario)
    assert read_upload("../../etc/passwd", scenario_text(scenario).encode())[0] == "passwd"
    assert read_upload("….json", scenario_text(scenario).encode())[0] == "uploaded"


@pytest.mark.parametrize(
    ("content", "error", "said"),
    [
        (b"", PresetError, "not valid JSON"),
        (b"\xff\xfe\x00", PresetError, "not a text file"),
        (b"[1, 2]", ScenarioError, "JSON object"),
        (b'{"payload": {"bending_stiffness": -1}}', ScenarioError, "outside the allowed range"),
        (b'{"a": 1, "a": 2}', PresetError, "given twice"),
        (b"[" * 100_000, PresetError, "cannot be read"),
    ],
)
def test_bad_uploads_are_answered_in_sentences_with_the_files_own_name(content: bytes, error: type, said: str) -> None:
    with pytest.raises(error, match=said) as caught:
        read_upload("My photo.PNG", content)
    if error is PresetError:
        assert "My photo.PNG" in str(caught.value)
    assert "/tmp" not in str(caught.value)


def test_a_saved_preset_is_titled_by_its_name_and_says_what_changed(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    lab, paper = session.lab_state, load_preset("paper")
    save, name = widget(session, "Save as preset"), widget(session, "Name")
    with RawBrowser(session) as browser:

        def saved(title: str) -> Scenario:
            browser.update(name, {"value": title})
            wait_until(lambda: name.value == title, "the name is written")
            browser.update(save, {"value": True})
            file = tmp_path / "presets" / f"{title.lower().replace(' ', '-')}.json"
            wait_until(lambda: lab.notice.text == f"Saved as presets/{file.name}.", "it is saved")
            lab.say("")
            return load_preset(file.stem)

        first = saved("My beam")
        assert (first.title, first.watch) == ("My beam", paper.watch), "nothing has changed that words could tell"
        lab.change({"payload.bending_stiffness": 60.0})
        again = saved("My beam")
        assert (again.title, again.get("payload.bending_stiffness")) == ("My beam", 60.0)
        lab.change({"payload.bending_stiffness": 70.0})
        other = saved("Another")
        assert (other.title, other.watch) == ("Another", "From my-beam: Bending stiffness EI (N·m²) 70.")
        assert lab.to_keep == other, "what is downloaded and shared"
        browser.update(name, {"value": "a" * 200})
        wait_until(lambda: len(name.value) == 200, "the name is written")
        browser.update(save, {"value": True})
        wait_until(lambda: "cannot be a preset's name: use 1 to 40 characters" in lab.notice.text, "it is refused")
        words = widget(session, "What to watch")
        browser.update(name, {"value": "Third"})
        browser.update(words, {"value": "w" * 1201})
        wait_until(lambda: name.value == "Third" and words.value, "name and words are written")
        browser.update(save, {"value": True})
        told = "What to watch has 1201 characters: at most 1200 fit."
        wait_until(lambda: lab.notice.text == told, "it is refused, and not cut off")
        assert not (tmp_path / "presets" / "third.json").exists()


def test_a_path_from_a_file_is_followed_from_now_on_without_a_jump(session: Session) -> None:
    """As when a CSV file is opened in the lab: the table begins at that instant, and the target does not jump."""
    lab, runner = session.lab_state, session.runner
    wait_until(lambda: runner.snapshot.latest.time[0] > 0.1, "the run goes on")
    rows = decoded_path(b"t [ms],x,y,theta\n0,0,0.75,0\n100,0.05,0.8,0.1\n300,0,0.7,0\n", "path.csv")
    lab.change({"trajectory.kind": "table", "trajectory.rows": rows})
    wait_until(lambda: runner.snapshot.scenario.trajectory.kind == "table", "the path is another")
    path = runner.snapshot.scenario.trajectory
    assert path.start > 0.05
    assert path.transition is not None
    assert lab.intended.trajectory.rows == rows
    with pytest.raises(ScenarioError, match=r"cannot reach the desired pose \(.*of the table\)"):
        lab.change({"trajectory.rows": ((0.0, 0.0, 0.75, 0.0), (1.0, 0.0, 1.7, 0.0))})
    lab.undo()
    wait_until(lambda: runner.snapshot.scenario.trajectory.kind == "sine", "and back")


def test_a_long_link_is_shown_as_a_whole() -> None:
    """A path of one's own takes thousands of characters."""
    link = f"http://127.0.0.1:8000/lab/?scenario={'x' * 5000}"
    with Session(load_preset("paper"), "paper", shadows=False, outside=Outside(link=lambda _: link)) as session:
        wait_until(lambda: any(f">{link}<" in html.content for html in html_texts(session)), "the link")


def test_a_scenario_that_is_too_long_for_a_link_is_said_to_be() -> None:
    with Session(load_preset("paper"), "paper", shadows=False, outside=Outside(link=lambda _: "")) as session:
        wait_until(lambda: any(TOO_LONG in text.content for text in html_texts(session)), "the panel says so")
