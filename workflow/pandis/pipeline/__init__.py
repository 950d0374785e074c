"""The code that creates files: the stages that Snakemake runs."""
