"""The last step: does every exported field hold at 1 kHz on this machine."""
