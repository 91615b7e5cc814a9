"""By which word the runs of a visitor are known as theirs."""

import hashlib


def owner_word(visitor: str) -> str:
    """What stands in the notes of a visitor's runs: it tells nothing of the secret it is made from. Empty for nobody."""
    return hashlib.sha256(f"flexlab run of {visitor}".encode("utf-8", "replace")).hexdigest()[:32] if visitor else ""
