"""Foundations of all packages: errors, random streams, frames, the penalty law."""
