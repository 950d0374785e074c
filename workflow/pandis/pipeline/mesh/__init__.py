"""Meshes: intake, diagnosis, repair, the unit frame, closed-form shapes."""
