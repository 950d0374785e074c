rule bake:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/grid-{content}-{size}.zarr.zip",
    log:
        "<results>/logs/{mesh}/bake-{content}-{size}.log",
    benchmark:
        "<results>/benchmarks/{mesh}/bake-{content}-{size}.jsonl"
    conda:
        "../workflow/envs/grids.yaml"
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


rule bake_spline:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/grid-spline-{size}.zarr.zip",
    log:
        "<results>/logs/{mesh}/bake-spline-{size}.log",
    benchmark:
        "<results>/benchmarks/{mesh}/bake-spline-{size}.jsonl"
    conda:
        "../workflow/envs/grids.yaml"
    threads: 2
    resources:
        mem_mb=4000,
        runtime=120,
    params:
        options=plan.options("bake_spline"),
        code=plan.code("bake_spline"),
    message:
        "{wildcards.mesh}: fit a spline of {wildcards.size}³ nodes"
    script:
        "../scripts/bake_spline.py"


rule bake_auto:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/grid-{kind}-auto.zarr.zip",
    log:
        "<results>/logs/{mesh}/bake-{kind}-auto.log",
    benchmark:
        "<results>/benchmarks/{mesh}/bake-{kind}-auto.jsonl"
    conda:
        "../workflow/envs/grids.yaml"
    threads: 2
    resources:
        mem_mb=4000,
        runtime=120,
    params:
        options=plan.options("bake_auto"),
        code=plan.code("bake_auto"),
    message:
        "{wildcards.mesh}: find the size of {wildcards.kind}-auto"
    script:
        "../scripts/bake_auto.py"


rule bake_compact:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/compact-{bits}.zarr.zip",
    log:
        "<results>/logs/{mesh}/bake-compact-{bits}.log",
    benchmark:
        "<results>/benchmarks/{mesh}/bake-compact-{bits}.jsonl"
    conda:
        "../workflow/envs/grids.yaml"
    threads: 2
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        options=plan.options("bake_compact"),
        code=plan.code("bake_compact"),
    message:
        "{wildcards.mesh}: pack the mesh on a lattice of {wildcards.bits} bits"
    script:
        "../scripts/bake_compact.py"


rule bake_compact_auto:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/compact-auto.zarr.zip",
    log:
        "<results>/logs/{mesh}/bake-compact-auto.log",
    benchmark:
        "<results>/benchmarks/{mesh}/bake-compact-auto.jsonl"
    conda:
        "../workflow/envs/grids.yaml"
    threads: 2
    resources:
        mem_mb=8000,
        runtime=120,
    params:
        options=plan.options("bake_compact_auto"),
        code=plan.code("bake_compact_auto"),
    message:
        "{wildcards.mesh}: find bits and faces of compact-auto"
    script:
        "../scripts/bake_compact_auto.py"
