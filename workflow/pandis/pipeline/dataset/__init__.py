"""Data sets: many meshes, labelled by a pool of processes and stored in shards."""
