"""Values at the nodes of a regular grid."""
