"""Judges fields: errors, stress, timing and the servo loop, and the choice that rests on them."""
