"""Registries of laws and paths: files that change, and several threads that add and forget."""

import os
import threading
from pathlib import Path

from flexlab.registry import Registry, module_from_file


class Named:
    """An entry; one that is `slow` waits in the middle of being added."""

    def __init__(self, kind: str, slow: bool = False):
        self.kind, self._slow = kind, slow
        self.asked, self.may_go_on = threading.Event(), threading.Event()

    @property
    def place(self) -> int:
        if self._slow:
            self.asked.set()
            self.may_go_on.wait(10)
        return 0


def test_adding_in_one_thread_does_not_restore_what_another_forgets():
    known, other = Registry(Named, "law", "LAW", "flexlab.control.paths"), Named("other", slow=True)
    known._built_in = True
    known.add(Named("forgotten"))
    adding = threading.Thread(target=known.add, args=(other,))
    adding.start()
    assert other.asked.wait(10)
    forgetting = threading.Thread(target=known.forget, args=("forgotten",))
    forgetting.start()
    forgetting.join(0.1)  # Without a lock it has already forgotten by now.
    other.may_go_on.set()
    for thread in (adding, forgetting):
        thread.join(10)
    assert list(known.all()) == ["other"]


def test_a_file_is_read_as_it_is_now(tmp_path: Path):
    """Python takes its own cached bytecode for a text of the same length that was saved within the same second."""
    file, read = tmp_path / "one.py", []
    for value in (1, 2):
        file.write_text(f"VALUE = {value}\n")
        os.utime(file, (1e9, 1e9))
        read.append(module_from_file(file).VALUE)
    assert read == [1, 2]
