"""The mesh with its vertices on a lattice."""
