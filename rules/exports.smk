rule export_graph:
    input:
        artifact=plan.field_artifact,
    output:
        "<results>/{mesh}/export/{field}.{ending}",
    log:
        "<results>/logs/{mesh}/export-{field}-{ending}.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-{field}-{ending}.jsonl"
    conda:
        "../workflow/envs/exports.yaml"
    resources:
        mem_mb=5000,
        runtime=15,
    params:
        options=plan.options("export_graph"),
        code=plan.code("export_graph"),
    message:
        "{wildcards.mesh}: export {wildcards.field} as {wildcards.ending} and verify it"
    script:
        "../scripts/export_graph.py"


rule export_vti:
    input:
        artifact=plan.field_artifact,
    output:
        "<results>/{mesh}/export/{field}.vti",
    log:
        "<results>/logs/{mesh}/export-{field}-vti.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-{field}-vti.jsonl"
    conda:
        "../workflow/envs/exports.yaml"
    resources:
        mem_mb=4000,
        runtime=15,
    params:
        options=plan.options("export_vti"),
        code=plan.code("export_vti"),
    message:
        "{wildcards.mesh}: write {wildcards.field} as VTK image data"
    script:
        "../scripts/export_vti.py"


rule export_mesh:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/export/mesh.obj",
    log:
        "<results>/logs/{mesh}/export-mesh.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-mesh.jsonl"
    conda:
        "../workflow/envs/exports.yaml"
    resources:
        mem_mb=2000,
        runtime=15,
    params:
        options=plan.options("export_mesh"),
        code=plan.code("export_mesh"),
    message:
        "{wildcards.mesh}: write the repaired mesh for other programs"
    script:
        "../scripts/export_mesh.py"


rule export_mjcf:
    input:
        exports=plan.distance_files,
        drawn="<results>/{mesh}/export/mesh.obj",
    output:
        "<results>/{mesh}/export/mujoco.xml",
    log:
        "<results>/logs/{mesh}/export-mjcf.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-mjcf.jsonl"
    conda:
        "../workflow/envs/exports.yaml"
    resources:
        mem_mb=3000,
        runtime=15,
    params:
        options=plan.options("export_mjcf"),
        code=plan.code("export_mjcf"),
    message:
        "{wildcards.mesh}: write a model for MuJoCo and compare it with the library"
    script:
        "../scripts/export_mjcf.py"


rule export_newton:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/export/newton.npz",
    log:
        "<results>/logs/{mesh}/export-newton.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-newton.jsonl"
    conda:
        "../workflow/envs/exports.yaml"
    resources:
        mem_mb=3000,
        runtime=15,
    params:
        options=plan.options("export_newton"),
        code=plan.code("export_newton"),
    message:
        "{wildcards.mesh}: write distances for Newton's cache and compare them with the library"
    script:
        "../scripts/export_newton.py"


rule export_page:
    input:
        exports=plan.distance_files,
    output:
        "<results>/{mesh}/export/touch.html",
    log:
        "<results>/logs/{mesh}/export-page.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-page.jsonl"
    conda:
        "../workflow/envs/exports.yaml"
    resources:
        mem_mb=2000,
        runtime=15,
    params:
        options=plan.options("export_page"),
        code=plan.code("export_page"),
    message:
        "{wildcards.mesh}: write an interactive page for touching its fields"
    script:
        "../scripts/export_page.py"


rule export_vdb:
    input:
        exports=plan.distance_files,
    output:
        "<results>/{mesh}/export/fields.vdb",
    log:
        "<results>/logs/{mesh}/export-vdb.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-vdb.jsonl"
    conda:
        "../workflow/envs/exports.yaml"
    resources:
        mem_mb=3000,
        runtime=15,
    params:
        options=plan.options("export_vdb"),
        code=plan.code("export_vdb"),
    message:
        "{wildcards.mesh}: write its fields as volumes and compare them with the library"
    script:
        "../scripts/export_vdb.py"


rule export_native:
    input:
        artifact=plan.field_artifact,
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/export/{field}.pandis",
    log:
        "<results>/logs/{mesh}/export-{field}-native.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-{field}-native.jsonl"
    conda:
        "../workflow/envs/exports.yaml"
    resources:
        mem_mb=2000,
        runtime=15,
    params:
        options=plan.options("export_native"),
        code=plan.code("export_native"),
    message:
        "{wildcards.mesh}: export {wildcards.field} for pandis.h and compare it with the library"
    script:
        "../scripts/export_native.py"
