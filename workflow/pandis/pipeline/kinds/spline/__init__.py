"""Banded, refined, quantised tricubic splines."""
