# The plan that all rules take their params and inputs from.
from pathlib import Path

from snakemake.exceptions import WorkflowError

try:
    from pandis.pipeline.run.host import cluster, ending, scheduling
    from pandis.pipeline.run.job import stored
except ModuleNotFoundError as error:
    if error.name != "pandis":
        raise
    raise WorkflowError(
        "the library pandis lies beside its Snakefile, and this one was fetched without it: clone "
        "the repository (git submodule add) and name the Snakefile of the clone by its path"
    ) from None
from pandis.pipeline.run.ask.catalogue import MESH_NAME
from pandis.pipeline.run.plan.plan import open_plan

# the library of this file's own repository: another workflow may have taken it in as a module
root = Path(workflow.current_basedir).parent / "workflow"
# an object store that results go to, as `s3://bucket`, or nothing
store = workflow.storage_settings.default_storage_prefix
stored.tell_copies(workflow.storage_settings)
plan = open_plan(config, root, workflow.configfiles, store, workflow.is_main_process)


# <results> in every rule: `results:` in the configuration
pathvars:
    results=plan.folder,


# What a rule claims that must not be disturbed. Not `workflow.cores`: that raises where no
# number is given, as for `snakemake --report` and on a cluster.
all_cores = workflow.resource_settings.cores or 1


wildcard_constraints:
    mesh="|".join([*plan.meshes, *plan.refused]),
    scene="|".join(plan.scenes) or "no-scene",
    recipe="|".join(plan.recipes) or "no-recipe",
    artifact="|".join(plan.baked) or "no-artifact",
    field=MESH_NAME,
    ending="onnx|pt2",
    extension=r"[A-Za-z0-9.]+",
