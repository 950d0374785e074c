"""Verified, reproducible force fields for haptic rendering, from any triangle mesh."""

__version__ = "0.1.0"
