"""The lesson in the README is one."""

import re
from pathlib import Path

from flexlab.analysis.own_lessons import own_lessons


def test_the_lesson_in_the_readme_is_a_lesson(tmp_path: Path) -> None:
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    example = re.search(r"```markdown\n(.*?)```", readme, re.S)
    assert example is not None
    (tmp_path / "stiffer.md").write_text(example[1], encoding="utf-8")
    (own,) = own_lessons(tmp_path)
    assert own.problem == ""
