"""Other methods with which the paper compares its own."""
