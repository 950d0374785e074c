"""Other methods that the paper compares with."""
