"""Studies of runs and scenarios: metrics, modes and poles, comparison, replay, sweeps, tuning, identification, validation."""
