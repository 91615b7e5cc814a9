"""The panel in the browser: what a person can change and read."""
