"""Exports of fields for other programs; those for MuJoCo, Newton and VDB are checked."""
