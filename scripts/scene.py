"""Test a scene. Reads the fields of its objects, writes scenes/{scene}.zarr.zip, .json and .h."""

from pandis.pipeline.judge.scenes import try_scene
from pandis.pipeline.run.ask.tasks import SceneTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, SceneTask) as job:
    files = [job.note_file(path) for path in job.input.fields]
    name = snakemake.wildcards.scene
    arrays, attributes, text = try_scene(
        name, files, job.options, progress=job.progress, log=job.log
    )
    job.write("scene", arrays, attributes)
    job.write_file(text.encode(), index=1)
    job.write_file(attributes["header"].encode(), index=2)
