"""The texts inside a recording: parameters for people, properties and the scenario for programs."""

import json
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import llvmlite
import llvmlite.binding
import numba
import numpy as np
import rerun as rr

from flexlab.recording.recorded_plots import REAL_TIME_FACTOR, plot_signals
from flexlab.recording.run_info import RunInfo
from flexlab.recording.store.formats import ARITHMETIC, FORMAT, OLDEST_READER
from flexlab.scenario import Scenario
from flexlab.sim.signals import TABLE, own_signals


def parameters_text(info: RunInfo) -> str:
    """Markdown: what this run is, for the view beside the plots."""
    scenario, name, factor = info.scenario, info.name, info.exaggeration
    if info.measured:
        beside = f"It is held against the beam of the scenario below{f': {scenario.title}' if scenario.title else ''}."
        return f"# {name}\n\n{info.measured}\n\n{beside}\n\n```json\n{scenario_json(scenario)}\n```\n"
    heading = scenario.title or name
    notes = (
        f"- preset or file: **{name}**\n"
        f"- The beam's deflection is drawn **{factor:g} times** its size; plots are true.\n"
        "- Purple: desired pose and path. Orange arrows: internal force (1 m is 1000 N)."
    )
    return f"# {heading}\n\n{scenario.watch}\n\n{notes}\n\n```json\n{scenario_json(scenario)}\n```\n"


def signals_text(scenario: Scenario) -> str:
    """Markdown: what each plotted signal is, in SI units and with its equation."""
    rows = [f"| {s.entity} | {s.title} | {s.meaning} |" for s in (*plot_signals(scenario), REAL_TIME_FACTOR)]
    table = "\n".join(["| entity | signal | meaning |", "|---|---|---|", *rows])
    exact = "`exact/samples` holds all of these in SI units and double precision; `flexlab.read` gives them back."
    lines = [f"- `{signal.name}`: {signal.text}" for signal in (*TABLE.values(), *own_signals(scenario))]
    return "\n\n".join([f"# Signals\n\n{table}", exact, "\n".join(lines)]) + "\n"


def scenario_json(scenario: Scenario) -> str:
    """The whole scenario as indented JSON; numbers keep every bit."""
    return json.dumps(scenario.model_dump(mode="json"), indent=1, ensure_ascii=False)


def run_properties(info: RunInfo) -> rr.AnyValues:
    """What a listing of recordings shows: where the run came from and what wrote it."""
    values: dict[str, Any] = {
        "format": FORMAT,
        "oldest_reader": OLDEST_READER,
        "preset": info.name,
        "title": info.scenario.title,
        "started": info.started.isoformat(timespec="seconds"),
        "part": info.part,
        "sample_period_s": info.sample_period,
        "scenario": info.scenario.model_dump_json(),
        "rerun_version": rr.__version__,
        **(info.recorded_by or these_versions()),
    }
    return rr.AnyValues(**values)


def these_versions() -> dict[str, str]:
    """What computes samples here."""
    return {
        "arithmetic": ARITHMETIC,
        "flexlab_version": package_version(),
        "numpy_version": np.__version__,
        "numba_version": numba.__version__,
        "llvmlite_version": llvmlite.__version__,
        "python_version": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "processor": llvmlite.binding.get_host_cpu_name(),
    }


def package_version() -> str:
    """flexlab's own version, or "unknown" for a copy that was never installed."""
    try:
        return version("flexlab")
    except PackageNotFoundError:
        return "unknown"
