"""Support for running scripts: options, artifacts, limits, provenance."""
