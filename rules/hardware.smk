rule validate:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
        trajectory="<results>/{mesh}/trajectory.zarr.zip",
        evaluation="<results>/{mesh}/evaluation.zarr.zip",
        exports=plan.native,
    output:
        "<results>/{mesh}/hardware.zarr.zip",
        "<results>/{mesh}/hardware.json",
    log:
        "<results>/logs/{mesh}/validate.log",
    benchmark:
        "<results>/benchmarks/{mesh}/validate.jsonl"
    conda:
        "../workflow/envs/hardware.yaml"
    # all cores: no other job of this run may disturb the timing
    threads: all_cores
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        options=plan.options("validate"),
        code=plan.code("validate"),
    message:
        "{wildcards.mesh}: run every exported field at the servo rate"
    script:
        "../scripts/validate.py"
