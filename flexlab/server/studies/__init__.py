"""The studies of the page *Studies*, one per file: what its form asks, its computation and its page."""
