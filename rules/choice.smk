rule choose:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
        times=local(plan.query_times),
    output:
        "<results>/{mesh}/choice.zarr.zip",
    log:
        "<results>/logs/{mesh}/choose.log",
    benchmark:
        "<results>/benchmarks/{mesh}/choose.jsonl"
    conda:
        "../workflow/envs/choice.yaml"
    threads: 2
    resources:
        mem_mb=8000,
        runtime=720,
    params:
        options=plan.options("choose"),
        code=plan.code("choose"),
    message:
        "{wildcards.mesh}: build the cheapest field that meets the budget"
    script:
        "../scripts/choose.py"


rule calibrate:
    output:
        "<results>/query-times.csv",
    log:
        "<results>/logs/calibrate.log",
    benchmark:
        "<results>/benchmarks/calibrate.jsonl"
    conda:
        "../workflow/envs/choice.yaml"
    threads: all_cores
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        options=plan.options("calibrate"),
        code=plan.code("calibrate"),
    message:
        "time every kind of field on this machine"
    script:
        "../scripts/calibrate.py"
