"""The example of a lesson in the documentation is valid."""

import re
from pathlib import Path

from flexlab.analysis.own_lessons import own_lessons


def test_the_lesson_in_the_documentation_is_valid(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "web_assets/docs/pages/class.md").read_text(encoding="utf-8")
    example = re.search(r"```markdown\n(.*?)```", page, re.S)
    assert example is not None
    (tmp_path / "stiffer.md").write_text(example[1], encoding="utf-8")
    (own,) = own_lessons(tmp_path)
    assert own.problem == ""
