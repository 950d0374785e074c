"""Which jobs a configuration needs."""
