"""The live lab: the scene, panel, plots and input of one session, shown with viser."""
