"""Settings of jupyter-server-proxy that put flexlab into the launcher of JupyterLab and JupyterHub (extra `jupyter`)."""

from pathlib import Path
from typing import Any

PATIENCE = 180
"""Longest time for a lab to open, s: the first start on a machine compiles the engine."""


def lab_server() -> dict[str, Any]:
    """How jupyter-server-proxy starts a person's lab: on a socket that only they can open, under their own address.

    Runs go to the folder flexlab/logs in their home.
    """
    icon = Path(__file__).with_name("server") / "static" / "icon.svg"
    logs = Path.home() / "flexlab" / "logs"
    return {
        "command": [
            "flexlab", "--host", "unix:{unix_socket}", "--base-url", "{base_url}flexlab", "--no-browser", "--logs", str(logs),
        ],
        "unix_socket": True,
        "timeout": PATIENCE,
        "new_browser_tab": True,
        "launcher_entry": {"title": "flexlab", "icon_path": str(icon), "path_info": "flexlab/lab/"},
    }  # fmt: skip
