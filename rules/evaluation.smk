rule trajectory:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/trajectory.zarr.zip",
    log:
        "<results>/logs/{mesh}/trajectory.log",
    benchmark:
        "<results>/benchmarks/{mesh}/trajectory.jsonl"
    conda:
        "../workflow/envs/evaluation.yaml"
    resources:
        mem_mb=2000,
        runtime=15,
    params:
        options=plan.options("trajectory"),
        code=plan.code("trajectory"),
    message:
        "{wildcards.mesh}: trace the probe's path"
    script:
        "../scripts/trajectory.py"


rule evaluate:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
        trajectory="<results>/{mesh}/trajectory.zarr.zip",
        fields=plan.field_files,
    output:
        "<results>/{mesh}/evaluation.zarr.zip",
    log:
        "<results>/logs/{mesh}/evaluate.log",
    benchmark:
        "<results>/benchmarks/{mesh}/evaluate.jsonl"
    conda:
        "../workflow/envs/evaluation.yaml"
    threads: 2
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        options=plan.options("evaluate"),
        code=plan.code("evaluate"),
    message:
        "{wildcards.mesh}: compare all fields with the exact one"
    script:
        "../scripts/evaluate.py"


rule stress:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
        fields=plan.field_files,
    output:
        "<results>/{mesh}/stress.zarr.zip",
    log:
        "<results>/logs/{mesh}/stress.log",
    benchmark:
        "<results>/benchmarks/{mesh}/stress.jsonl"
    conda:
        "../workflow/envs/evaluation.yaml"
    threads: 2
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        options=plan.options("stress"),
        code=plan.code("stress"),
    message:
        "{wildcards.mesh}: run the stress suite on all fields"
    script:
        "../scripts/stress.py"


rule timing:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
        trajectory="<results>/{mesh}/trajectory.zarr.zip",
        exports=plan.exports,
        natives=plan.native,
        programs=plan.programs,
        fields=plan.unexported,
    output:
        "<results>/{mesh}/timing.zarr.zip",
    log:
        "<results>/logs/{mesh}/timing.log",
    benchmark:
        "<results>/benchmarks/{mesh}/timing.jsonl"
    conda:
        "../workflow/envs/evaluation.yaml"
    # all cores: no other job of this run may disturb the timing
    threads: all_cores
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        options=plan.options("timing"),
        code=plan.code("timing"),
    message:
        "{wildcards.mesh}: time all fields"
    script:
        "../scripts/timing.py"
