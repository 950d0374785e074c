rule sample:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/samples.zarr.zip",
    log:
        "<results>/logs/{mesh}/sample.log",
    benchmark:
        "<results>/benchmarks/{mesh}/sample.jsonl"
    priority: plan.sample_priority
    conda:
        "../workflow/envs/samples.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=60,
    params:
        options=plan.options("sample"),
        code=plan.code("sample"),
    message:
        "{wildcards.mesh}: draw and label training points"
    script:
        "../scripts/sample.py"
