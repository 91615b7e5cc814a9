"""The few numbers by which runs are told apart and compared.

A file here that registers a metric is all that a new one takes; `metric.py` says how.
"""

import pkgutil
from importlib import import_module

from flexlab.analysis.metrics.metric import METRICS, Column, Metric, register
from flexlab.analysis.metrics.run_metrics import MetricCollection, MetricRow, RunMetrics, run_metrics

for module in pkgutil.iter_modules(__path__):
    import_module(f"{__name__}.{module.name}")

__all__ = ["METRICS", "Column", "Metric", "MetricCollection", "MetricRow", "RunMetrics", "register", "run_metrics"]
