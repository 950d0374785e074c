"""Exports of fields for other programs, each checked before it counts."""
