"""Finds a Chromium for the browser tests, and installs one where there is none: `python tests/get_browser.py`."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

LIGHTEST = "chromium-headless-shell"
"""Debian's Chromium without windows: it shows a lab for three quarters of the processor time."""
NAMES = (LIGHTEST, "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
ON_MACOS = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
)


def find_browser() -> str | None:
    """Return the path of a Chromium: that in FLEXLAB_CHROMIUM, the system's, or playwright's own; None if there is none."""
    named = os.environ.get("FLEXLAB_CHROMIUM")
    if named:
        return named
    for name in NAMES:
        path = shutil.which(name)
        if path:
            return path
    for path in ON_MACOS:
        if Path(path).exists():
            return path
    return _of_playwright()


def _of_playwright() -> str | None:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        path = playwright.chromium.executable_path
    return path if Path(path).exists() else None


def _install() -> None:
    """Install a package of Debian or Ubuntu if we are root there, else the build that playwright offers."""
    if shutil.which("apt-get") and hasattr(os, "geteuid") and os.geteuid() == 0:
        environment = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
        subprocess.run(["apt-get", "-qq", "update"], check=True, env=environment)
        install = ["apt-get", "-qq", "install", "--yes", "--no-install-recommends"]
        if subprocess.run([*install, LIGHTEST], env=environment, capture_output=True, check=False).returncode:
            subprocess.run([*install, "chromium"], check=True, env=environment, stdout=subprocess.DEVNULL)
    else:
        subprocess.run([sys.executable, "-m", "playwright", "install", "chromium"], check=True)


def main() -> int:
    """Print which browser the tests will use; return 1 if there is none and none could be installed."""
    if find_browser() is None:
        try:
            _install()
        except (OSError, subprocess.CalledProcessError) as error:
            print(
                f"No Chromium could be installed ({error}): install it yourself, then run the tests.", file=sys.stderr
            )
            return 1
    print(f"The browser tests use {find_browser()}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
