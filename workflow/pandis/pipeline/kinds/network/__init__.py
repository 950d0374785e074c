"""Sine networks."""
