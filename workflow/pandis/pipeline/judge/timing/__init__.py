"""Query times of fields."""
