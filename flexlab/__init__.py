"""flexlab: two planar arms carry a flexible beam, simulated, controlled, seen live and recorded."""

__version__ = "0.1.0"
