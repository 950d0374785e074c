rule bake:
    input:
        mesh="results/{mesh}/mesh.zarr.zip",
    output:
        "results/{mesh}/grid-{content}-{size}.zarr.zip",
    log:
        "results/logs/{mesh}/bake-{content}-{size}.log",
    benchmark:
        "results/benchmarks/{mesh}/bake-{content}-{size}.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    threads: 2
    resources:
        mem_mb=4000,
        runtime=120,
    params:
        options=plan.options("bake"),
        code=plan.code("bake"),
    message:
        "{wildcards.mesh}: bake {wildcards.size}³ nodes of {wildcards.content}"
    script:
        "../scripts/bake.py"


rule export_grid:
    input:
        grid=plan.grid_artifact,
    output:
        "results/{mesh}/export/{field}.onnx",
    log:
        "results/logs/{mesh}/export-{field}.log",
    benchmark:
        "results/benchmarks/{mesh}/export-{field}.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    resources:
        mem_mb=4000,
        runtime=15,
    params:
        options=plan.options("export_grid"),
        code=plan.code("export_grid"),
    message:
        "{wildcards.mesh}: export {wildcards.field} and compare it with the library"
    script:
        "../scripts/export_grid.py"
