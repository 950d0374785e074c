"""The last step: checks that every exported field keeps up with 1 kHz on this machine."""
