"""A control law in a Python file in a running lab: chosen, saved again, broken, repaired."""

import os
from pathlib import Path

import pytest
from lab_page import wait_until
from own_law_text import PD
from own_path_text import ROUND
from raw_browser import RawBrowser, widget

from flexlab.control.law import forget_law
from flexlab.lab.panel.sections import changes_for
from flexlab.lab.session import Session
from flexlab.own import hosts
from flexlab.own.files import LAW_FILES
from flexlab.presets import load_preset
from flexlab.sim.commands import Pause


@pytest.mark.parametrize("mended", [PD, PD.replace("low=0, high=1e5", "low=0, high=3e5")])
def test_a_saved_law_acts_at_once_and_one_that_cannot_be_read_changes_nothing(tmp_path: Path, mended: str):
    file = tmp_path / "mine.py"
    file.write_text(PD)
    law = LAW_FILES.add(file)
    with Session(load_preset("paper").replace({"controller.kind": law.kind}), shadows=False) as lab:
        wait_until(lambda: lab.runner.snapshot.latest.time[0] > 0.1, "the lab runs")
        file.write_text(PD.replace("self.push = common[0]", "self.push = 17.0"))
        wait_until(lambda: lab.runner.snapshot.latest["push"][0] == 17.0, "the new text acts")
        assert lab.runner.snapshot.run_number == 1
        file.write_text("class OwnPD(OwnLaw:\n")
        wait_until(lambda: "line 1" in lab.lab_state.notice.text, "the sentence about the new text")
        assert str(tmp_path) not in lab.lab_state.notice.text, "visitors need not see where the file lies"
        assert lab.runner.snapshot.latest["push"][0] == 17.0
        file.write_text(PD.replace("self.push = common[0]", "self.push = 17.0"))
        wait_until(
            lambda: lab.lab_state.notice.text == f"mine.py was saved: the control law {law.kind} has not changed.",
            "it says so",
        )
        file.write_text(
            PD.replace("low=0, high=1e5", "low=0, high=2e5").replace("self.push = common[0]", "self.push = 18.0")
        )
        wait_until(lambda: lab.runner.snapshot.run_number == 2, "another declaration starts anew")
        wait_until(lambda: lab.runner.snapshot.latest["push"][0] == 18.0, "with its new text")
        file.write_text(PD.replace("self.push = common[0]", "1 / 0"))
        wait_until(lambda: lab.runner.snapshot.status.failed, "the run stops")
        assert "mine.py, line" in lab.runner.snapshot.status.text
        assert "ZeroDivisionError" in lab.runner.snapshot.status.text
        number = lab.runner.snapshot.run_number
        file.write_text(mended)
        wait_until(lambda: lab.runner.snapshot.run_number > number, "a new run")
        wait_until(lambda: lab.runner.snapshot.latest.time[0] > 0.05 and lab.runner.snapshot.playing, "it runs again")
        assert lab.lab_state.notice.text == "mine.py was saved: the run restarts with it."
        lab.lab_state.submit(Pause())
        wait_until(lambda: not lab.runner.snapshot.playing, "it is held")
        file.write_text(mended.replace("self.push = common[0]", "self.push = 19.0"))
        wait_until(lambda: "goes on with the new text" in lab.lab_state.notice.text, "it is taken up")
        assert not lab.runner.snapshot.playing, "who paused it plays it"
        lab.lab_state.change({"controller.kind": "pd"})
        wait_until(lambda: lab.runner.snapshot.scenario.controller.kind == "pd", "another law drives the arms")
        file.write_text(PD)
        said = f"mine.py was saved: choose the control law {law.kind} in the menu to use it."
        wait_until(lambda: lab.lab_state.notice.text == said, "it says why nothing changes")


def test_a_law_that_is_saved_again_while_it_loads_acts_at_once(tmp_path: Path):
    file = tmp_path / "mine.py"
    file.write_text(PD)
    law = LAW_FILES.add(file)
    with Session(load_preset("paper").replace({"controller.kind": law.kind}), shadows=False) as lab:
        wait_until(lambda: lab.runner.snapshot.latest.time[0] > 0.1, "the lab runs")
        file.write_text("while True: pass\n" + PD)
        wait_until(lambda: not all(one.is_loaded for one in list(hosts.known.values())), "it loads")
        file.write_text(PD.replace("self.push = common[0]", "self.push = 17.0"))
        wait_until(lambda: lab.runner.snapshot.latest["push"][0] == 17.0, "the new text acts")
        refused = [event.text for event in lab.runner.snapshot.events if event.level == "error"]
        assert len(refused) == 1
        assert "mine.py: it was saved anew while it was loading." in refused[0]


def test_a_saved_module_or_data_file_of_a_law_acts_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "presets" / "laws"
    folder.mkdir(parents=True)
    (folder / "pushes.py").write_text("def push():\n    return 17.0\n")
    (folder / "pushes.txt").write_text("1")
    text = PD.replace("self.push = common[0]", "self.push = pushes.push() + MORE")
    more = 'import pushes\nfrom flexlab import data_file\n\nMORE = float(data_file("pushes.txt").read())\n'
    (folder / "mine.py").write_text(more + text)
    assert LAW_FILES.add_all() == [], "the module is no law, and is not left out"
    with Session(load_preset("paper").replace({"controller.kind": "own-pd"}), shadows=False) as lab:
        wait_until(lambda: lab.runner.snapshot.latest["push"][0] == 18.0, "the law acts")
        for name, change, then in (("pushes.py", ("17.0", "18.0"), 19.0), ("pushes.txt", ("1", "2"), 20.0)):
            (folder / name).write_text((folder / name).read_text().replace(*change))
            wait_until(lambda: lab.runner.snapshot.latest["push"][0] == then, "the new text acts")  # noqa: B023
            wait_until(lambda: lab.lab_state.notice.text.startswith(f"{name} was saved: the"), "it says so")  # noqa: B023
    forget_law("own-pd")


