"""Exact distances on a GPU, for labels by the million. Needs Warp."""
