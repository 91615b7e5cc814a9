"""A scenario's mechanics as rigid bodies, springs and dampers, in the files that other simulators of robots read."""
