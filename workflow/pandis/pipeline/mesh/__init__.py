"""Meshes: file formats, intake, diagnosis, repair and the mesh stage."""
