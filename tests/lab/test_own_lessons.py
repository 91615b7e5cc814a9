"""A person's own lessons: read from files and checked by expressions; for bad ones, line and reason are given."""

import os
import re
import sys
from pathlib import Path

import pytest
from lab_page import wait_until

from flexlab.analysis import own_lessons as own_lesson_files
from flexlab.analysis.lesson_checks import Verdict, read_check
from flexlab.analysis.lesson_expressions import ExpressionError, expression
from flexlab.analysis.lesson_measures import Look
from flexlab.analysis.own_lessons import MOST, OwnLesson, lesson_menu, lesson_mistakes, own_lessons, short_name
from flexlab.lab.lab_state import Outside
from flexlab.lab.panel.guide_panel import Guide
from flexlab.lab.session import Session
from flexlab.lab.widgets import Widgets
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import Play, SetSpeed
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import simulate

EXAMPLE = (own_lesson_files.__doc__ or "").partition(":\n\n")[2].replace("\n    ", "\n").strip() + "\n"
RUN = simulate(load_preset("paper"), 1.0, 0.001)
SAMPLES = RUN.slice(0, len(RUN))


def write(folder: Path, text: str) -> OwnLesson:
    (folder / "mine.md").write_text(text, encoding="utf-8")
    (lesson,) = own_lessons(folder)
    return lesson


def verdict(own: OwnLesson, scenario: Scenario, samples: Samples) -> Verdict:
    assert own.lesson is not None
    return read_check(own.lesson).verdict(scenario, samples)


def test_the_documented_example_is_a_valid_lesson(tmp_path: Path) -> None:
    own = write(tmp_path, EXAMPLE)
    assert own.problem == ""
    assert own.lesson is not None
    assert (own.lesson.title, own.lesson.answer) == ("Stiffer", "it gets faster and smaller")
    found = verdict(own, load_preset("paper"), SAMPLES)
    assert (found.done, found.sentence) == (False, "Move the slider of EI to the right.")
    stiff = simulate(load_preset("paper").replace({"payload.bending_stiffness": 600.0}), 1.2, 0.001)
    assert verdict(own, stiff.scenario, stiff.slice(0, len(stiff))).done


def test_two_own_lessons_have_different_short_names(tmp_path: Path) -> None:
    """Guesses in each of them used to be labelled "Own lesson" and nothing else."""
    for file, title in (("a.md", "Stiffer: more EI"), ("b.md", "Softer"), ("c.md", "Softer")):
        (tmp_path / file).write_text(EXAMPLE.replace("title: Stiffer", f"title: {title}"), encoding="utf-8")
    shown = [short_name(name) for name in lesson_menu(own_lessons(tmp_path))]
    assert shown[0] == "Lesson 1"
    assert shown[-3:] == ["Stiffer: more EI", "Softer (b)", "Softer (c)"]


def test_a_byte_order_mark_before_a_lesson_is_ignored(tmp_path: Path) -> None:
    assert write(tmp_path, "\ufeff" + EXAMPLE).lesson is not None


