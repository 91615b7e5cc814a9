"""Other engines on the paper's system, for `flexlab bench --peers`: each is checked for the same motion, then timed.

They need `pip install --editable ".[peers]"` in a checkout, because flexlab itself does not include them.
"""

from peers.beam_comparison import compare_beams
from peers.chain_comparison import compare_chains
from peers.peer_comparison import compare_peers
from peers.tables import beam_table, chain_table, peers_table

__all__ = ["beam_table", "chain_table", "compare_beams", "compare_chains", "compare_peers", "peers_table"]
