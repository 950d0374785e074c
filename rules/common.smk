# The plan from which all rules get their params and inputs.
from pathlib import Path

from snakemake.exceptions import WorkflowError

try:
    from pandis.pipeline.run.host import cluster, ending, scheduling
    from pandis.pipeline.run.job import stored
except ModuleNotFoundError as error:
    if error.name != "pandis":
        raise
    raise WorkflowError(
        "this Snakefile was fetched without the pandis library, which must be beside it: clone "
        "the repository (git submodule add) and give the path of the clone's Snakefile"
    ) from None
from pandis.pipeline.run.ask.catalogue import MESH_NAME
from pandis.pipeline.run.plan.opening import open_plan

# the Snakefile's folder, even if another workflow includes this one as a module
folder = Path(workflow.current_basedir).parent / "workflow"
# the object store for the results, as `s3://bucket`, or empty
store = workflow.storage_settings.default_storage_prefix
stored.tell_copies(workflow.storage_settings)
plan = open_plan(config, folder, workflow.configfiles, store=store, aloud=workflow.is_main_process)


# <results> in every rule is `results:` of the configuration
pathvars:
    results=plan.folder,


# Cores of a rule that must run undisturbed. `workflow.cores` would raise an error if no number
# is given, as with `snakemake --report` and on a cluster.
all_cores = workflow.resource_settings.cores or 1


wildcard_constraints:
    mesh="|".join([*plan.meshes, *plan.refused]) or "no-mesh",
    dataset="|".join(plan.datasets.planned) or "no-dataset",
    shard=r"\d{5}",
    scene="|".join(plan.scenes) or "no-scene",
    recipe="|".join(plan.recipes) or "no-recipe",
    artifact="|".join(plan.baked) or "no-artifact",
    field=MESH_NAME,
    ending="onnx|pt2",
    extension=r"[A-Za-z0-9.]+",
