"""How a run is planned, carried out and checked: configuration, stages, artifacts, provenance."""
