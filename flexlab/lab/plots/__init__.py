"""The plots in the browser: signals over time, and the spectrum."""
