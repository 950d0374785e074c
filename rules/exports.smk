rule export_native:
    input:
        held=plan.native_artifact,
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/export/{name}.pandis",
    log:
        "<results>/logs/{mesh}/export-{name}-native.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-{name}-native.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    resources:
        mem_mb=2000,
        runtime=15,
    params:
        options=plan.options("export_native"),
        code=plan.code("export_native"),
    message:
        "{wildcards.mesh}: export {wildcards.name} for pandis.h and compare it with the library"
    script:
        "../scripts/export_native.py"
