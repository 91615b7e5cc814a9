"""Registries of laws and paths when several threads change them."""

import threading

from flexlab.registry import Registry


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
