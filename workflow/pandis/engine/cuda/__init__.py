"""Code in Warp: exact distances for labels by the million, volumes, and training steps."""