def test_html_in_a_lesson_is_escaped(tmp_path: Path) -> None:
    own = write(tmp_path, EXAMPLE.replace("Does the beam", "<script>alert(1)</script> Does the beam"))
    assert own.lesson is not None
    assert "<script" not in own.lesson.text


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("---\ntitle", "title", "line 1: a lesson begins with a line ---"),
        ("preset: paper", "preset: papper", "line 3: there is no preset 'papper'"),
        ("preset: paper\n", "", "the head has no preset"),
        ("preset: paper", "colour: blue", "line 3: 'colour: blue' is not a field"),
        ("## Observe", "## Look", "there is no line ## Observe"),
        ("- [x]", "- [ ]", "one line - [x] with what is right"),
        ("bending_stiffness > 500 and t > 1", "bending_stiffness > 500 and zeit > 1", "line 4: zeit is not a metric"),
        (
            "scenario.payload.bending_stiffness > 500 and t > 1",
            "t +",
            "line 4: the check 't +' cannot be read (invalid syntax)",
        ),
        ("bending_stiffness > 500 and t > 1", "bending_stiffness > 500and zeit > 1", "line 4: zeit is not a metric"),
        ("scenario.payload.bending_stiffness > 500 and t > 1", "ring", "line 4: ring is not a metric"),
        ("scenario.payload.bending_stiffness > 500 and t > 1", "largest(vibration)", "is not a comparison"),
        ("scenario.payload.bending_stiffness > 500 and t > 1", "vibration < 1", "use largest, rms"),
        ("scenario.payload.bending_stiffness > 500 and t > 1", "largest(sound) < 1", "sound is not a signal"),
    ],
)
@pytest.mark.filterwarnings("error::SyntaxWarning")
def test_for_a_bad_lesson_line_and_reason_are_given(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in EXAMPLE
    own = write(tmp_path, EXAMPLE.replace(old, new))
    assert own.lesson is None
    assert own.problem.startswith("mine.md is not a lesson: line ")
    assert said in own.problem
    assert lesson_mistakes(tmp_path) == [own.problem]


def test_all_mistakes_of_a_lesson_are_said_at_once(tmp_path: Path) -> None:
    bad = EXAMPLE.replace("title: Stiffer", "titel: Stiffer").replace("preset: paper", "preset: papper")
    bad = bad.replace("- [x]", "- [ ]").replace("and t > 1", "and zeit > 1")
    said = write(tmp_path, bad).problem
    for part in (
        "line 2: 'titel: Stiffer' is not a field", "the head has no title", "line 3: there is no preset 'papper'",
        "line 4: zeit is not a metric", "one line - [x] with what is right",
    ):  # fmt: skip
        assert part in said


@pytest.mark.parametrize("titles", [["## Observe"], ["## Do"], ["## Do", "## Observe"]])
def test_a_missing_part_hides_no_other_mistake(tmp_path: Path, titles: list[str]) -> None:
    bad = re.sub("check: .*\n", "", EXAMPLE).replace("preset: paper", "preset: papper").replace("- [x]", "- [ ]")
    for title in titles:
        bad = bad.replace(f"{title}\n", "")
    said = write(tmp_path, bad + "\n## Check\nif zeit < 1: Wait.\ndone: It is done.\n").problem
    wrong = [f"there is no line {title}: a lesson has" for title in titles]
    wrong += ["no preset 'papper'", "one line - [x] with what is right", "zeit is not a metric"]
    assert [part for part in wrong if part not in said] == []
    assert "no check" not in said


@pytest.mark.parametrize("part", ["head", "rules"])
def test_of_very_many_mistakes_only_the_first_are_listed(tmp_path: Path, part: str) -> None:
    bad = EXAMPLE.replace("title: Stiffer", "\n".join(["title: Stiffer", *(f"field {n}" for n in range(9000))]))
    if part == "rules":
        bad = re.sub("check: .*\n", "", EXAMPLE) + "\n## Check\n" + "if zeit < 1: Wait.\n" * 9000
    said = write(tmp_path, bad).problem
    assert "more lines are wrong" in said
    assert len(said) < 30_000


def test_lessons_beyond_the_most_of_a_menu_are_not_left_out_silently(tmp_path: Path) -> None:
    for number in range(MOST + 2):
        (tmp_path / f"lesson-{number:02}.md").write_text(EXAMPLE.replace("Stiffer", f"Stiffer {number}"))
    *read, first_left = own_lessons(tmp_path)
    assert [own.problem for own in read] == [""] * MOST
    assert first_left.problem == (
        f"lesson-{MOST}.md: the menu holds at most {MOST} lessons, and leaves out this one and those after it by name: "
        "remove some."
    )


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_lesson_whose_file_name_is_not_utf_8_can_be_shown(tmp_path: Path) -> None:
    (tmp_path / os.fsdecode(b"b\xfcrste.md")).write_text("no lesson")
    [own] = own_lessons(tmp_path)
    assert own.name == "b\N{REPLACEMENT CHARACTER}rste"
    own.problem.encode()


def test_folders_broken_links_and_pipes_are_not_lessons(tmp_path: Path) -> None:
    (tmp_path / "folder.md").mkdir()
    (tmp_path / "gone.md").symlink_to("nowhere")
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.md")
    assert [own.lesson for own in own_lessons(tmp_path)] == [None] * len(list(tmp_path.iterdir()))


def test_all_mistakes_in_the_rules_of_a_lesson_are_said_at_once(tmp_path: Path) -> None:
    rules = "\n## Check\nsize = largest(sound)\nif zeit < 1: Wait.\nperhaps\nt = t + 1\nsize = 2\ndone if size > 1: It is loud.\n"
    head = re.sub("check: .*\n", "", EXAMPLE)
    said = write(tmp_path, head + rules).problem
    for part in (
        "sound is not a signal",
        "zeit is not a metric",
        "'perhaps' is not a rule",
        "'t = t + 1' gives a second meaning to a name",
        "'size = 2' gives a second meaning to a name",
        "the last rule must be done: or else:",
    ):
        assert part in said
    assert "size is no" not in said, "it was named"


def test_a_name_of_a_lessons_own_may_hide_that_of_a_value(tmp_path: Path) -> None:
    rules = "\n## Check\nt = 5\ndone if t > 4: Yes.\nelse: No.\n"
    own = write(tmp_path, re.sub("check: .*\n", "", EXAMPLE) + rules)
    assert verdict(own, load_preset("paper"), SAMPLES).done


def test_names_that_need_each_other_too_often_end_in_a_sentence(tmp_path: Path) -> None:
    chain = "n0 = t\n" + "".join(f"n{k + 1} = n{k}\n" for k in range(1000))
    own = write(
        tmp_path, re.sub("check: .*\n", "", EXAMPLE) + f"\n## Check\n{chain}done if n1000 > 1: Yes.\nelse: No.\n"
    )
    assert "cannot be worked out in this run" in verdict(own, load_preset("paper"), SAMPLES).sentence


@pytest.mark.parametrize(
    "measure",
    [
        "imbalance(5, 6)",
        "largest(vibration, 5, 6)",
        "mean(pose, 0.6, 0.5)",
        "ring_frequency(0.5, 0.5)",
        "settled(5, 6)",
    ],
)
def test_a_measure_of_no_samples_is_no_result(tmp_path: Path, measure: str) -> None:
    """The imbalance of no forces was 0, and its check held before there was anything to measure."""
    own = write(tmp_path, re.sub("check: .*\n", f"check: {measure} < 1\n", EXAMPLE))
    told = verdict(own, load_preset("paper"), SAMPLES)
    assert not told.done
    assert f"({measure}: there are too few samples from t = " in told.sentence


def test_sentences_of_lessons_write_lengths_and_missing_measures_as_elsewhere(tmp_path: Path) -> None:
    rules = "\n## Check\ndone if torque_jump(0, 1) < 1: It is smooth.\nelse: {0 - 0.0125:length}, {0 - 2e-6:length}.\n"
    own = write(tmp_path, re.sub("check: .*\n", "", EXAMPLE) + rules)
    told = verdict(own, load_preset("paper"), SAMPLES)
    assert told == (False, "−12.50 mm, −2.0 µm."), (
        "the paper's law is continuous: no torque jumps from sample to sample"
    )


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("settling_time < 0.5", True),
        ("not settling_time < 0.5", False),
        ("largest(tracking_error[0:2]) > 1e-3 and t > 0.9", True),
        ("0.001 < largest(vibration) < 0.01", True),
        ("last(pose[1]) - first(pose[1]) == 0", False),
        ("rms(joint_torque[0, 1]) > 1", True),
        ("mean(time) > 0.4 or t > 100", True),
        ("scenario.controller.kind == 'adaptive-sliding-mode'", True),
        ("-scenario.payload.length * 2 == -1", True),
    ],
)
def test_expressions_over_metrics_signals_and_fields(text: str, holds: bool) -> None:
    assert expression(text, truth=True)(Look(load_preset("paper"), SAMPLES, ())) is holds


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('x') == 0",
        "(lambda: 1)() == 1",
        "t.real > 0",
        "[x for x in t] == 1",
        "largest(vibration[t]) > 1",
        "largest(joint_torque[(0, 0, 0), ((0,), (0,))]) > 1",
        "scenario.__class__ == 1 and open('x') > 1",
        "2 ** 99999999 > 1",
        "(" * 300 + "t" + ")" * 300 + " > 1",
        "t > 1; t < 2",
    ],
)
def test_expressions_cannot_do_anything_else(text: str) -> None:
    with pytest.raises(ExpressionError):
        expression(text, truth=True)


