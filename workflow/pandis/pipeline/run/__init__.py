"""Planning, execution and checks of a run: configuration, stages, artifacts, provenance."""
