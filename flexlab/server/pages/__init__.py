"""The pages of the front server."""
