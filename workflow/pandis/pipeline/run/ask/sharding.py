"""Which mesh of a data set belongs to which shard."""

import hashlib

#: Meshes of a shard at most, while there are fewer than the largest number of shards.
_MESHES, _SHARDS = 80, 128


def shard_of(name, count):
    """Return the shard of a mesh: a hash of its name, so that other meshes do not matter."""
    digest = hashlib.sha256(name.encode()).digest()
    return int.from_bytes(digest[:8], "big") % count


def shard_count(meshes):
    """Return the number of shards by default.

    It is a power of two, so that a shard takes its meshes from one or two others if it changes.
    """
    count = 1
    while count < _SHARDS and meshes > _MESHES * count:
        count *= 2
    return count
