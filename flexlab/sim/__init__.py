"""The engine: from a scenario to samples, deterministically, live or headless."""
