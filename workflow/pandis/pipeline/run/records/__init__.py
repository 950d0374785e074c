"""Records of artifacts' attributes: one module per kind of artifact that other stages read."""
