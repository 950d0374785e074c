"""Functions for single meshes: they run the workflow's stages in the caller's process."""
