"""Other engines on the paper's system, for `flexlab bench --peers`: verified to move the same, then timed."""
