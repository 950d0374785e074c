"""Force errors of each field, and recommendations."""
