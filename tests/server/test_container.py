"""The container, tested without one: what it copies builds flexlab, and the server that it starts is healthy."""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from http_client import ask
from lab_process import Lab

from flexlab.server.settings import Settings

WORDS = {"FLEXLAB_TOKEN": "the-word-of-the-class", "FLEXLAB_TEACHER_TOKEN": "the-word-of-the-teacher"}


@pytest.fixture(scope="module")
def steps(root: Path) -> list[tuple[str, str]]:
    """The Dockerfile's lines, each as (instruction, what follows it)."""
    text = (root / ".github" / "Dockerfile").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [(name, rest) for name, _, rest in (line.partition(" ") for line in lines)]


@pytest.fixture(scope="module")
def service(root: Path) -> dict:
    """The service that compose starts."""
    return yaml.safe_load((root / ".github" / "compose.yaml").read_text(encoding="utf-8"))["services"]["flexlab"]


@pytest.fixture(scope="module")
def installed(root: Path, steps: list[tuple[str, str]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which pip installed flexlab from what the Dockerfile copies, and from nothing else."""
    context, site = tmp_path_factory.mktemp("build"), tmp_path_factory.mktemp("site")
    for name, rest in steps:
        if name == "COPY" and not rest.startswith("--from"):
            *sources, target = rest.split()
            for source in sources:
                if (root / source).is_dir():
                    shutil.copytree(root / source, context / target)
                else:
                    shutil.copy(root / source, context / target)
    [line] = (rest for name, rest in steps if name == "RUN" and "pip install" in rest)
    options = shlex.split(line.partition("pip install")[2])
    # The dependencies are installed here already, so no network is needed.
    pip = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--target",
        str(site),
    ]
    subprocess.run([*pip, *options], cwd=context, check=True, stdin=subprocess.DEVNULL)
    return site


def one(steps: list[tuple[str, str]], name: str) -> str:
    [rest] = (rest for instruction, rest in steps if instruction == name)
    return rest


def test_everything_that_is_copied_is_tracked_by_git(root: Path, steps: list[tuple[str, str]]):
    copied = [word for name, rest in steps if name == "COPY" and "--from" not in rest for word in rest.split()[:-1]]
    assert {"pyproject.toml", "flexlab"} <= set(copied)
    listed = subprocess.run(["git", "ls-files", *copied], cwd=root, capture_output=True, text=True, check=True).stdout
    tracked = {line.partition("/")[0] for line in listed.splitlines()}
    assert tracked == set(copied)


def test_dockerfile_and_compose_name_the_default_port(steps: list[tuple[str, str]], service: dict):
    port = str(Settings().port)
    assert one(steps, "EXPOSE") == port
    assert f"127.0.0.1:{port}/" in one(steps, "HEALTHCHECK")
    assert service["ports"] == [f"{port}:{port}"]


def test_runs_stay_in_the_volume(steps: list[tuple[str, str]], service: dict):
    assert one(steps, "VOLUME") == [rest for name, rest in steps if name == "WORKDIR"][-1]
    assert service["volumes"] == [f"runs:{one(steps, 'VOLUME')}"]


def test_pip_needs_nothing_but_what_is_copied(installed: Path, steps: list[tuple[str, str]]):
    command = installed / "bin" / json.loads(one(steps, "ENTRYPOINT"))[0]
    environment = os.environ | {"PYTHONPATH": str(installed)}
    done = subprocess.run([command, "presets"], env=environment, cwd=installed, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "vibration-damping" in done.stdout
    [module] = (rest.split()[-1] for name, rest in steps if name == "RUN" and "python -m flexlab" in rest)
    assert (installed / module.replace(".", "/")).with_suffix(".py").is_file()


@pytest.fixture(params=["Dockerfile", "compose"])
def arguments(request: pytest.FixtureRequest, steps: list[tuple[str, str]], service: dict) -> list[str]:
    """The arguments that the container gives flexlab, by itself or from compose."""
    if request.param == "Dockerfile":
        return json.loads(one(steps, "CMD"))
    return [re.sub(r"\$\{(\w+):\?[^}]*\}", lambda found: WORDS[found[1]], word) for word in service["command"]]


def test_the_server_in_the_container_is_healthy_until_it_is_stopped(
    start_lab: Callable[..., Lab], steps: list[tuple[str, str]], arguments: list[str]
):
    command, *words = json.loads(one(steps, "ENTRYPOINT"))
    assert command == "flexlab"
    assert "--no-browser" in words  # `start_lab` adds it itself.
    lab = start_lab(*(word for word in words if word != "--no-browser"), *arguments)
    port = lab.port()
    check = json.loads(one(steps, "HEALTHCHECK").partition("CMD ")[2])
    assert check[0] == "python"
    check = [sys.executable, *(word.replace(f":{Settings().port}/", f":{port}/") for word in check[1:])]
    subprocess.run(check, check=True)
    assert ask(lab.url(), "/").status in (401, 403), "a word opens it"
    for word in set(WORDS.values()) & set(arguments):
        assert ask(lab.url(), f"/?token={word}").status == 303
    assert lab.end(signal.SIGTERM) == 0
    assert {path.name for path in lab.folder.iterdir()} <= {"logs"}
    assert subprocess.run(check, stderr=subprocess.DEVNULL).returncode != 0, "what does not answer is not healthy"
