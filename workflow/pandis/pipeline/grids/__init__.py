"""Fields sampled on grids: which nodes are needed, what they hold, how they are interpolated."""
