"""Warp code that labels millions of points, fills volumes, and speeds up training steps."""