def test_an_own_lesson_is_checked_in_the_lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lessons").mkdir()
    write(tmp_path / "lessons", EXAMPLE)
    monkeypatch.chdir(tmp_path)
    stiff = load_preset("paper").replace({"payload.bending_stiffness": 600.0})
    with Session(load_preset("paper"), "paper", shadows=False) as session:
        guide = Guide(Widgets(session.server.gui, session.lab_state))
        guide._turn_to("Own lesson: Stiffer")
        assert session.lab_state.lesson == "Stiffer: step 1 of 3 (guess)"
        guide._take_guess("nothing")
        session.lab_state.load(stiff, "stiff")
        session.lab_state.submit(SetSpeed(4.0))
        session.lab_state.submit(Play())

        def done() -> bool:
            guide.update(session.runner.snapshot)
            return session.lab_state.lesson == "Stiffer: done"

        wait_until(done, "the check holds in the run that is shown", 20)
    # The same person's next lab goes on from there.
    outside = Outside(lesson=session.lab_state.lesson, lessons=tuple(session.lab_state.lessons.values()))
    with Session(load_preset("paper"), "paper", shadows=False, outside=outside) as again:
        guide = Guide(Widgets(again.server.gui, again.lab_state))
        assert (guide._menu.widget.value, guide._guess.widget.value) == ("Own lesson: Stiffer", "nothing")
        assert guide._answer.visible
        assert again.lab_state.lessons == session.lab_state.lessons
        assert again.lab_state.lesson == "Stiffer: done"


