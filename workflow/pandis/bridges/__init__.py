"""Bridges to other programs and libraries, each in an optional package."""
