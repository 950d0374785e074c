"""Records of artifacts' attributes: one module for each kind that other stages read."""
