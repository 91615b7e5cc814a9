"""The names of the Python interface, said once: type checkers read them here, and `__init__.py` where each lives."""

from flexlab.analysis.comparison import Comparison as Comparison
from flexlab.analysis.explanations import Explained as Explained
from flexlab.analysis.identification.fitting import Fit as Fit
from flexlab.analysis.internal_force import internal_force_eq_26 as internal_force_eq_26
from flexlab.analysis.leaderboard.board import Leaderboard as Leaderboard
from flexlab.analysis.linear_model import LinearModel as LinearModel
from flexlab.analysis.linearize import linearize as linearize
from flexlab.analysis.metrics import RunMetrics as RunMetrics
from flexlab.analysis.metrics.own import metric as metric
from flexlab.analysis.modes import Modes as Modes
from flexlab.analysis.modes import modes as modes
from flexlab.analysis.replay import Replay as Replay
from flexlab.analysis.result import Result as Result
from flexlab.analysis.sweep.result import Sweep as Sweep
from flexlab.analysis.tuning import Tuning as Tuning
from flexlab.analysis.validation import Validation as Validation
from flexlab.analysis.validation import validate as validate
from flexlab.api import Run as Run
from flexlab.api import explain as explain
from flexlab.api import export_fmu as export_fmu
from flexlab.api import read as read
from flexlab.api import simulate as simulate
from flexlab.api import simulate_many as simulate_many
from flexlab.api import sweep as sweep
from flexlab.notebook import Lab as Lab
from flexlab.own.declaration import OwnLaw as OwnLaw
from flexlab.own.declaration import OwnPath as OwnPath
from flexlab.own.declaration import gain as gain
from flexlab.own.declaration import memory as memory
from flexlab.own.declaration import option as option
from flexlab.own.declaration import readout as readout
from flexlab.own.measurement import Measurement as Measurement
from flexlab.own.reading import data_file as data_file
from flexlab.presets import load_preset as load_preset
from flexlab.presets import preset_names as preset_names
from flexlab.scenario import Scenario as Scenario
from flexlab.scenario import parse_scenario as parse_scenario
from flexlab.sim.samples import Samples as Samples
from flexlab.study_api import compare as compare
from flexlab.study_api import export as export
from flexlab.study_api import fit as fit
from flexlab.study_api import leaderboard as leaderboard
from flexlab.study_api import replay as replay
from flexlab.study_api import tune as tune

__version__: str
