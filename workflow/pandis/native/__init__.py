"""The parts in C: each package below holds one source file and its binding.

They are compiled on first use by the system's compiler, into the user's cache.
"""
