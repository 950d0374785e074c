"""What everything stands on: errors, random streams, frames, the penalty law."""
