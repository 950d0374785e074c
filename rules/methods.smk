rule support_planes:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/method-support-planes.zarr.zip",
    log:
        "<results>/logs/{mesh}/support-planes.log",
    benchmark:
        "<results>/benchmarks/{mesh}/support-planes.jsonl"
    conda:
        "../workflow/envs/methods.yaml"
    threads: 2
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        options=plan.options("support_planes"),
        code=plan.code("support_planes"),
    message:
        "{wildcards.mesh}: lay support planes"
    script:
        "../scripts/support_planes.py"
