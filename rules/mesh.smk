rule fetch:
    output:
        "<results>/{mesh}/source.{extension}",
    log:
        "<results>/logs/{mesh}/fetch-{extension}.log",
    benchmark:
        "<results>/benchmarks/{mesh}/fetch-{extension}.jsonl"
    retries: 2
    conda:
        "../workflow/envs/mesh.yaml"
    resources:
        mem_mb=1000,
        runtime=30,
    params:
        options=plan.options("fetch"),
        code=plan.code("fetch"),
    message:
        "{wildcards.mesh}: download the mesh"
    script:
        "../scripts/fetch.py"


rule mesh:
    input:
        local(plan.source),
    output:
        "<results>/{mesh}/mesh.zarr.zip",
    log:
        "<results>/logs/{mesh}/mesh.log",
    benchmark:
        "<results>/benchmarks/{mesh}/mesh.jsonl"
    conda:
        "../workflow/envs/mesh.yaml"
    resources:
        mem_mb=8000,
        runtime=60,
    params:
        options=plan.options("mesh"),
        code=plan.code("mesh"),
        source=plan.source_digest,
    message:
        "{wildcards.mesh}: read and repair the mesh"
    script:
        "../scripts/mesh.py"


rule refuse:
    output:
        "<results>/{mesh}/refused",
    log:
        "<results>/logs/{mesh}/refuse.log",
    benchmark:
        "<results>/benchmarks/{mesh}/refuse.jsonl"
    conda:
        "../workflow/envs/mesh.yaml"
    resources:
        mem_mb=500,
        runtime=5,
    params:
        options=plan.options("refuse"),
        code=plan.code("refuse"),
    message:
        "{wildcards.mesh}: report why it cannot be built"
    script:
        "../scripts/refuse.py"
