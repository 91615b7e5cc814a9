"""Time integrators, one file each; `step.take_stage` calls the one whose constants a `Scheme` holds."""
