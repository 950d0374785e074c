"""Fields in other programs and libraries: one package each, each optional."""
