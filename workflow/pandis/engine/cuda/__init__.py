"""Warp code: exact distances for millions of labels, volumes, and training steps."""
