"""The live lab: one session's scene, panel, plots and hands, drawn by viser."""
