"""Everything that makes files: the stages that Snakemake runs."""
