"""Fields as sparse volumes: ``.vdb`` for OpenVDB, Blender and Houdini, ``.nvdb`` for NanoVDB."""
