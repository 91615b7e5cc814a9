"""The desired motions, one file each: model and kernel. See `flexlab.control.path`."""
