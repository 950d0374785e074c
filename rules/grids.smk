rule bake:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/{artifact}.zarr.zip",
    log:
        "<results>/logs/{mesh}/bake-{artifact}.log",
    benchmark:
        "<results>/benchmarks/{mesh}/bake-{artifact}.jsonl"
    conda:
        "../workflow/envs/grids.yaml"
    threads: 2
    resources:
        mem_mb=8000,
        runtime=120,
    params:
        options=plan.options("bake"),
        code=plan.code("bake"),
    message:
        "{wildcards.mesh}: build {wildcards.artifact}"
    script:
        "../scripts/bake.py"
