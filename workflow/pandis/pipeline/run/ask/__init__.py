"""What users ask for: configuration, options, names of fields, sources."""
