"""The folder of the workflow: its Snakefile, and beside it rules, scripts and configurations."""

from pathlib import Path


def workflow_folder():
    """Return the folder of the Snakefile.

    In a checkout this is the folder that contains the package; in an installation it is inside the
    package.
    """
    package = Path(__file__).resolve().parents[1]
    beside = package.parent
    return beside if (beside / "Snakefile").is_file() else package / "snakemake/workflow"
