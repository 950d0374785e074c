"""Planning: the jobs that a configuration needs."""
