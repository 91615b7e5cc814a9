"""Where what stands in the numbers that go between the engine and a law in Python, both ways: (MESSAGE_SIZE,) of float64."""

from flexlab.own_laws.declaration import MOST_GAINS, MOST_MEMORY, MOST_SIGNALS

TURN = 0
"""Room for the byte that says whose turn it is."""
OUTCOME = 1
"""What became of the call: `ASKED`, `ANSWERED` or `FAILED`; `WAIT` where the answer is late and may still come."""
ASKED, ANSWERED, FAILED, WAIT = 0.0, 1.0, 2.0, 3.0
PERIOD = 2
"""T_c, s."""
INPUTS = 3
"""u, (arms, 3) row by row: the answer."""
SIGNALS = INPUTS + 6
GAINS = SIGNALS + MOST_SIGNALS
MEMORY = GAINS + MOST_GAINS
MESSAGE_SIZE = MEMORY + MOST_MEMORY
