"""What stands among the attributes of each kind of artifact: one module for each that is read."""
