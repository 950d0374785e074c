"""The mesh itself, or its closed form."""
