"""The stress suite: tests of what a force field does to a device and a hand."""
