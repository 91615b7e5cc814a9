"""A person's own laws and paths by their files, also in a process that works for another one."""

import contextlib
from pathlib import Path

from flexlab.control import own_law_hosts as hosts
from flexlab.control.own_folder import OwnFolder
from flexlab.control.own_law import OWN_LAWS
from flexlab.control.own_path import OWN_PATHS
from flexlab.errors import ScenarioError
from flexlab.own_laws.declaration import OwnLaw, read_declaration
from flexlab.own_paths.declaration import OwnPath, read_path_declaration

LAW_FILES = OwnFolder("laws", OWN_LAWS, OwnLaw, read_declaration, "a control law", "pd")
law_files, law_kind, add_own_law_file = LAW_FILES.files, LAW_FILES.kind_of, LAW_FILES.add
PATH_FILES = OwnFolder("paths", OWN_PATHS, OwnPath, read_path_declaration, "a desired motion", "circle")
path_files, path_kind, add_own_path_file = PATH_FILES.files, PATH_FILES.kind_of, PATH_FILES.add


def know_own_files(allowed: dict[str, str]) -> None:
    """Let run what that process allows (`own_law_hosts.allowed`), in processes of their own; know its files."""
    hosts.run_apart()
    hosts.allow_digests(allowed)
    for file in dict.fromkeys(allowed.values()):
        if Path(file).is_file():
            with contextlib.suppress(ScenarioError):  # Said already by the process that allows it.
                (PATH_FILES if PATH_FILES.holds(file) else LAW_FILES).add(file)
