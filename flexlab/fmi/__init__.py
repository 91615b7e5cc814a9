"""A scenario as a functional mock-up unit (FMI): the kernels' machine code behind the interface that other tools know."""
