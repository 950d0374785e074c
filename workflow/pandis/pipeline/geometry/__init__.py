"""Geometry of a body: exact distance, points on and below its surface, thickness, probe paths."""
