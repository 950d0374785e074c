"""Write the mesh for other programs. Reads mesh.zarr.zip, writes export/mesh.obj."""

from pandis.export.drawn import export_mesh
from pandis.geometry.body import Body
from pandis.report.seal import seal
from pandis.run.stage import stage
from pandis.run.tasks import ExportMeshTask

with stage(snakemake, ExportMeshTask) as job:
    body = Body.open(job.read("mesh", "mesh"))
    job.write_file(seal(export_mesh(body), job.provenance(), ".obj"))
