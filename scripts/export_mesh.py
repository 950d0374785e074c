"""Write the mesh for other programs. Reads mesh.zarr.zip, writes export/mesh.obj."""

from pandis.pipeline.export.drawn import export_mesh
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.report.seal import seal
from pandis.pipeline.run.ask.tasks import ExportMeshTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ExportMeshTask) as job:
    body = Body.open(job.read("mesh", "mesh"))
    job.write_file(seal(export_mesh(body), job.provenance(), ".obj"))
