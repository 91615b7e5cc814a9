"""Time integrators, one file each; `step.integrate` chooses by the number in a `Scheme`."""
