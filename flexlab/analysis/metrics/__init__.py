"""Metrics: the numbers by which runs are compared. To add one, add a file here that registers it; `metric.py` says how."""

from flexlab.analysis.metrics.metric import METRICS, Column, Metric, register
from flexlab.analysis.metrics.run_metrics import MetricCollection, MetricRow, RunMetrics, run_metrics
from flexlab.registry import modules_in

modules_in(__name__)

__all__ = ["METRICS", "Column", "Metric", "MetricCollection", "MetricRow", "RunMetrics", "register", "run_metrics"]
