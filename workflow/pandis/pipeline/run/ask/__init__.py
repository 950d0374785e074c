"""User input: configuration, options, names of fields, sources."""
