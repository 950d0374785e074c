"""What a force field does to a device and a hand: the stress suite, one module per question."""
