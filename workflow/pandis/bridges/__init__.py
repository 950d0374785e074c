"""Fields in other programs and libraries: an optional package for each."""
