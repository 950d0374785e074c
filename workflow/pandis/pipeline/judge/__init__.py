"""Judges fields: errors, stress, timing and the servo loop; and chooses fields by the results."""
