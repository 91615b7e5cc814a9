"""A person's own laws and paths in a process that works for another one."""

import contextlib
from pathlib import Path

from flexlab.control import own_law_hosts as hosts
from flexlab.control.own_law_files import add_own_law_file
from flexlab.control.own_path_files import add_own_path_file, holds_path
from flexlab.errors import ScenarioError


def know_own_files(allowed: dict[str, str]) -> None:
    """Let run what that process allows (`own_law_hosts.allowed`), in processes of their own; know its files."""
    hosts.run_apart()
    hosts.allow_digests(allowed)
    for file in dict.fromkeys(allowed.values()):
        if Path(file).is_file():
            with contextlib.suppress(ScenarioError):  # Said already by the process that allows it.
                if holds_path(file):
                    add_own_path_file(file)
                else:
                    add_own_law_file(file)