@pytest.mark.parametrize("part", ["\n## Guess\n", "\n## Do\n", "\n## Observe\n", "\n---\n", "- [x] a\n", "<"])
def test_a_long_lesson_of_repeated_parts_is_read_at_once(tmp_path: Path, part: str) -> None:
    """A search that starts again at each part takes 21 minutes for 101 kB."""
    head, _, rest = EXAMPLE.partition("## Guess")
    for text in (
        head + part * (100_000 // len(part)),
        EXAMPLE + part * (100_000 // len(part)),
        head + part * 9000 + rest,
    ):
        write(tmp_path, text)


@pytest.mark.parametrize(
    "text",
    [
        "'a' * 9999999999 == 'b'",
        "scenario.title * 9999999999 == 'b'",
        "9999999999 * scenario.trajectory.kind == 3",
        "-scenario.trajectory.kind < 1",
    ],
)
def test_a_check_computes_only_with_numbers(tmp_path: Path, text: str) -> None:
    own = write(tmp_path, EXAMPLE.replace("scenario.payload.bending_stiffness > 500 and t > 1", text))
    if own.problem:
        assert "a text can only be compared" in own.problem
    else:
        assert "is not a number here" in verdict(own, load_preset("paper"), SAMPLES).sentence


def test_new_and_changed_lesson_files_are_taken_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with Session(load_preset("paper"), "paper", shadows=False) as session:
        guide = Guide(Widgets(session.server.gui, session.lab_state))
        before = guide._menu.widget.options
        (tmp_path / "lessons").mkdir()
        for text, title in ((EXAMPLE.replace("t >", "zeit >"), "mine (cannot be read)"), (EXAMPLE, "Stiffer")):
            write(tmp_path / "lessons", text)
            guide.update(session.runner.snapshot)
            assert guide._menu.widget.options == (*before, f"Own lesson: {title}")
