"""What a running script needs: options, artifacts, limits, provenance."""
