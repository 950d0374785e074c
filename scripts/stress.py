"""Ask all fields of a mesh what they do to a device and a hand. Writes stress.zarr.zip."""

from pandis.fields.registry import open_fields
from pandis.sampling import open_surface
from pandis.stage import stage
from pandis.stress.suite import Suite, stress

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    fields = open_fields(job.options["fields"], mesh, map(job.read_path, job.input.fields))
    engine = fields.exact.engine
    suite = Suite(mesh, open_surface(mesh, engine), engine, job.options)
    arrays, attributes = stress(fields, suite, job.progress)
    for name, failed in attributes["failed"].items():
        job.log(f"{name}: " + (f"fails {', '.join(failed)}" if failed else "passes"))
    job.write("stress", arrays, attributes)
