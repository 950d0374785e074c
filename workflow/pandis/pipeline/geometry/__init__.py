"""A body in its frame: exact distance, points on and below it, thickness, probe paths."""
