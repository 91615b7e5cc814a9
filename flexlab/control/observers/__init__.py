"""What laws estimate of the beam from what a sampled controller measures."""
