"""The last step: check that every exported field holds 1 kHz on this machine."""
