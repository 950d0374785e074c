"""How wrong and how fast each field is."""
