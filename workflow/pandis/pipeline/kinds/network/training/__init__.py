"""Training of the sine network: architecture, losses, recipes, trainer. Imports torch."""
