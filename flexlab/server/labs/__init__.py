"""The labs behind the front server: one for all visitors, or a process for each."""