def big(file: Path) -> None:
    with file.open("wb") as made:
        made.truncate(4_000_000_000)


ODD_FILES = {
    "not an ordinary file": os.mkfifo,
    "is not an ordinary file": lambda file: file.symlink_to("/dev/zero"),
    "larger than 0.8 MB": big,
}


@pytest.mark.parametrize("says", ODD_FILES)
def test_a_lab_refuses_odd_files_in_its_folder_of_laws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, says: str):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "presets" / "laws"
    folder.mkdir(parents=True)
    with Session(load_preset("paper"), shadows=False) as lab:
        wait_until(lambda: lab.runner.snapshot.latest.time[0] > 0.1, "the lab runs")
        ODD_FILES[says](folder / "odd.py")
        wait_until(lambda: says in lab.lab_state.notice.text, "the sentence about it")


@pytest.mark.parametrize("made_before", [False, True])
def test_new_files_in_a_persons_folders_appear_in_the_menus(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, made_before: bool
):
    monkeypatch.chdir(tmp_path)
    places = {"laws": PD, "paths": ROUND}
    for folder in places if made_before else ():
        (tmp_path / "presets" / folder).mkdir(parents=True)
    with Session(load_preset("paper"), shadows=False) as lab, RawBrowser(lab):
        wait_until(lambda: lab.runner.snapshot.latest.time[0] > 0.1, "the lab runs")
        for folder, text in places.items():
            (tmp_path / "presets" / folder).mkdir(parents=True, exist_ok=True)
            (tmp_path / "presets" / folder / "mine.py").write_text(text)
        wait_until(lambda: "own-pd" in widget(lab, "Control law").options, "the menu of laws has it")
        wait_until(lambda: "round-trip" in widget(lab, "Path").options, "the menu of paths has it")
        (tmp_path / "presets" / "laws" / "broken.py").write_text("class Mine(OwnLaw:\n")
        said = "broken.py was saved, but cannot be used: broken.py, line 1"
        wait_until(lambda: said in lab.lab_state.notice.text, "the sentence about the text")
        lab.lab_state.change(changes_for("controller.kind", "own-pd"))
        wait_until(lambda: lab.runner.snapshot.scenario.controller.kind == "own-pd", "it takes over")
        (tmp_path / "presets" / "laws" / "mine.py").write_text(PD.replace("self.push = common[0]", "self.push = 17.0"))
        wait_until(lambda: lab.runner.snapshot.latest["push"][0] == 17.0, "the new text acts")


@pytest.mark.parametrize("made_before", [False, True])
def test_a_kernel_that_is_broken_at_first_is_taken_up_when_it_is_mended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, made_before: bool
):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "presets" / "laws" / "leaky.py"
    file.parent.mkdir(parents=True)
    text = (Path(__file__).parents[1] / "control" / "own_laws" / "leaky_integral.py").read_text()
    if made_before:
        file.write_text(text.replace("import Law, Memory", "import Laws, Memory"))
    with Session(load_preset("paper"), shadows=False) as lab:
        wait_until(lambda: lab.runner.snapshot.latest.time[0] > 0.1, "the lab runs")
        for broken in (text[:-20], text.replace("import Law, Memory", "import Laws, Memory")):
            file.write_text(broken)
            wait_until(lambda: "leaky.py cannot be used" in lab.lab_state.notice.text, "the sentence about the text")
            lab.lab_state.say("")
        file.write_text(text)
        wait_until(
            lambda: lab.lab_state.notice.text.endswith("law leaky-integral in the menu to use it."), "the law is known"
        )
        file.write_text(text + "# changed\n")
        wait_until(lambda: "start flexlab again" in lab.lab_state.notice.text, "it says what to do")
    forget_law("leaky-integral")


def test_an_own_law_takes_over_in_motion(tmp_path: Path):
    file = tmp_path / "mine.py"
    file.write_text(PD)
    law = LAW_FILES.add(file)
    with Session(load_preset("paper"), shadows=False) as lab:
        wait_until(lambda: lab.runner.snapshot.latest.time[0] > 0.1, "the lab runs")
        lab.lab_state.change(changes_for("controller.kind", law.kind))
        wait_until(lambda: lab.runner.snapshot.scenario.controller.kind == law.kind, "it takes over")
        at = lab.runner.snapshot.latest.time[0]
        wait_until(lambda: lab.runner.snapshot.latest.time[0] > at + 0.5, "it drives on")
        # The law has a signal of its own: a new recording begins, the motion goes on.
        assert lab.runner.snapshot.start_time > 0.1
        assert lab.runner.snapshot.scenario.controller.source == PD
        lab.lab_state.change(changes_for("controller.kind", "pd"))
        wait_until(lambda: lab.runner.snapshot.scenario.controller.kind == "pd", "the built-in law takes over")
